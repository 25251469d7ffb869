"""State machine of the bridge: when it streams, arms, changes the mode and lands. Pure.

Four rules. Only HEARTBEAT confirms a state. A mode that another station has chosen is never
changed. The vehicle is armed once for one take-off: after a flight, a lost link or a refusal, the
mission must have been on the ground, or the operator must ask. A flight that has lost something
ends on the ground: PX4 gets the command to land and no more set points. So it can't return to
OFFBOARD, also after its own fail-safe. HEARTBEAT's system status tells a fail-safe from a mode
that somebody has chosen.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from enum import Enum
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.messages import Phase
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.axes_proof import AxesEvidence
from tombo_px4.link import messages
from tombo_px4.link.messages import (
    BatteryReading,
    CommandAck,
    Heartbeat,
    MessageTarget,
    StatusText,
    VehicleImu,
    VehicleOdometry,
)
from tombo_px4.modes import (
    AUTO_HOLD,
    AUTO_LAND,
    AUTO_TAKEOFF,
    FORCE_ARMING,
    OFFBOARD,
    MavLandedState,
    Mode,
    Result,
    Severity,
    mode_name,
)

CONFIRM_NS = 2 * SECOND_NS
"""Longest wait for the heartbeat (1 Hz) that confirms a command."""
PAUSE_NS = SECOND_NS
"""Pause between a refusal and the next attempt; PX4 sends its explanation meanwhile."""


@dataclass(frozen=True)
class VehicleCommand:
    """A mode, or armed or not: one of the two is set."""

    mode: Mode | None = None
    armed: bool | None = None
    force: bool = False
    """Disarms in the air, too."""

    @property
    def command(self) -> int:
        """Number of the MAVLink command."""
        by_mode = self.mode is not None
        return int(mav.MAV_CMD_DO_SET_MODE if by_mode else mav.MAV_CMD_COMPONENT_ARM_DISARM)

    def message(self, target: MessageTarget) -> Any:
        """Return it as a MAVLink message; a mode is acknowledged twice."""
        if self.mode is not None:
            custom = float(mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED)
            values = [custom, float(self.mode.main), float(self.mode.sub)]
        else:
            values = [float(bool(self.armed)), FORCE_ARMING if self.force else 0.0]
        return messages.command(target, self.command, *values)

    def confirmed_by(self, heartbeat: Heartbeat) -> bool:
        """Return whether the heartbeat shows the commanded state."""
        if self.mode is not None:
            return heartbeat.mode == self.mode
        return heartbeat.armed == self.armed

    def __str__(self) -> str:
        if self.mode is not None:
            return f"mode {mode_name(self.mode)}"
        return "arming" if self.armed else "disarming" + (" by force" if self.force else "")


class SessionStage(Enum):
    """State of the session with the vehicle."""

    WAITING = "waiting for the vehicle"
    READY = "ready"
    ENTERING_OFFBOARD = "entering offboard"
    ARMING = "arming"
    FLYING = "offboard"
    LANDING = "landing"
    EXTERNAL_MODE = "mode set by another station"
    GIVEN_UP = "given up"
    LINK_LOST = "link lost"


class SetpointSource(Enum):
    """Which set point is sent."""

    PRESENT = "present"
    """The position that PX4 reports."""
    HOLD = "hold"
    """The position at the begin of the hold."""
    SETPOINT = "setpoint"
    LEVEL_DESCENT = "level descent"
    """Attitude and thrust, by gyro and accelerometer: where the poses are wrong."""
    NONE = "none"
    """No set point: PX4 must not return to OFFBOARD."""


class OperatorRequest(NamedTuple):
    """A request of an operator, a key of `_COMMANDS`."""

    number: int
    kind: str


class Reply(NamedTuple):
    """The answer to a request, once it is known."""

    number: int
    success: bool
    text: str


class SessionInput(NamedTuple):
    """Inputs of one tick."""

    now_ns: int
    heartbeat: Heartbeat | None
    """The last one; None: none ever came."""
    landed: MavLandedState
    phase: int
    """Of the mission; IDLE without one."""
    fresh: bool
    """A set point came lately."""
    streaming: bool
    """A position to stream is known."""
    blockers: tuple[str, ...]
    """Why arming is not allowed, as texts."""
    must_land: str = ""
    """Why the flight must end now, as a text."""
    takeoff_commands: int = 0
    """How often an operator has asked the mission to take off."""
    poses_wrong: bool = False
    """The poses are not those of this vehicle: PX4's own landing would fly away by them."""
    touched: bool = False
    """In a descent by thrust: the ground carries the vehicle."""

    @property
    def beat(self) -> Heartbeat:
        """The last heartbeat, where there is one."""
        assert self.heartbeat is not None
        return self.heartbeat


