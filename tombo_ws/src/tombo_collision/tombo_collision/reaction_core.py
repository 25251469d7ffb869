"""The reaction in line between mission and controller: which set point goes on.

Without a collision it is the mission's, unchanged. After one it is x_r, at once, until the mission
flies there itself. Where mission or detector fall silent, the vehicle holds where it is; where
they stay silent, so does the reaction, and the controller lands. What x_r is decides one of
`tombo_collision.reactions`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from typing import Any, ClassVar

from tombo_collision.decision import Decision, Estimate, Guided, check_decision, check_reference
from tombo_collision.params import ReactionLimits
from tombo_collision.reactions import DEFAULT, EVENT_TOPICS, REGISTRY, Reaction
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS, ERROR, Compiled, Core, Output
from tombo_dynamics.errors import InputError, problem_in, unknown_name
from tombo_dynamics.frames import is_map
from tombo_dynamics.input_check import is_future
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import (
    CollisionEventRecord,
    OdometryRecord,
    PositionSetpointRecord,
    ReactionStatusRecord,
)
from tombo_dynamics.messages import (
    CollisionEvent,
    DetectorStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionPhase,
    ReactionStatus,
    Reason,
    RecoveryMode,
)
from tombo_dynamics.records import Record, field, fill_record, parameter_record
from tombo_dynamics.rotation import rotate_vector


class HoldReason(Reason):
    """Why the reaction holds the vehicle where it is."""

    NONE = 0
    DETECTOR_SILENT = 1, "no message from the detector though poses come: holding"
    MISSION_SILENT = 2, "no set points of the mission: holding"
    TWO_PUBLISHERS = 3, "two nodes publish what only one may: holding"


class EventRefusal(Reason):
    """Why a collision is not reacted to. WAITS: until the mission's first set point."""

    NONE = 0
    NOT_FINITE = 1, "a collision with NaN or infinity"
    NOT_UNIT = 2, "a collision whose flight direction is no unit vector"
    STALE = 3, "a collision of long ago"
    FUTURE = 4, "a collision stamped in the future"
    DUPLICATE = 5
    ELSEWHERE = 6, "a collision far from the vehicle"
    NOT_FLYING = 7, "a collision while not flying"
    WAITS = 8
    WRONG_FRAME = 9, "a collision whose frame is not map"


_EXCLUSIVE = ("/mission/setpoint", "/collision_event", "/detector/status")
"""Topics that only one may publish."""
_PERIOD_NS = 20_000_000
"""Own set points are published at 50 Hz."""
_MAX_CONTACT_DISTANCE = 3.0
"""m: a contact further away than this is not the vehicle's."""
_SAME_POSITION = 0.05
"""m: a set point this near to x_r is x_r."""
_STAMPS, _MAX_PENDING = 16, 4
_SAME_CONTACT_NS = 400_000_000
"""Two triggers that place a contact nearer together than this have seen the same one."""


class ReactionMemory(Record):
    """Memory of the reaction's core. Positions and directions in map."""

    active = field("1", "a decision holds", kind=bool)
    guides = field("1", "its reference is the set point", kind=bool)
    takes_contacts = field("1", "collisions seen in the IMU count", kind=bool)
    recovers = field("1", "the controller is to fly with the recovery's gains", kind=bool)
    reference = field("", "of the decision", kind=PositionSetpointRecord)
    reference_ns = field("ns", "when it was asked for", kind=int)
    contact_ns = field("ns", "when the last collision decided on touched", kind=int)
    trigger = field("1", "what has seen it, a `Trigger`", kind=int)
    x_c = field("m", "of the last decision: base_link at contact", 3)
    n_r = field("1", "unit vector from x_c to x_r", 3)
    x_r = field("m", "of the last decision: where to hold", 3)
    collisions = field("1", "decided on", kind=int)
    has_mission = field("1", "a set point of the mission has come", kind=bool)
    mission = field("", "its last set point", kind=PositionSetpointRecord)
    mission_ns = field("ns", "when it came, as in the next three", kind=int)
    odometry_ns = field("ns", "the last estimate", kind=int)
    velocity = field("m/s", "the estimate, base_link", 3)
    attitude = field("1", "the estimate, quaternion xyzw", 4)
    rates = field("rad/s", "the estimate, base_link", 3)
    mocap_ns = field("ns", "the last pose", kind=int)
    detector_ns = field("ns", "the last word of the detector", kind=int)
    has_position = field("1", "an estimate has come", kind=bool)
    position = field("m", "the estimate", 3)
    mission_at_x_r = field("1", "the mission has come to x_r itself", kind=bool)
    two_publishers = field("1", "two publish what only one may", kind=bool)
    holds = field("1", "it holds", kind=bool)
    waits = field("1", "a set point of its own stands for one that is missing", kind=bool)
    waits_since_ns = field("ns", "since when", kind=int)
    hold = field("", "where it holds", kind=PositionSetpointRecord)
    setpoint = field("", "the last one published", kind=PositionSetpointRecord)
    publishes = field("1", "it is of the last step", kind=bool)
    said = field("1", "there was one", kind=bool)
    publish_due = field("1", "one is to be published at the next step", kind=bool)
    now_ns = field("ns", "of the last step", kind=int)
    stamps = field("ns", "of the last events: a ring", _STAMPS, int)
    events = field("1", "entered into it", kind=int)
    pending = field("1", "events that wait for the mission's first set point", kind=int)
    why = field("1", "a `HoldReason`", kind=int)
    status = field("", "the last one published", kind=ReactionStatusRecord)
    changed = field("1", "the decision is another one than in it", kind=bool)
    status_due = field("1", "it is of the last step", kind=bool)


