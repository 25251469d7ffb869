"""When the bridge streams, arms, asks for modes and lands. Pure: times and what was heard come in.

Three rules stand above all. Only HEARTBEAT says what is so. A mode that somebody else chose is
never fought. And nothing is armed twice for one take-off: after a flight, a lost link or a
refusal the mission must have stood on the ground, or the operator must ask.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum

from tombo_control.autopilot import BLIND, HOLD, IDLE, LAND, LANDED, TAKEOFF
from tombo_px4.bridge.modes import AUTO_HOLD, AUTO_LAND, OFFBOARD, Mode, mode_name
from tombo_px4.bridge.records import Acknowledged, Heartbeat, Landed, StatusText
from tombo_px4.link.errand import Errand, Order, Words

_FLIGHT = range(TAKEOFF, HOLD + 1)
_DOWN = (LAND, BLIND)
_GROUND = (IDLE, LANDED)
_MODE_TRIES, _ARM_TRIES, _ASKED_TRIES = 3, 5, 2
_STREAM_FIRST_NS = 1_000_000_000
"""PX4 wants to see set points for so long before it takes OFFBOARD."""
_OWN_ARMING_NS = 5_000_000_000
"""A vehicle that arms so soon after our order was armed by it."""
_SELF_DISARM_NS = 4_000_000_000
"""PX4 disarms 2 s after landing (COM_DISARM_LAND); after this we ask."""

_GRACE_NS = 3_000_000_000
"""Vehicle and bridge start in any order."""


class Stage(Enum):
    """Where the bridge stands with the vehicle."""

    WAITING = "waiting for the vehicle"
    READY = "ready"
    ENTERING = "entering offboard"
    ARMING = "arming"
    FLYING = "offboard"
    LANDING = "landing"
    TAKEN = "mode is somebody else's"
    REFUSED = "given up"
    LOST = "link lost"


class Stream(Enum):
    """What goes out as set point."""

    PRESENT = "present"
    """Where the vehicle says it is."""
    HOLD = "hold"
    """Where it was when this began."""
    SETPOINT = "setpoint"


@dataclass(frozen=True)
class Request:
    """What an operator asks for."""

    number: int
    kind: str
    """`arm`, `disarm`, `offboard`, `land`, `hold`."""


@dataclass(frozen=True)
class Reply:
    """The answer to a request, once it is known."""

    number: int
    success: bool
    text: str


@dataclass(frozen=True)
class View:
    """What there is to decide on."""

    now_ns: int
    heartbeat: Heartbeat | None
    landed: Landed
    phase: int
    """Of the mission; IDLE without one."""
    fresh: bool
    """A set point came lately."""
    streaming: bool
    """There is a position to stream."""
    blockers: tuple[str, ...]
    """Why not to arm, in words."""
    must_land: str = ""
    """Why the flight has to end here, in words."""


@dataclass
class Decision:
    """What to do in this tick."""

    stream: Stream = Stream.PRESENT
    orders: list[Order] = field(default_factory=list)
    faults: dict[str, str] = field(default_factory=dict)
    """What is wrong now."""
    events: list[tuple[str, str]] = field(default_factory=list)
    """What went wrong just now."""
    replies: list[Reply] = field(default_factory=list)


class Session:
    """The state machine; `tick` decides."""

    def __init__(self, link_timeout_s: float) -> None:
        self.stage = Stage.WAITING
        self.why = ""
        """Why it stands there."""
        self.words = Words()
        self._timeout_ns = round(link_timeout_s * 1e9)
        self._errand: Errand | None = None
        self._may_engage = self._has_heard = False
        self._own_arming_ns: int | None = None
        self._armed_for_flight = False
        self._stream_since_ns: int | None = None
        self._landed_since_ns: int | None = None
        self._begun_ns: int | None = None
        self._before_loss = Stage.WAITING
        self._by_own_means = False
        self._asked: deque[Request] = deque()
        self._request: Request | None = None
        self._request_errand: Errand | None = None

    @property
    def expects(self) -> bool:
        """An order is under way that a heartbeat is to confirm."""
        return self._errand is not None or self._request_errand is not None

    def ask(self, request: Request) -> None:
        """Take what an operator asks for; the answer is in a later `Decision.replies`."""
        self._asked.append(request)

    def acknowledged(self, ack: Acknowledged) -> None:
        """Take PX4's answer to a command."""
        for errand in (self._errand, self._request_errand):
            if errand is not None:
                errand.acknowledged(ack)

    def said(self, text: StatusText) -> None:
        """Take words of PX4."""
        self.words.take(text)

    def clock_set_back(self, out: Decision) -> None:
        """Begin all waiting anew: what was to end at some time would not end for long."""
        why = "the system's clock was set back meanwhile"
        self._drop_requests(out, why)
        self._stream_since_ns = self._landed_since_ns = self._own_arming_ns = None
        if self.stage in (Stage.ENTERING, Stage.ARMING):
            self._give_up(why)
        elif self._errand is not None:
            self._errand = Errand(self._errand.order, _MODE_TRIES)

    def tick(self, view: View) -> Decision:
        """Decide."""
        out = Decision()
        heartbeat = view.heartbeat
        if view.streaming:
            self._stream_since_ns = self._stream_since_ns or view.now_ns
        else:
            self._stream_since_ns = None
        if heartbeat is None or view.now_ns - heartbeat.arrival_ns > self._timeout_ns:
            self._without_link(view, out)
            return out
        if self.stage in (Stage.WAITING, Stage.LOST):
            self._found(view, heartbeat)
        if view.fresh:
            self._hear_mission(view, heartbeat)
        self._watch_ground(view, heartbeat, out)
        self._serve(view, heartbeat, out)
        if self._request is None:
            self._advance(view, heartbeat, out)
        self._tell(view, heartbeat, out)
        return out

    def _hear_mission(self, view: View, heartbeat: Heartbeat) -> None:
        """Be willing once more when the mission is on the ground, or begins as it is first heard.

        Its first words may be lost while the nodes find each other.
        """
        begins = view.phase == TAKEOFF and not self._has_heard
        self._has_heard = True
        if not heartbeat.armed and (begins or view.phase in _GROUND):
            self._may_engage = True

    # --- The link -----------------------------------------------------------------------------

    def _without_link(self, view: View, out: Decision) -> None:
        if self.stage not in (Stage.WAITING, Stage.LOST):
            self._before_loss = self.stage
            self._go(Stage.LOST, "")
        heard = view.heartbeat
        if heard is None:
            text = "no heartbeat of the vehicle: is it on, and does it send here?"
            self._begun_ns = self._begun_ns or view.now_ns
            if view.now_ns - self._begun_ns > _GRACE_NS:
                out.faults["no_vehicle"] = text
        else:
            age = (view.now_ns - heard.arrival_ns) * 1e-9
            armed = "armed, " if heard.armed else ""
            text = f"no heartbeat for {age:.1f} s, last {armed}mode {mode_name(heard.mode)}"
            out.faults["link_lost"] = f"{text}: nothing is armed when it comes back"
        self._drop_requests(out, text)
        if self._before_loss == Stage.FLYING and view.phase in _FLIGHT:
            out.stream = Stream.SETPOINT  # it may still be heard

    def _found(self, view: View, heartbeat: Heartbeat) -> None:
        """A vehicle is there, for the first time or again."""
        lost, self._before_loss = self._before_loss, Stage.WAITING
        flew = lost in (Stage.ENTERING, Stage.ARMING, Stage.FLYING, Stage.LANDING, Stage.TAKEN)
        if heartbeat.armed:
            if heartbeat.mode == AUTO_LAND and lost == Stage.LANDING:
                self._go(Stage.LANDING, "link is back")
            elif heartbeat.mode == OFFBOARD and lost == Stage.FLYING:
                self._go(Stage.FLYING, "link is back")
            else:
                self._go(Stage.TAKEN, f"found armed in mode {mode_name(heartbeat.mode)}")
        elif flew:
            self._give_up("disarmed while the link was lost")
        else:
            self._go(Stage.READY, "")

    # --- The operator -------------------------------------------------------------------------

    def _serve(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        """Begin, go on with, or answer what the operator asks for."""
        while self._asked:
            request = self._asked.popleft()
            if self._request is not None:
                self._reply(out, False, f"overtaken by '{request.kind}'")
            self._begin_request(request, view, heartbeat, out)
        errand = self._request_errand
        if self._request is None or errand is None:
            return
        if errand.tick(heartbeat, self.words, view.now_ns):
            out.orders.append(errand.order)
            if errand.order.armed:
                self._own_arming_ns = view.now_ns
        if errand.failed:
            self._reply(out, False, errand.refusal)
        elif errand.done:
            self._fulfilled(view, heartbeat, out)

    def _begin_request(
        self, request: Request, view: View, heartbeat: Heartbeat, out: Decision
    ) -> None:
        self._request = request
        kind = request.kind
        why_not = ""
        if kind == "arm" and not heartbeat.armed:
            why_not = "; ".join(view.blockers)
        elif kind in ("land", "hold") and not heartbeat.armed:
            why_not = "the vehicle is not armed"
        elif kind == "offboard" and not view.streaming:
            why_not = "PX4 gives no position: there is nothing to stream, and it would refuse"
        if why_not:
            self._reply(out, False, why_not)
            return
        if kind in ("disarm", "land", "hold") and self.stage in (Stage.ENTERING, Stage.ARMING):
            self._give_up(f"stopped by the operator: {kind}")
        orders = {
            "arm": Order(armed=True),
            "disarm": Order(armed=False),
            "offboard": Order(mode=OFFBOARD),
            "land": Order(mode=AUTO_LAND),
            "hold": Order(mode=AUTO_HOLD),
        }
        self._request_errand = Errand(orders[kind], _ASKED_TRIES)

    def _fulfilled(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        assert self._request is not None
        kind = self._request.kind
        self._reply(out, True, f"{kind}: confirmed")
        if kind == "offboard":
            self._may_engage = True
            self._go(Stage.FLYING if heartbeat.armed else Stage.READY, "asked by the operator")
        elif kind == "land":
            self._go(Stage.LANDING, "asked by the operator")
        elif kind == "hold":
            self._go(Stage.TAKEN, "hold, asked by the operator")
        elif kind == "arm" and self.stage not in (Stage.FLYING, Stage.LANDING):
            flies = heartbeat.mode == OFFBOARD
            self._own_arming_ns = None
            self._armed_for_flight = False
            self._go(Stage.FLYING if flies else Stage.TAKEN, "armed by the operator")
        elif kind == "disarm":
            self._may_engage = False
            self._go(Stage.READY, "disarmed by the operator")

    def _reply(self, out: Decision, success: bool, text: str) -> None:
        assert self._request is not None
        out.replies.append(Reply(self._request.number, success, text))
        self._request = self._request_errand = None

    def _drop_requests(self, out: Decision, text: str) -> None:
        if self._request is not None:
            self._reply(out, False, text)
        while self._asked:
            out.replies.append(Reply(self._asked.popleft().number, False, text))

    # --- The flight ---------------------------------------------------------------------------

    def _advance(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        steps = {
            Stage.READY: self._ready,
            Stage.ENTERING: self._entering,
            Stage.ARMING: self._arming,
            Stage.FLYING: self._flying,
            Stage.LANDING: self._landing,
            Stage.TAKEN: self._taken,
            Stage.REFUSED: self._refused,
        }
        steps[self.stage](view, heartbeat, out)

    def _wants_flight(self, view: View) -> bool:
        return view.fresh and view.phase in _FLIGHT

    def _ready(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if heartbeat.armed and self._halfway(view):
            self._give_up("armed after it was called off")
            return
        if heartbeat.armed:
            mode = mode_name(heartbeat.mode)
            self._go(Stage.TAKEN, f"armed by somebody else, in mode {mode}")
            return
        if not self._wants_flight(view):
            return
        if not self._may_engage:
            out.faults["not_engaged"] = (
                "the mission wants to fly, but was not seen on the ground since the last flight:"
                " start it anew, or call px4/offboard"
            )
        elif view.blockers:
            out.faults["preflight"] = "not armed: " + "; ".join(view.blockers)
        elif (
            self._stream_since_ns is not None
            and view.now_ns - self._stream_since_ns >= _STREAM_FIRST_NS
        ):
            self._go(Stage.ENTERING, "")
            self._errand = Errand(Order(mode=OFFBOARD), _MODE_TRIES)
            self._entering(view, heartbeat, out)

    def _entering(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if heartbeat.armed:
            self._go(Stage.TAKEN, "armed by somebody else")
        elif not self._wants_flight(view):
            self._go(Stage.READY, "the mission takes it back")
        elif view.blockers:
            self._go(Stage.READY, "")
        elif self._pursue(view, heartbeat, out) == "failed":
            self._give_up_errand(out)
        elif self._errand is not None and self._errand.done:
            self._go(Stage.ARMING, "")
            self._errand = Errand(Order(armed=True), _ARM_TRIES)
            self._arming(view, heartbeat, out)

    def _arming(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if heartbeat.mode != OFFBOARD:
            said = self.words.lately(view.now_ns)
            mode = mode_name(heartbeat.mode)
            why = f"mode changed to {mode} while arming" + (f": {said}" if said else "")
            self._give_up(why)
            out.events.append(("refused", why))
        elif not heartbeat.armed and not self._wants_flight(view):
            self._give_up("the mission took it back while arming")
        elif not heartbeat.armed and view.blockers:
            self._give_up("while arming: " + "; ".join(view.blockers))
            out.events.append(("refused", self.why))
        elif self._pursue(view, heartbeat, out) == "failed":
            self._give_up_errand(out)
        elif self._errand is not None and self._errand.done:
            self._may_engage = False
            self._armed_for_flight = True
            self._own_arming_ns = None
            self._go(Stage.FLYING, "")

    def _flying(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if not heartbeat.armed:
            said = self.words.lately(view.now_ns)
            if view.phase in _FLIGHT:
                self._give_up("disarmed in flight" + (f": {said}" if said else ""))
                out.events.append(("disarmed", self.why))
            else:
                self._go(Stage.READY, "landed")
        elif heartbeat.mode != OFFBOARD:
            said = self.words.lately(view.now_ns)
            why = f"mode is {mode_name(heartbeat.mode)}, not offboard"
            self._go(Stage.TAKEN, why + (f": PX4 says {said}" if said else ""))
        elif view.must_land:
            out.events.append(("landing", view.must_land))
            self._go(Stage.LANDING, view.must_land)
            self._errand = Errand(Order(mode=AUTO_LAND), _MODE_TRIES)
        elif view.phase in _DOWN or (view.phase == LANDED and view.landed != Landed.ON_GROUND):
            self._go(Stage.LANDING, "")
            self._errand = Errand(Order(mode=AUTO_LAND), _MODE_TRIES)
            self._landing(view, heartbeat, out)
        elif (
            view.phase in _GROUND
            and view.landed == Landed.ON_GROUND
            and self._armed_for_flight
            and self._errand is None
        ):
            self._errand = Errand(Order(armed=False), _MODE_TRIES)
        elif view.phase in _FLIGHT:
            self._errand = None
        if self.stage == Stage.FLYING and self._pursue(view, heartbeat, out) == "failed":
            assert self._errand is not None
            out.events.append(("refused", self._errand.refusal))
            self._errand = None

    def _landing(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if not heartbeat.armed:
            self._go(Stage.READY, "landed")
            return
        if self._pursue(view, heartbeat, out) == "failed":
            assert self._errand is not None
            out.events.append(("refused", self._errand.refusal))
            self._errand = None
            self._by_own_means = True
        lands = heartbeat.mode == AUTO_LAND
        if lands:
            self._by_own_means = False
        under_way = self._errand is not None or self._by_own_means
        if not lands and not (under_way and heartbeat.mode == OFFBOARD):
            said = self.words.lately(view.now_ns)
            why = f"mode is {mode_name(heartbeat.mode)}, not land"
            self._go(Stage.TAKEN, why + (f": PX4 says {said}" if said else ""))
        elif self._down_since(view, _SELF_DISARM_NS) and self._errand is None:
            self._errand = Errand(Order(armed=False), _MODE_TRIES)

    def _taken(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if not heartbeat.armed:
            self._go(Stage.READY, "disarmed")

    def _refused(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        """Stay away until asked again; a vehicle our own order has armed late is disarmed."""
        ours = self._halfway(view)
        if heartbeat.armed:
            if not ours and self._errand is None:
                self._go(Stage.TAKEN, "armed by somebody else")
                return
            if view.landed not in (Landed.ON_GROUND, Landed.UNDEFINED):
                self._go(Stage.TAKEN, f"in the air after: {self.why}")
                return
            if self._errand is None:
                self._errand = Errand(Order(armed=False), _ARM_TRIES)
                out.events.append(("disarmed", f"armed halfway, disarmed again: {self.why}"))
        if self._pursue(view, heartbeat, out) == "failed":
            assert self._errand is not None
            out.events.append(("refused", self._errand.refusal))
            self._go(Stage.TAKEN, f"armed, and disarming was refused: {self._errand.refusal}")
        elif not heartbeat.armed and self._may_engage and not ours:
            self._go(Stage.READY, "")

    # --- Helpers ------------------------------------------------------------------------------

    def _halfway(self, view: View) -> bool:
        """Return whether an order of ours to arm may still be carried out."""
        own = self._own_arming_ns
        return own is not None and view.now_ns - own <= _OWN_ARMING_NS

    def _pursue(self, view: View, heartbeat: Heartbeat, out: Decision) -> str:
        """Go on with the errand; return "failed" when it is given up."""
        errand = self._errand
        if errand is None:
            return ""
        before = errand.refusal
        if errand.tick(heartbeat, self.words, view.now_ns):
            out.orders.append(errand.order)
            if errand.order.armed:
                self._own_arming_ns = view.now_ns
            if errand.refusal and errand.refusal != before:
                out.events.append(("refused", f"{errand.refusal}; trying again"))
        if errand.done and errand.order.armed is not True and errand.order.mode != OFFBOARD:
            self._errand = None
        return "failed" if errand.failed else ""

    def _give_up_errand(self, out: Decision) -> None:
        assert self._errand is not None
        why = self._errand.refusal
        self._give_up(why)
        out.events.append(("refused", why))

    def _give_up(self, why: str) -> None:
        self._may_engage = False
        self._go(Stage.REFUSED, why)

    def _go(self, stage: Stage, why: str) -> None:
        self.stage, self.why = stage, why
        self._errand = None
        self._by_own_means = False
        if stage in (Stage.READY, Stage.TAKEN):
            self._armed_for_flight = False
        if stage == Stage.TAKEN:
            self._may_engage = False

    def _watch_ground(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        if view.landed == Landed.ON_GROUND and heartbeat.armed:
            self._landed_since_ns = self._landed_since_ns or view.now_ns
        else:
            self._landed_since_ns = None

    def _down_since(self, view: View, duration_ns: int) -> bool:
        since = self._landed_since_ns
        return since is not None and view.now_ns - since > duration_ns

    def _tell(self, view: View, heartbeat: Heartbeat, out: Decision) -> None:
        """Say what goes out, and what is wrong for as long as it is."""
        mode: Mode = heartbeat.mode
        if self.stage == Stage.FLYING:
            out.stream = Stream.HOLD if view.phase in _GROUND else Stream.SETPOINT
        elif self.stage == Stage.LANDING and mode == OFFBOARD:
            out.stream = Stream.SETPOINT
        elif mode == OFFBOARD and heartbeat.armed:
            out.stream = Stream.HOLD
        if self.stage == Stage.TAKEN and view.phase not in _GROUND:
            out.faults["mode_taken"] = (
                f"{self.why}; not fought: the stream holds the present position until px4/offboard"
            )
        if self.stage == Stage.REFUSED:
            out.faults["given_up"] = (
                f"{self.why}; not tried again before the mission has been on the ground,"
                " or px4/offboard is called"
            )