@dataclass(frozen=True)
class BridgeStatus:
    """State of vehicle and bridge; published at each change."""

    connected: bool = False
    armed: bool = False
    mode: str = ""
    landed: MavLandedState = MavLandedState.UNDEFINED
    stage: SessionStage = SessionStage.WAITING
    why: str = ""
    offboard: bool = False
    ready: bool = False
    findings: tuple[str, ...] = ()
    text: str = ""
    firmware: str = ""


@dataclass
class BridgeOutput:
    """Outputs of one tick: of the session, and of the bridge around it."""

    stream: SetpointSource = SetpointSource.PRESENT
    vehicle_commands: list[VehicleCommand] = field(default_factory=list)
    faults: dict[str, str] = field(default_factory=dict)
    """Key -> what is wrong, for as long as it is."""
    events: list[tuple[str, str]] = field(default_factory=list)
    """Key and text of what went wrong just now."""
    replies: list[Reply] = field(default_factory=list)
    messages: list[Any] = field(default_factory=list)
    """To be sent now."""
    odometry: list[VehicleOdometry] = field(default_factory=list)
    """All with a stamp."""
    imu: list[VehicleImu] = field(default_factory=list)
    battery: list[BatteryReading] = field(default_factory=list)
    texts: list[StatusText] = field(default_factory=list)
    status: BridgeStatus = field(default_factory=BridgeStatus)
    evidence: AxesEvidence | None = None
    """New evidence on the poses' axes: to be kept."""


class RecentStatusTexts(deque[StatusText]):
    """The last warnings of PX4, to explain a refusal."""

    def take(self, text: StatusText) -> None:
        """Keep a text if it is a warning or worse."""
        if text.severity <= Severity.WARNING:
            self.append(text)

    def since(self, time_ns: int) -> str:
        """Return the texts since a time, each once."""
        texts = dict.fromkeys(t.text for t in self if t.arrival_ns >= time_ns)
        return ", ".join(f"'{text}'" for text in texts)


class CommandTransaction:
    """A command in progress. `tick` tells when to send it; `done` or `failed` ends it."""

    def __init__(self, order: VehicleCommand, tries: int) -> None:
        self.order = order
        self.done = False
        self.failed = False
        self.refusal = ""
        """Why PX4 refused it the last time, or did not answer."""
        self._tries = tries
        self._begun_ns = 0
        self._sent_ns: int | None = None
        self._refused_ns: int | None = None
        self._result = int(Result.ACCEPTED)

    def handle_ack(self, ack: CommandAck) -> None:
        """Take an answer. A refusal is final for this attempt; only HEARTBEAT confirms."""
        if ack.command != self.order.command or self._sent_ns is None or self.done:
            return
        if ack.result not in (Result.ACCEPTED, Result.IN_PROGRESS) and self._refused_ns is None:
            self._refused_ns, self._result = ack.arrival_ns, ack.result

    def tick(self, heartbeat: Heartbeat, recent_texts: RecentStatusTexts, now_ns: int) -> bool:
        """Advance; return whether the command is to be sent now."""
        if self._sent_ns is None:  # even if it looks met: the last heartbeat may be a second old
            return self._send(now_ns)
        if self.order.confirmed_by(heartbeat) and heartbeat.arrival_ns > self._begun_ns:
            self.done = True
            return False
        if self._refused_ns is not None:
            if now_ns - self._refused_ns < PAUSE_NS:
                return False
            why = _result_name(self._result)
        elif now_ns - self._sent_ns < CONFIRM_NS:
            return False
        else:
            why = f"not confirmed by HEARTBEAT within {CONFIRM_NS * 1e-9:.0f} s"
        texts = recent_texts.since(self._sent_ns)
        self.refusal = f"{self.order} {why}" + (f": {texts}" if texts else "")
        if self._tries <= 0:
            self.failed = True
            return False
        return self._send(now_ns)

    def _send(self, now_ns: int) -> bool:
        self._tries -= 1
        self._begun_ns = self._begun_ns or now_ns
        self._sent_ns, self._refused_ns = now_ns, None
        return True


def _result_name(result: int) -> str:
    if result in range(Result.CANCELLED + 1):
        return Result(result).name.lower().replace("_", " ")
    return f"result {result}"