@compiled(inline=False)
def begin_reaction(memory: ReactionMemory) -> None:
    """Forget everything but what was published."""
    memory.active = False
    memory.guides = False
    memory.collisions = 0
    memory.contact_ns = -_SAME_CONTACT_NS
    memory.changed = True
    memory.has_mission = False
    memory.has_position = False
    memory.mission_ns = 0
    memory.odometry_ns = 0
    memory.mocap_ns = 0
    memory.detector_ns = 0
    memory.mission_at_x_r = True
    memory.two_publishers = False
    memory.holds = False
    memory.waits = False
    memory.said = False
    memory.publish_due = False
    memory.setpoint.stamp_ns = 0
    memory.now_ns = 0
    memory.events = 0
    memory.pending = 0


@compiled(inline=False)
def take_mission_setpoint(memory: ReactionMemory, setpoint: Any, now_ns: int) -> bool:
    """Take the mission's set point; False: not finite or of no known phase, not taken."""
    total = setpoint.yaw
    for i in range(3):
        total += setpoint.position[i] + setpoint.velocity[i] + setpoint.acceleration[i]
    if not math.isfinite(total) or not 0 <= setpoint.phase <= Phase.LANDED:
        return False
    memory.mission = setpoint
    memory.has_mission = True
    memory.publish_due = True
    memory.mission_ns = now_ns
    return True


@compiled(inline=False)
def take_estimate(memory: ReactionMemory, odometry: Any, now_ns: int) -> bool:
    """Take an estimate; False: its position is not finite, not taken."""
    position = odometry.position
    if not math.isfinite(position[0] + position[1] + position[2]):
        return False
    memory.position = position
    memory.velocity = odometry.velocity
    memory.attitude = odometry.attitude
    memory.rates = odometry.rates
    memory.has_position = True
    memory.odometry_ns = now_ns
    return True


@compiled(inline=False)
def note_mocap(memory: ReactionMemory, limits: ReactionLimits, now_ns: int) -> None:
    """Take note of a pose: the detector has something to look at."""
    if now_ns - memory.mocap_ns > limits.pose_timeout * 1e9:
        memory.detector_ns = max(memory.detector_ns, now_ns)  # its time begins now
    memory.mocap_ns = now_ns


@compiled(inline=False)
def check_event(
    memory: ReactionMemory, limits: ReactionLimits, event: Any, now_ns: int
) -> EventRefusal:
    """Return whether a collision is to be reacted to: an `EventRefusal`."""
    for i in range(min(memory.events, _STAMPS)):
        if memory.stamps[i] == event.stamp_ns:
            return EventRefusal.DUPLICATE
    memory.stamps[memory.events % _STAMPS] = event.stamp_ns
    memory.events += 1
    apart = abs(event.contact_stamp_ns - memory.contact_ns)
    if event.trigger != memory.trigger and apart < _SAME_CONTACT_NS:
        return EventRefusal.DUPLICATE
    x, d = event.contact_position, event.flight_direction
    if not math.isfinite(x[0] + x[1] + x[2] + d[0] + d[1] + d[2]):
        return EventRefusal.NOT_FINITE
    if abs(math.sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) - 1.0) > 0.1:
        return EventRefusal.NOT_UNIT
    if now_ns - event.stamp_ns > limits.event_age * 1e9:
        return EventRefusal.STALE
    if is_future(event.stamp_ns, now_ns):
        return EventRefusal.FUTURE
    if not memory.has_mission:  # started in flight: it is a matter of milliseconds
        memory.events -= 1
        return EventRefusal.WAITS
    if memory.mission.phase == Phase.IDLE or memory.mission.phase >= Phase.LAND:
        return EventRefusal.NOT_FLYING
    if memory.has_position:
        square = 0.0
        for i in range(3):
            square += (x[i] - memory.position[i]) * (x[i] - memory.position[i])
        if square > _MAX_CONTACT_DISTANCE * _MAX_CONTACT_DISTANCE:
            return EventRefusal.ELSEWHERE
    return EventRefusal.NONE