_FLIGHT = range(Phase.TAKEOFF, Phase.HOLD + 1)
_DOWN = (Phase.LAND, Phase.DESCEND_BLIND)
_GROUND = (Phase.IDLE, Phase.LANDED)
_ARM, _DISARM = VehicleCommand(armed=True), VehicleCommand(armed=False)
_OFFBOARD, _LAND = VehicleCommand(mode=OFFBOARD), VehicleCommand(mode=AUTO_LAND)
_HOLD = VehicleCommand(mode=AUTO_HOLD)
_KILL = VehicleCommand(armed=False, force=True)
_COMMANDS = {
    "arm": (_ARM,),
    "disarm": (_DISARM,),
    "offboard": (_OFFBOARD,),
    "takeoff": (VehicleCommand(mode=AUTO_TAKEOFF), _ARM),
    "land": (_LAND,),
    "hold": (_HOLD,),
    "kill": (_KILL,),
}
"""Requests of the operator, with their commands in order."""
_MODE_TRIES, _ARM_TRIES, _ASKED_TRIES = 3, 5, 2
_STREAM_FIRST_NS = SECOND_NS
"""PX4 must have received set points for this time before it accepts OFFBOARD."""
_LATE_ARMING_NS = 5 * SECOND_NS
"""A vehicle that arms within this time after our command was armed by it."""
_SELF_DISARM_NS = 4 * SECOND_NS
"""PX4 disarms 2 s after landing (COM_DISARM_LAND); after this the bridge disarms it."""
_TEXT_NS = 3 * SECOND_NS
"""Texts of this age still explain what has happened."""
_GRACE_NS = 3 * SECOND_NS
"""Vehicle and bridge start in any order."""
_QUIET_NS = SECOND_NS
"""PX4 has lost our set points too (COM_OF_LOSS_T) if a heartbeat asked for four times a second
is so late: it gets none before the next heartbeat has shown what it flies."""
_LEVEL_DESCENT_NS = 20 * SECOND_NS
"""A descent without positions that has not ended by then becomes PX4's own landing."""
_ON_GROUND = "the vehicle is on the ground"
_LAND_AGAIN_NS = 2 * SECOND_NS
"""A landing that PX4 refuses is commanded again after this time."""