@compiled(inline=False)
def reaction_step(memory: ReactionMemory, limits: ReactionLimits, now_ns: int) -> None:
    """Decide; `publishes` and `status_due` say whether `setpoint` and `status` are new.

    The caller begins a new flight (`begin_reaction`) when the clock was set back, and takes events
    that wait (`check_event`), before.
    """
    memory.now_ns = now_ns
    memory.publishes = False
    memory.status_due = False
    if not memory.has_mission:
        if memory.status.stamp_ns == 0:  # the first one
            _fill_status(memory, ReactionPhase.IDLE, now_ns)
        return
    mission = memory.mission
    if mission.phase == Phase.LANDED and memory.active:
        memory.active = False
        memory.changed = True
    elif mission.phase == Phase.IDLE and memory.collisions > 0:
        memory.active = False
        memory.collisions = 0
        memory.changed = True
    mission_timed_out = now_ns - memory.mission_ns > limits.mission_timeout * 1e9
    why: int = HoldReason.NONE
    own = True
    if memory.active and memory.guides:
        memory.holds = False
        out = memory.reference
    elif memory.active and _holds_x_r(memory, mission_timed_out):
        memory.holds = False
        out = memory.hold
        _hold_at(out, memory.x_r, mission.yaw, Phase.REACT)
    else:
        why = _reason_to_hold(memory, limits, mission_timed_out, now_ns)
        out = memory.hold
        if why == HoldReason.NONE or _on_ground(mission.phase):
            memory.holds = False
            own = False
            out = mission
        elif not memory.holds:
            memory.holds = True
            old = now_ns - memory.odometry_ns > limits.pose_timeout * 1e9
            if memory.has_position and not old:
                _hold_at(out, memory.position, mission.yaw, Phase.HOLD)
            elif memory.said:
                _hold_at(out, memory.setpoint.position, mission.yaw, Phase.HOLD)
            else:
                _hold_at(out, mission.position, mission.yaw, Phase.HOLD)
    _report(memory, limits, why, now_ns)
    waits = own and (mission_timed_out or why != HoldReason.NONE)
    if waits and not memory.waits:
        memory.waits_since_ns = now_ns
    memory.waits = waits
    if waits and now_ns - memory.waits_since_ns > limits.hold_time * 1e9:
        memory.publish_due = False
        return
    if memory.publish_due or (own and now_ns - memory.setpoint.stamp_ns >= _PERIOD_NS):
        memory.setpoint = out
        memory.setpoint.stamp_ns = now_ns
        memory.setpoint.recovery = _recovery_mode(memory)
        memory.setpoint.takeoff_commands = mission.takeoff_commands
        memory.publish_due = False
        memory.publishes = True
        memory.said = True


@compiled(inline=False)
def reference_due(memory: ReactionMemory, now_ns: int) -> bool:
    """Return whether the decision is to be asked for its reference before the next step."""
    return bool(memory.active and memory.guides and now_ns - memory.reference_ns >= _PERIOD_NS)


@compiled(inline=False)
def _recovery_mode(memory: ReactionMemory) -> RecoveryMode:
    """Return what the controller is asked to do, a `RecoveryMode`."""
    phase = memory.mission.phase
    if not memory.recovers or phase == Phase.IDLE or phase >= Phase.LAND:
        return RecoveryMode.OFF
    if memory.active and memory.guides:
        return RecoveryMode.ON
    return RecoveryMode.ON_CONTACT