class Session:
    """The state machine; `tick` decides."""

    def __init__(self, link_timeout_s: float) -> None:
        self.stage = SessionStage.WAITING
        self.why = ""
        """Why it is in this state."""
        self.recent_texts = RecentStatusTexts(maxlen=8)
        self._timeout_ns = round(link_timeout_s * SECOND_NS)
        self._transaction: CommandTransaction | None = None
        self._engage_allowed = self._mission_seen = False
        self._commands_flown = -1
        """The operator's, when it last armed; -1: it has not armed."""
        self._arm_request_ns: int | None = None
        self._armed_for_flight = False
        self._stream_since_ns: int | None = None
        self._landed_since_ns: int | None = None
        self._begun_ns: int | None = None
        self._stage_before_loss = SessionStage.WAITING
        self._landing_by_setpoints = False
        self._flight_lost = False
        """The flight ends here: set points are never sent again before the next take-off."""
        self._ours = False
        """An external mode that our operator has asked for."""
        self._land_again_ns = 0
        self._descended_level = False
        """A descent by thrust was begun in this flight."""
        self._level_descent_ns: int | None = None
        """When a descent without positions began; None: there is none."""
        self._landing_from: Mode | None = None
        """Mode that was flown when a landing was commanded, until that is confirmed."""
        self._ticked_ns: int | None = None
        self._out = BridgeOutput()
        """Of the present tick."""
        self._requests = 0
        self._pending_requests: deque[OperatorRequest] = deque()
        self._request: OperatorRequest | None = None
        self._request_transaction: CommandTransaction | None = None
        self._request_orders: tuple[VehicleCommand, ...] = ()
        """Commands after the present one."""

    @property
    def awaits_confirmation(self) -> bool:
        """A command was sent and is not yet confirmed by a heartbeat."""
        return self._transaction is not None or self._request_transaction is not None

    def request(self, kind: str) -> int:
        """Take a request; the answer, with its number, is in a later `BridgeOutput.replies`."""
        self._requests += 1
        self._pending_requests.append(OperatorRequest(self._requests, kind))
        return self._requests

    def handle_ack(self, ack: CommandAck) -> None:
        """Take PX4's answer to a command."""
        for transaction in (self._transaction, self._request_transaction):
            if transaction is not None:
                transaction.handle_ack(ack)

    def clock_set_back(self, out: BridgeOutput) -> None:
        """Restart all time-outs, because the clock was set back."""
        why = "the system's clock was set back meanwhile"
        self._out = out
        self._drop_requests(why)
        self._stream_since_ns = self._landed_since_ns = self._arm_request_ns = None
        self._ticked_ns, self._land_again_ns = None, 0
        if self.stage in (SessionStage.ENTERING_OFFBOARD, SessionStage.ARMING):
            self._give_up(why)
        elif self._transaction is not None:
            self._order(self._transaction.order)

    def tick(self, view: SessionInput, out: BridgeOutput) -> None:
        """Decide; the result is added to `out`."""
        self._out = out
        self._stream_since_ns = (self._stream_since_ns or view.now_ns) if view.streaming else None
        stopped_s = (view.now_ns - (self._ticked_ns or view.now_ns)) * 1e-9
        self._ticked_ns = view.now_ns
        if view.heartbeat is None or view.now_ns - view.beat.arrival_ns > self._timeout_ns:
            self._on_link_down(view)
            return
        if self.stage in (SessionStage.WAITING, SessionStage.LINK_LOST):
            self._on_link_up(view)
        if not view.beat.armed:
            self._flight_lost = self._descended_level = False
        self._end_lost_flight(view, stopped_s)
        if view.fresh:
            self._update_mission(view)
        stands = view.landed == MavLandedState.ON_GROUND and view.beat.armed
        self._landed_since_ns = (self._landed_since_ns or view.now_ns) if stands else None
        self._handle_requests(view)
        if self._request is None:
            self._advance(view)
        self._set_stream_and_faults(view)

    def _update_mission(self, view: SessionInput) -> None:
        """Allow arming when the mission is on the ground, or when it is received first.

        Its first messages may be lost while the nodes find each other. After a flight it takes an
        operator's command: a mission that was restarted shows the ground too.
        """
        begins = view.phase == Phase.TAKEOFF and not self._mission_seen
        self._mission_seen = True
        if view.phase == Phase.IDLE:  # a mission that was restarted counts from 0
            self._commands_flown = min(self._commands_flown, view.takeoff_commands)
        commanded = view.takeoff_commands > self._commands_flown
        if not view.beat.armed and commanded and (begins or view.phase in _GROUND):
            self._engage_allowed = True

    # --- The link -----------------------------------------------------------------------------

    def _on_link_down(self, view: SessionInput) -> None:
        if self.stage not in (SessionStage.WAITING, SessionStage.LINK_LOST):
            self._stage_before_loss = self.stage
            self._set_stage(SessionStage.LINK_LOST, "")
        last = view.heartbeat
        if last is None:
            text = "no heartbeat of the vehicle: is it on, and does it send here?"
            self._begun_ns = self._begun_ns or view.now_ns
            if view.now_ns - self._begun_ns > _GRACE_NS:
                self._out.faults["no_vehicle"] = text
        else:
            age = (view.now_ns - last.arrival_ns) * 1e-9
            armed = "armed, " if last.armed else ""
            text = f"no heartbeat for {age:.1f} s, last {armed}mode {mode_name(last.mode)}"
            self._out.faults["link_lost"] = f"{text}: nothing is armed when it comes back"
        if any(request.kind == "kill" for request in self._pending_requests):
            self._out.vehicle_commands.append(_KILL)  # it may still arrive
        self._drop_requests(text)
        self._out.stream = SetpointSource.NONE

    def _on_link_up(self, view: SessionInput) -> None:
        """A vehicle is there, for the first time or again."""
        lost, self._stage_before_loss = self._stage_before_loss, SessionStage.WAITING
        if view.beat.armed:
            ours = view.beat.mode == OFFBOARD or view.beat.failsafe
            if lost == SessionStage.LANDING and view.beat.mode == AUTO_LAND:
                self._set_stage(lost, "link is back")
            elif lost in (SessionStage.FLYING, SessionStage.LANDING) and ours:
                self._land(view, "the link was lost in flight")
            elif lost == SessionStage.WAITING and view.beat.mode == OFFBOARD:
                why = "found armed in mode offboard, which a bridge before this one has flown"
                self._land(view, why)
            else:
                mode = mode_name(view.beat.mode)
                self._set_stage(SessionStage.EXTERNAL_MODE, f"found armed in mode {mode}")
        elif lost in (SessionStage.WAITING, SessionStage.READY, SessionStage.GIVEN_UP):
            self._set_stage(SessionStage.READY, "")
        else:
            self._give_up("disarmed while the link was lost")

    # --- A flight that has to end -------------------------------------------------------------

    def _end_lost_flight(self, view: SessionInput, stopped_s: float) -> None:
        """Land a vehicle that flies by us if PX4's fail-safe, the caller or a gap asks for it."""
        ours = self.stage in (SessionStage.FLYING, SessionStage.LANDING) or self._ours
        by_setpoints = self.stage == SessionStage.EXTERNAL_MODE and view.beat.mode == OFFBOARD
        if not view.beat.armed or not (ours or by_setpoints):
            return
        if self._flight_lost:
            if view.poses_wrong and not self._descended_level:
                self._begin_level_descent(view)
            return
        if view.beat.failsafe:
            chosen = f"PX4's fail-safe has chosen mode {mode_name(view.beat.mode)}"
            why = "the rotors were switched off" if view.beat.killed else chosen
            self._land(view, why + self._px4_texts(view, ": "))
        elif view.must_land:
            self._land(view, view.must_land)
            if view.poses_wrong:
                self._begin_level_descent(view)
        elif stopped_s * SECOND_NS > self._timeout_ns:
            self._land(view, f"this bridge was stopped for {stopped_s:.1f} s")

    def _begin_level_descent(self, view: SessionInput) -> None:
        """Descend by thrust: PX4's own landing would follow the poses."""
        self._descended_level, self._level_descent_ns = True, view.now_ns
        self._order(_OFFBOARD)

    def _land(self, view: SessionInput, why: str) -> None:
        """End the flight: PX4 lands, and gets no set point any more."""
        if self._request is not None and self._request.kind not in ("kill", "disarm", "land"):
            self._reply(False, f"the flight ends: {why}")
        self._out.events.append(("landing", why))
        self._set_stage(SessionStage.LANDING, why)
        self._flight_lost, self._engage_allowed = True, False
        self._landing_from = view.beat.mode
        self._order(_LAND)

    # --- The operator -------------------------------------------------------------------------

    def _handle_requests(self, view: SessionInput) -> None:
        """Begin, continue or answer the requests of the operator."""
        while self._pending_requests:
            request = self._pending_requests.popleft()
            if self._request is not None:
                self._reply(False, f"overtaken by '{request.kind}'")
            self._begin_request(request, view)
        transaction = self._request_transaction
        if self._request is None or transaction is None:
            return
        self._tick_transaction(transaction, view)
        if transaction.failed and transaction.order == _HOLD and view.streaming:
            if view.landed == MavLandedState.ON_GROUND:
                self._reply(False, _ON_GROUND)
            else:  # without a global position PX4 has no hold of its own
                self._begin_order((_OFFBOARD,))
        elif transaction.failed:
            self._reply(False, transaction.refusal)
        elif transaction.done and self._request_orders:
            self._begin_order(self._request_orders)
        elif transaction.done:
            self._request_confirmed(view)

    def _begin_order(self, orders: tuple[VehicleCommand, ...]) -> None:
        tries = 1 if orders[0] == _HOLD else _ASKED_TRIES
        self._request_transaction = CommandTransaction(orders[0], tries)
        self._request_orders = orders[1:]

    def _begin_request(self, request: OperatorRequest, view: SessionInput) -> None:
        self._request = request
        kind = request.kind
        why_not = ""
        if kind == "takeoff" and view.beat.armed:
            why_not = "the vehicle is armed already"
        elif kind in ("arm", "takeoff") and not view.beat.armed:
            why_not = "; ".join(view.blockers)
        elif kind in ("land", "hold") and not view.beat.armed:
            why_not = "the vehicle is not armed"
        elif kind == "hold" and view.landed == MavLandedState.ON_GROUND:
            why_not = _ON_GROUND
        elif kind in ("hold", "offboard") and self._flight_lost:
            why_not = f"the flight ends: {self.why}"
        elif kind == "offboard" and not view.streaming:
            why_not = "PX4 gives no position: there is nothing to stream, and it would refuse"
        elif kind == "offboard" and view.beat.armed and not view.fresh:
            why_not = "no set point of the mission comes: there is nothing to follow"
        if why_not:
            self._reply(False, why_not)
            return
        under_way = self.stage in (SessionStage.ENTERING_OFFBOARD, SessionStage.ARMING)
        if kind not in ("arm", "offboard") and under_way:
            self._give_up(f"stopped by the operator: {kind}")
        if kind == "hold":  # at once: the place where it is goes out meanwhile
            self._set_stage(SessionStage.EXTERNAL_MODE, "hold, asked by the operator")
            self._ours = True
        self._begin_order(_COMMANDS[kind])

    def _request_confirmed(self, view: SessionInput) -> None:
        assert self._request is not None
        kind = self._request.kind
        by_setpoints = kind == "hold" and view.beat.mode == OFFBOARD
        by = ": PX4 refuses its own mode, set points hold it" if by_setpoints else ""
        self._reply(True, f"{kind}: confirmed{by}")
        if kind == "offboard":
            self._engage_allowed = True
            stage = SessionStage.FLYING if view.beat.armed else SessionStage.READY
            self._set_stage(stage, "asked by the operator")
        elif kind == "land":
            self._set_stage(SessionStage.LANDING, "asked by the operator")
        elif kind == "takeoff":
            self._set_stage(SessionStage.EXTERNAL_MODE, "take-off, asked by the operator")
            self._ours = True
        elif kind == "arm" and self.stage not in (SessionStage.FLYING, SessionStage.LANDING):
            self._arm_request_ns = None
            self._armed_for_flight = False
            stage = (
                SessionStage.FLYING if view.beat.mode == OFFBOARD else SessionStage.EXTERNAL_MODE
            )
            self._set_stage(stage, "armed by the operator")
        elif kind in ("disarm", "kill"):
            self._engage_allowed = False
            self._set_stage(SessionStage.READY, "disarmed by the operator")

    def _reply(self, success: bool, text: str) -> None:
        assert self._request is not None
        self._out.replies.append(Reply(self._request.number, success, text))
        self._request = self._request_transaction = None
        self._request_orders = ()

    def _drop_requests(self, text: str) -> None:
        if self._request is not None:
            self._reply(False, text)
        while self._pending_requests:
            self._out.replies.append(Reply(self._pending_requests.popleft().number, False, text))

    # --- The flight ---------------------------------------------------------------------------

    def _advance(self, view: SessionInput) -> None:
        steps = {
            SessionStage.READY: self._ready,
            SessionStage.ENTERING_OFFBOARD: self._entering,
            SessionStage.ARMING: self._arming,
            SessionStage.FLYING: self._flying,
            SessionStage.LANDING: self._landing,
            SessionStage.EXTERNAL_MODE: self._external_mode,
            SessionStage.GIVEN_UP: self._given_up,
        }
        steps[self.stage](view)

    def _wants_flight(self, view: SessionInput) -> bool:
        return view.fresh and view.phase in _FLIGHT

    def _ready(self, view: SessionInput) -> None:
        if view.beat.armed and self._arm_request_pending(view):
            self._give_up("armed after it was called off")
            return
        if view.beat.armed:
            mode = mode_name(view.beat.mode)
            self._set_stage(SessionStage.EXTERNAL_MODE, f"armed by somebody else, in mode {mode}")
            return
        if not self._wants_flight(view):
            return
        if view.phase != Phase.TAKEOFF:
            self._out.faults["not_engaged"] = (
                "the mission believes to be in the air: land it (/mission/land) and start it again"
            )
        elif not self._engage_allowed:
            self._out.faults["not_engaged"] = (
                "the mission wants to fly, but after the last flight it was not seen on the"
                " ground, or nobody has asked for it: start it again (/mission/takeoff), or call"
                " px4/offboard"
            )
        elif view.blockers:
            self._out.faults["preflight"] = "not armed: " + "; ".join(view.blockers)
        elif self._stream_since_ns and view.now_ns - self._stream_since_ns >= _STREAM_FIRST_NS:
            self._set_stage(SessionStage.ENTERING_OFFBOARD, "")
            self._order(_OFFBOARD)
            self._entering(view)

    def _entering(self, view: SessionInput) -> None:
        if view.beat.armed:
            self._set_stage(SessionStage.EXTERNAL_MODE, "armed by somebody else")
        elif not self._wants_flight(view):
            self._set_stage(SessionStage.READY, "the mission takes it back")
        elif view.blockers:
            self._set_stage(SessionStage.READY, "")
        elif refusal := self._step_transaction(view):
            self._give_up(refusal)
        elif self._transaction is not None and self._transaction.done:
            self._set_stage(SessionStage.ARMING, "")
            self._order(_ARM, _ARM_TRIES)
            self._arming(view)

    def _arming(self, view: SessionInput) -> None:
        if view.beat.mode != OFFBOARD:
            mode = mode_name(view.beat.mode)
            self._give_up(f"mode changed to {mode} while arming{self._px4_texts(view, ': ')}")
            self._out.events.append(("refused", self.why))
        elif not view.beat.armed and not self._wants_flight(view):
            self._give_up("the mission took it back while arming")
        elif not view.beat.armed and view.blockers:
            self._give_up("while arming: " + "; ".join(view.blockers))
            self._out.events.append(("refused", self.why))
        elif refusal := self._step_transaction(view):
            self._give_up(refusal)
        elif self._transaction is not None and self._transaction.done:
            self._engage_allowed = False
            self._armed_for_flight = True
            self._commands_flown = view.takeoff_commands
            self._arm_request_ns = None
            self._set_stage(SessionStage.FLYING, "")

    def _flying(self, view: SessionInput) -> None:
        if not view.beat.armed:
            if view.phase in _FLIGHT:
                self._give_up(f"disarmed in flight{self._px4_texts(view, ': ')}")
                self._out.events.append(("disarmed", self.why))
            else:
                self._set_stage(SessionStage.READY, "landed")
        elif view.beat.mode != OFFBOARD:
            self._mode_taken(view, "offboard")
        elif view.phase in _DOWN or (
            view.phase == Phase.LANDED and view.landed != MavLandedState.ON_GROUND
        ):
            self._set_stage(SessionStage.LANDING, "")
            self._order(_LAND)
            self._landing(view)
        elif (
            view.phase in _GROUND
            and view.landed == MavLandedState.ON_GROUND
            and self._armed_for_flight
            and self._transaction is None
        ):
            self._order(_DISARM)
        elif view.phase in _FLIGHT:
            self._transaction = None
        if self.stage == SessionStage.FLYING:
            self._step_transaction(view)

    def _landing(self, view: SessionInput) -> None:
        if not view.beat.armed:
            self._set_stage(SessionStage.READY, "landed")
            return
        if self._level_descent_ns is not None:
            self._descend_level(view, self._level_descent_ns)
            return
        if self._step_transaction(view):
            self._landing_by_setpoints = not self._flight_lost
            self._land_again_ns = view.now_ns + _LAND_AGAIN_NS
        lands = view.beat.mode == AUTO_LAND
        if lands:
            self._landing_by_setpoints, self._landing_from = False, None
        under_way = self._transaction is not None or self._landing_by_setpoints
        still_ours = view.beat.failsafe or view.beat.mode in (OFFBOARD, self._landing_from)
        if not lands and not ((under_way or self._flight_lost) and still_ours):
            self._mode_taken(view, "land")
        elif not lands and not under_way:
            if view.now_ns >= self._land_again_ns:
                self._order(_LAND)
        else:
            self._disarm_on_ground(view)

    def _descend_level(self, view: SessionInput, since_ns: int) -> None:
        """Come down by thrust in OFFBOARD; switch the rotors off on the ground."""
        if view.touched and (self._transaction is None or self._transaction.order != _KILL):
            self._order(_KILL)
        command = self._transaction
        entering = command is not None and command.order == _OFFBOARD and not command.done
        taken = view.beat.mode != OFFBOARD and not entering
        refused = self._step_transaction(view)
        if refused or taken or view.now_ns - since_ns > _LEVEL_DESCENT_NS:
            if taken and not view.beat.failsafe and not refused:
                self._mode_taken(view, "offboard")
                return
            self._level_descent_ns = None
            self._order(_LAND)

    def _disarm_on_ground(self, view: SessionInput) -> None:
        since_ns = view.now_ns if self._landed_since_ns is None else self._landed_since_ns
        if view.now_ns - since_ns > _SELF_DISARM_NS and self._transaction is None:
            self._order(_DISARM)

    def _external_mode(self, view: SessionInput) -> None:
        if not view.beat.armed:
            self._set_stage(SessionStage.READY, "disarmed")
            return
        if self._ours and view.beat.mode == OFFBOARD:  # PX4 itself does not end a hold
            self._disarm_on_ground(view)
        self._step_transaction(view)

    def _given_up(self, view: SessionInput) -> None:
        """Do nothing until asked again; a vehicle that our command has armed late is disarmed."""
        ours = self._arm_request_pending(view)
        if view.beat.armed:
            if not ours and self._transaction is None:
                self._set_stage(SessionStage.EXTERNAL_MODE, "armed by somebody else")
                return
            if view.landed not in (MavLandedState.ON_GROUND, MavLandedState.UNDEFINED):
                self._set_stage(SessionStage.EXTERNAL_MODE, f"in the air after: {self.why}")
                return
            if self._transaction is None:
                self._order(_DISARM, _ARM_TRIES)
                self._out.events.append(("disarmed", f"armed halfway, disarmed again: {self.why}"))
        if refusal := self._step_transaction(view):
            self._set_stage(
                SessionStage.EXTERNAL_MODE, f"armed, and disarming was refused: {refusal}"
            )
        elif not view.beat.armed and self._engage_allowed and not ours:
            self._set_stage(SessionStage.READY, "")

    # --- Helpers ------------------------------------------------------------------------------

    def _px4_texts(self, view: SessionInput, before: str) -> str:
        """Return PX4's last texts behind `before`; "" without any."""
        texts = self.recent_texts.since(view.now_ns - _TEXT_NS)
        return before + texts if texts else ""

    def _mode_taken(self, view: SessionInput, wanted: str) -> None:
        why = f"mode is {mode_name(view.beat.mode)}, not {wanted}"
        self._set_stage(SessionStage.EXTERNAL_MODE, why + self._px4_texts(view, ": PX4 says "))

    def _arm_request_pending(self, view: SessionInput) -> bool:
        """Return whether PX4 may still carry out our command to arm."""
        asked_ns = self._arm_request_ns
        return asked_ns is not None and view.now_ns - asked_ns <= _LATE_ARMING_NS

    def _step_transaction(self, view: SessionInput) -> str:
        """Continue the command in progress; return why it is given up, "" if it is not."""
        transaction = self._transaction
        if transaction is None:
            return ""
        before = transaction.refusal
        self._tick_transaction(transaction, view)
        if transaction.failed:
            self._transaction = None
            self._out.events.append(("refused", transaction.refusal))
            return transaction.refusal
        if transaction.refusal not in ("", before):
            self._out.events.append(("refused", f"{transaction.refusal}; trying again"))
        if transaction.done and transaction.order not in (_ARM, _OFFBOARD):
            self._transaction = None
        return ""

    def _tick_transaction(self, transaction: CommandTransaction, view: SessionInput) -> None:
        if transaction.tick(view.beat, self.recent_texts, view.now_ns):
            self._out.vehicle_commands.append(transaction.order)
            if transaction.order.armed:
                self._arm_request_ns = view.now_ns

    def _order(self, command: VehicleCommand, tries: int = _MODE_TRIES) -> None:
        """Begin a command of the session, in place of the one under way."""
        self._transaction = CommandTransaction(command, tries)

    def _give_up(self, why: str) -> None:
        self._engage_allowed = False
        self._set_stage(SessionStage.GIVEN_UP, why)

    def _set_stage(self, stage: SessionStage, why: str) -> None:
        self.stage, self.why = stage, why
        self._transaction = None
        self._landing_by_setpoints = self._ours = False
        self._landing_from = self._level_descent_ns = None
        if stage in (SessionStage.READY, SessionStage.EXTERNAL_MODE):
            self._armed_for_flight = False
        if stage == SessionStage.EXTERNAL_MODE:
            self._engage_allowed = False

    def _set_stream_and_faults(self, view: SessionInput) -> None:
        """Set which set point is sent, and the faults that are active."""
        mode: Mode = view.beat.mode
        if self.stage == SessionStage.FLYING:
            self._out.stream = (
                SetpointSource.HOLD if view.phase in _GROUND else SetpointSource.SETPOINT
            )
        elif self.stage == SessionStage.LANDING and mode == OFFBOARD:
            self._out.stream = SetpointSource.SETPOINT
        elif mode == OFFBOARD and view.beat.armed:
            self._out.stream = SetpointSource.HOLD
        quiet = view.now_ns - view.beat.arrival_ns > _QUIET_NS
        if view.beat.armed and (self._flight_lost or view.beat.failsafe or quiet):
            self._out.stream = SetpointSource.NONE
        if view.beat.armed and self._level_descent_ns is not None:
            self._out.stream = SetpointSource.LEVEL_DESCENT
        if self._flight_lost:
            self._out.faults["flight_lost"] = (
                f"{self.why}: the vehicle lands; nothing flies again before /mission/takeoff"
            )
        if self.stage == SessionStage.EXTERNAL_MODE and view.phase not in _GROUND:
            self._out.faults["mode_taken"] = (
                f"{self.why}; not fought: the stream holds the present position until px4/offboard"
            )
        if self.stage == SessionStage.GIVEN_UP:
            self._out.faults["given_up"] = (
                f"{self.why}; not tried again before the mission has been on the ground,"
                " or px4/offboard is called"
            )