@compiled(inline=False)
def _hold_at(out: Any, place: Array, yaw: float, phase: int) -> None:
    """Write the set point that rests at a place (3) [m]."""
    for i in range(3):
        out.position[i] = place[i]
        out.velocity[i] = 0.0
        out.acceleration[i] = 0.0
    out.yaw = yaw
    out.phase = phase


@compiled(inline=False)
def _on_ground(phase: int) -> bool:
    return phase <= Phase.IDLE or phase >= Phase.LANDED


@compiled(inline=False)
def _holds_x_r(memory: ReactionMemory, mission_timed_out: bool) -> bool:
    """Return whether x_r is the set point: the mission does not fly there yet, or is silent."""
    phase = memory.mission.phase
    planned = phase <= Phase.APPROACH
    if not memory.mission_at_x_r and not planned:
        square = 0.0
        for i in range(3):
            off = memory.mission.position[i] - memory.x_r[i]
            square += off * off
        memory.mission_at_x_r = phase == Phase.LAND or square < _SAME_POSITION * _SAME_POSITION
    unsure = mission_timed_out or memory.two_publishers
    return planned or not memory.mission_at_x_r or (unsure and phase != Phase.LAND)


@compiled(inline=False)
def _reason_to_hold(
    memory: ReactionMemory, limits: ReactionLimits, mission_timed_out: bool, now_ns: int
) -> int:
    phase = memory.mission.phase
    if mission_timed_out and not _on_ground(phase):
        return HoldReason.MISSION_SILENT
    if memory.two_publishers and phase != Phase.LAND:
        return HoldReason.TWO_PUBLISHERS
    poses = now_ns - memory.mocap_ns <= limits.pose_timeout * 1e9
    detector_timed_out = now_ns - memory.detector_ns > limits.detector_timeout * 1e9
    silent = phase <= Phase.APPROACH and poses and detector_timed_out
    return HoldReason.DETECTOR_SILENT if silent else HoldReason.NONE


@compiled(inline=False)
def _report(memory: ReactionMemory, limits: ReactionLimits, why: int, now_ns: int) -> None:
    old = limits.pose_timeout * 1e9
    stale = now_ns - memory.odometry_ns > old or now_ns - memory.mocap_ns > old
    if stale and not _on_ground(memory.mission.phase):
        state = ReactionPhase.BLIND
    elif why != HoldReason.NONE:
        state = ReactionPhase.HOLDING
    elif memory.active:
        state = ReactionPhase.REACTING
    else:
        state = ReactionPhase.IDLE
    if (
        state != memory.status.state
        or why != memory.why
        or memory.changed
        or memory.status.stamp_ns == 0
    ):
        memory.why = why
        _fill_status(memory, state, now_ns)


@compiled(inline=False)
def _fill_status(memory: ReactionMemory, state: int, now_ns: int) -> None:
    status = memory.status
    status.stamp_ns = now_ns
    status.state = state
    status.collisions = memory.collisions
    for i in range(3):
        status.x_c[i] = memory.x_c[i] if memory.active else math.nan
        status.x_r[i] = memory.x_r[i] if memory.active else math.nan
        status.n_r[i] = memory.n_r[i] if memory.active else math.nan
    memory.changed = False
    memory.status_due = True


@compiled(inline=False)
def take_pose_message(
    memory: ReactionMemory, limits: ReactionLimits, pose: Pose, now_ns: int
) -> None:
    """Take note of a pose."""
    note_mocap(memory, limits, now_ns)


@compiled(inline=False)
def take_detector_status(
    memory: ReactionMemory, limits: ReactionLimits, status: DetectorStatus, now_ns: int
) -> None:
    """Take a sign of life of the detector."""
    memory.detector_ns = now_ns


@compiled(inline=False)
def take_odometry_message(
    memory: ReactionMemory, limits: ReactionLimits, odometry: Odometry, now_ns: int
) -> None:
    """Take an estimate."""
    take_estimate(memory, odometry, now_ns)


@compiled(inline=False)
def take_setpoint_message(
    memory: ReactionMemory, limits: ReactionLimits, setpoint: PositionSetpoint, now_ns: int
) -> None:
    """Take the mission's set point."""
    take_mission_setpoint(memory, setpoint, now_ns)


@compiled(inline=False)
def decides_in_python(memory: ReactionMemory, limits: ReactionLimits, now_ns: int) -> bool:
    """Return whether a decision is to be asked in the next step: it may be anybody's Python."""
    return memory.pending > 0 or reference_due(memory, now_ns)


class ReactionCore(Core):
    """Takes messages in any order; `step` returns what to publish now.

    All times are of one clock, `now_ns`. A clock set back by more than a second begins a new
    flight.
    """

    name = "reaction"
    inputs = (
        "/mocap/pose",
        "/detector/status",
        "/odometry",
        "/mission/setpoint",
        "/collision_event",
        "/contact_event",
    )
    outputs: ClassVar[Mapping[str, Output]] = {
        "/setpoint": Output(PositionSetpoint, "setpoint", "publishes"),
        "/reaction/status": Output(ReactionStatus, "status", "status_due"),
    }
    compiled = Compiled(
        ("memory",),
        ("limits",),
        {
            "/mocap/pose": take_pose_message,
            "/detector/status": take_detector_status,
            "/odometry": take_odometry_message,
            "/mission/setpoint": take_setpoint_message,
        },
        reaction_step,
        decides_in_python,
    )
    period_ns = 5_000_000
    sections: ClassVar[Mapping[str, type]] = {
        "inputs": ReactionLimits,
        **{name: kind for name, kind in REGISTRY.items() if fields(kind)},
    }
    options: ClassVar[Mapping[str, tuple[Any, str]]] = {
        "reaction": (DEFAULT, f"what it does: {', '.join(REGISTRY)}")
    }

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> ReactionCore:
        """Return a new core with the paper's reaction, see `options`."""
        core = cls(records[DEFAULT], records["inputs"])
        core._records.update(records)
        return core

    def __init__(self, reaction: Reaction, limits: ReactionLimits) -> None:
        super().__init__()
        self._records: dict[str, Any] = {reaction.name: reaction}
        self._decision: Decision | None = None
        self._decided_ns = 0
        self.failure = ""
        """How the reaction has failed to answer, or answered what can't be flown; empty: not."""
        self.limits = parameter_record(limits)
        self._pending: list[CollisionEvent] = []
        self._setpoint = PositionSetpointRecord.new()
        self._event = CollisionEventRecord.new()
        self._odometry = OdometryRecord.new()
        self.memory = ReactionMemory.new()
        self._choose(reaction)
        check_event(self.memory, self.limits, self._event, 0)  # found compiled at a collision
        begin_reaction(self.memory)

    def _choose(self, reaction: Reaction) -> None:
        self.reaction = reaction
        self.memory.recovers = reaction.recovers
        self.memory.takes_contacts = EVENT_TOPICS["imu"] in reaction.event_topics()

    def on(
        self,
        topic: str,
        message: Pose | DetectorStatus | Odometry | PositionSetpoint | CollisionEvent,
        now_ns: int,
    ) -> None:
        """Take a set point of the mission, a collision, an estimate, or a heartbeat."""
        memory = self.memory
        if isinstance(message, Pose):
            note_mocap(memory, self.limits, now_ns)
        elif isinstance(message, DetectorStatus):
            memory.detector_ns = now_ns
        elif isinstance(message, Odometry):
            fill_record(self._odometry, message)
            if not take_estimate(memory, self._odometry, now_ns):
                self.health.refuse("odometry_not_finite", "odometry with NaN or infinity")
        elif isinstance(message, PositionSetpoint):
            fill_record(self._setpoint, message)
            if not take_mission_setpoint(memory, self._setpoint, now_ns):
                text = "a set point with NaN, infinity or an unknown phase: the last one stands"
                self.health.refuse("mission_not_finite", text)
        elif topic in self.reaction.event_topics():
            self.event(message, now_ns)

    def event(self, event: CollisionEvent, now_ns: int) -> EventRefusal:
        """Take a collision, and decide; return why it was refused.

        Before the mission's first set point it is kept until there is one.
        """
        memory = self.memory
        if not is_map(event.frame_id):
            why = EventRefusal.WRONG_FRAME
        else:
            fill_record(self._event, event)
            why = check_event(memory, self.limits, self._event, now_ns + self.clock_slack_ns)
        if why == EventRefusal.WAITS:
            self._pending = [*self._pending[1 - _MAX_PENDING :], event]
            memory.pending = len(self._pending)
        elif why == EventRefusal.NONE:
            length = math.sqrt(float(event.flight_direction @ event.flight_direction))
            unit = replace(event, flight_direction=event.flight_direction / length)
            decision = self._decided_on(unit)
            if decision is not None:
                self._decision, self._decided_ns = decision, now_ns
                memory.guides = isinstance(decision, Guided)
                memory.reference_ns = now_ns - _PERIOD_NS
                memory.contact_ns, memory.trigger = event.contact_stamp_ns, event.trigger
                memory.x_c, memory.n_r, memory.x_r = decision.x_c, decision.n_r, decision.x_r
                memory.collisions += 1
                memory.active, memory.changed, memory.publish_due = True, True, True
                memory.mission_at_x_r = False
        elif why != EventRefusal.DUPLICATE:
            self.health.refuse(f"event_{why.key}", why.text)
        return why

    def _decided_on(self, event: CollisionEvent) -> Decision | None:
        """Return what the reaction decides on a collision; None where it fails, too."""
        try:
            decision = self.reaction.begin(event, self._estimate(), self.decision)
            if decision is not None:
                check_decision(decision, event.contact_position, _MAX_CONTACT_DISTANCE)
        except Exception as error:  # of anybody's code: set points go on
            self._fail("begin()", error)
            return None
        return decision

    def _fail(self, asked: str, error: Exception) -> None:
        """Report that the reaction could not answer; `failure` keeps it."""
        what = str(error) if isinstance(error, InputError) else f"failed: {problem_in(error)}"
        self.failure = f"reaction '{self.reaction.name}': {asked} {what}"
        self.health.refuse("reaction_failed", self.failure)

    @property
    def decision(self) -> Decision | None:
        """What was decided last; None before a collision."""
        return self._decision if self.memory.collisions else None

    def _estimate(self) -> Estimate:
        memory = self.memory
        return Estimate(
            memory.position.copy(),
            rotate_vector(memory.attitude, memory.velocity),
            memory.attitude.copy(),
            memory.rates.copy(),
        )

    def _guide(self, now_ns: int) -> None:
        """Ask the decision for its reference, or whether it is over."""
        memory, decision = self.memory, self._decision
        if not isinstance(decision, Guided):
            return
        since, estimate = 1e-9 * (now_ns - self._decided_ns), self._estimate()
        memory.reference_ns = now_ns
        asked = "over()"
        try:
            if decision.over(since, estimate):
                memory.guides = False
                return
            asked = "reference()"
            wanted = decision.reference(since, estimate)
            check_reference(wanted, memory.x_c)
        except Exception as error:  # of anybody's code: x_r is held
            memory.guides = False
            self._fail(asked, error)
            return
        out = memory.reference
        out.position, out.velocity = wanted.position, wanted.velocity
        out.acceleration, out.yaw = wanted.acceleration, wanted.yaw
        out.phase = Phase.REACT
        memory.publish_due = True

    def take_early_events(self, now_ns: int) -> None:
        """Take the collisions that came before the mission's first set point, if it is there."""
        if self.memory.pending and self.memory.has_mission:
            early, self._pending = self._pending, []
            self.memory.pending = 0
            for event in early:
                self.event(event, now_ns)

    @property
    def why(self) -> HoldReason:
        """Why it holds."""
        return HoldReason(self.memory.why)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Decide; return the set point and the status, each when there is a new one."""
        memory = self.memory
        if now_ns < memory.now_ns - CLOCK_SET_BACK_NS:
            self._pending.clear()
            begin_reaction(memory)
        self.take_early_events(now_ns)
        if reference_due(memory, now_ns):
            self._guide(now_ns)
        reaction_step(memory, self.limits, now_ns)
        outputs = self.take_due()
        for topic, status in outputs:
            if topic != "/reaction/status":
                continue
            health = self.health
            health.values["collisions"] = status.collisions
            held = HoldReason(memory.why if status.state == ReactionPhase.HOLDING else 0)
            for why in list(HoldReason)[1:]:
                health.fault(why.key, why == held, why.text, ERROR)
            health.fault(
                "blind", status.state == ReactionPhase.BLIND, "pose or estimate is too old", ERROR
            )
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take limits ("inputs"), a reaction's parameters, or which one ("reaction").

        Raises:
            InputError: there is no reaction of this name.
        """
        if section == "inputs":
            self.limits = parameter_record(params)
            return
        if section == "reaction":
            if params not in REGISTRY:
                raise unknown_name("reaction", str(params), REGISTRY)
            self._choose(self._records.get(params) or REGISTRY[params]())
            return
        self._records[section] = params
        if section == self.reaction.name:
            self._choose(params)

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Hold while two publish what only one may."""
        super().set_multiple_publishers(topic, several)
        self.memory.two_publishers = not self.contested.isdisjoint(_EXCLUSIVE)
