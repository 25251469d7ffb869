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
from tombo_collision.reaction_memory import (
    SAME_CONTACT_NS,
    STAMPS,
    EventRefusal,
    HoldReason,
    ReactionMemory,
    begin_reaction,
)
from tombo_collision.reactions import DEFAULT, REGISTRY, Reaction
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS, ERROR, Compiled, Core, Output
from tombo_dynamics.errors import InputError, problem_in, unknown_name
from tombo_dynamics.frames import is_map
from tombo_dynamics.input_check import is_finite_setpoint, is_future
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import CollisionEventRecord
from tombo_dynamics.messages import (
    CollisionEvent,
    DetectorStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionPhase,
    ReactionStatus,
    RecoveryMode,
)
from tombo_dynamics.records import fill_record, parameter_record
from tombo_dynamics.rotation import rotate_vector
from tombo_dynamics.vectors import UNKNOWN, ZERO, all_finite, dot, norm, subtract

_EXCLUSIVE = ("/mission/setpoint", "/collision_event", "/detector/status")
"""Topics that only one may publish."""
_PERIOD_NS = 20_000_000
"""Set points that replace the mission's are published at 50 Hz."""
_MAX_CONTACT_DISTANCE = 3.0
"""m: a contact further away than this is not the vehicle's."""
_SAME_POSITION = 0.05
"""m: a set point this near to x_r is x_r."""
_MAX_PENDING = 4


@compiled(inline=False)
def take_mission_setpoint(
    memory: ReactionMemory, limits: ReactionLimits, setpoint: PositionSetpoint, now_ns: int
) -> bool:
    """Take the mission's set point; False: not finite or of no known phase, not taken."""
    if not is_finite_setpoint(setpoint) or not 0 <= setpoint.phase <= Phase.LANDED:
        return False
    memory.mission = setpoint
    memory.has_mission = True
    memory.publish_due = True
    memory.mission_ns = now_ns
    return True


@compiled(inline=False)
def take_odometry(
    memory: ReactionMemory, limits: ReactionLimits, odometry: Odometry, now_ns: int
) -> bool:
    """Take an estimate; False: its position is not finite, not taken."""
    if not all_finite(odometry.position):
        return False
    memory.position = odometry.position
    memory.velocity = odometry.velocity
    memory.attitude = odometry.attitude
    memory.rates = odometry.rates
    memory.has_position = True
    memory.odometry_ns = now_ns
    return True


@compiled(inline=False)
def take_pose(memory: ReactionMemory, limits: ReactionLimits, pose: Pose, now_ns: int) -> None:
    """Take note of a pose: the detector has something to look at."""
    if now_ns - memory.mocap_ns > limits.pose_timeout * 1e9:
        memory.detector_ns = max(memory.detector_ns, now_ns)  # its time begins now
    memory.mocap_ns = now_ns


@compiled(inline=False)
def take_detector_status(
    memory: ReactionMemory, limits: ReactionLimits, status: DetectorStatus, now_ns: int
) -> None:
    """Take a sign of life of the detector."""
    memory.detector_ns = now_ns


@compiled(inline=False)
def has_come(memory: ReactionMemory, event: Any) -> bool:
    """Return whether a collision has come before."""
    come = False
    for i in range(min(memory.events, STAMPS)):
        come = come or memory.stamps[i] == event.stamp_ns
    return come


@compiled(inline=False)
def is_same_contact(memory: ReactionMemory, event: Any) -> bool:
    """Return whether a collision is the contact decided on last, as the other trigger saw it."""
    apart = abs(event.contact_stamp_ns - memory.contact_ns)
    return bool(event.trigger != memory.trigger and apart < SAME_CONTACT_NS)


@compiled(inline=False)
def check_event(
    memory: ReactionMemory, limits: ReactionLimits, event: Any, now_ns: int
) -> EventRefusal:
    """Return whether a collision is to be reacted to: an `EventRefusal`."""
    if has_come(memory, event):
        return EventRefusal.DUPLICATE
    memory.stamps[memory.events % STAMPS] = event.stamp_ns
    memory.events += 1
    if is_same_contact(memory, event):
        return EventRefusal.DUPLICATE
    x, d = event.contact_position, event.flight_direction
    if not (all_finite(x) and all_finite(d)):
        return EventRefusal.NOT_FINITE
    if abs(norm(d) - 1.0) > 0.1:
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
        off = subtract(x, memory.position)
        if dot(off, off) > _MAX_CONTACT_DISTANCE * _MAX_CONTACT_DISTANCE:
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
    replaces_mission = True
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
            replaces_mission = False
            out = mission
        elif not memory.holds:
            memory.holds = True
            old = now_ns - memory.odometry_ns > limits.pose_timeout * 1e9
            if memory.has_position and not old:
                _hold_at(out, memory.position, mission.yaw, Phase.HOLD)
            elif memory.has_published:
                _hold_at(out, memory.setpoint.position, mission.yaw, Phase.HOLD)
            else:
                _hold_at(out, mission.position, mission.yaw, Phase.HOLD)
    _report(memory, limits, why, now_ns)
    waits = replaces_mission and (mission_timed_out or why != HoldReason.NONE)
    if waits and not memory.waits:
        memory.waits_since_ns = now_ns
    memory.waits = waits
    if waits and now_ns - memory.waits_since_ns > limits.hold_time * 1e9:
        memory.publish_due = False
        return
    due = replaces_mission and now_ns - memory.setpoint.stamp_ns >= _PERIOD_NS
    if memory.publish_due or due:
        memory.setpoint = out
        memory.setpoint.stamp_ns = now_ns
        memory.setpoint.recovery = _recovery_mode(memory)
        memory.setpoint.takeoff_commands = mission.takeoff_commands
        memory.publish_due = False
        memory.publishes = True
        memory.has_published = True


@compiled(inline=False)
def reference_due(memory: ReactionMemory, now_ns: int) -> bool:
    """Return whether the decision is to be asked for its reference before the next step."""
    return bool(memory.active and memory.guides and now_ns - memory.reference_ns >= _PERIOD_NS)


@compiled(inline=False)
def _recovery_mode(memory: ReactionMemory) -> RecoveryMode:
    """Return the `RecoveryMode` for the controller."""
    phase = memory.mission.phase
    if not memory.recovers or phase == Phase.IDLE or phase >= Phase.LAND:
        return RecoveryMode.OFF
    if memory.active and memory.guides:
        return RecoveryMode.ON
    return RecoveryMode.ON_CONTACT


@compiled(inline=False)
def _hold_at(out: Any, place: Array, yaw: float, phase: int) -> None:
    """Write the set point that rests at a place (3) [m]."""
    out.position = place
    out.velocity = out.acceleration = ZERO
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
        off = subtract(memory.mission.position, memory.x_r)
        near = dot(off, off) < _SAME_POSITION * _SAME_POSITION
        memory.mission_at_x_r = phase == Phase.LAND or near
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
    if memory.active:
        status.x_c = memory.x_c
        status.x_r = memory.x_r
        status.n_r = memory.n_r
    else:
        status.x_c = status.x_r = status.n_r = UNKNOWN
    memory.changed = False
    memory.status_due = True


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
            "/mocap/pose": take_pose,
            "/detector/status": take_detector_status,
            "/odometry": take_odometry,
            "/mission/setpoint": take_mission_setpoint,
        },
        reaction_step,
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
        self._event = CollisionEventRecord.new()
        self.memory = ReactionMemory.new()
        self._choose(reaction)
        check_event(self.memory, self.limits, self._event, 0)  # compiled before a collision
        begin_reaction(self.memory)

    def _choose(self, reaction: Reaction) -> None:
        self.reaction = reaction
        self.memory.recovers = reaction.recovers

    def on(
        self,
        topic: str,
        message: Pose | DetectorStatus | Odometry | PositionSetpoint | CollisionEvent,
        now_ns: int,
    ) -> None:
        """Take a set point of the mission, a collision, an estimate, or a heartbeat."""
        if isinstance(message, CollisionEvent):
            if topic in self.reaction.event_topics():
                self.event(message, now_ns)
        elif self.take(topic, message, now_ns) is not False:
            return
        elif isinstance(message, Odometry):
            self.health.refuse("odometry_not_finite", "odometry with NaN or infinity")
        else:
            text = "a set point with NaN, infinity or an unknown phase: the last one stands"
            self.health.refuse("mission_not_finite", text)

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
        """Return the reaction's decision on a collision; None where it fails, too."""
        try:
            decision = self.reaction.begin(event, self._estimate(), self.decision)
            if decision is not None:
                check_decision(decision, event.contact_position, _MAX_CONTACT_DISTANCE)
        except Exception as error:  # of anybody's code: set points go on
            self._fail("begin()", error)
            return None
        return decision

    def _fail(self, call: str, error: Exception) -> None:
        """Report that the reaction could not answer; `failure` keeps it."""
        what = str(error) if isinstance(error, InputError) else f"failed: {problem_in(error)}"
        self.failure = f"reaction '{self.reaction.name}': {call} {what}"
        self.health.refuse("reaction_failed", self.failure)

    @property
    def decision(self) -> Decision | None:
        """The last decision; None before a collision."""
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
        call = "over()"
        try:
            if decision.over(since, estimate):
                memory.guides = False
                return
            call = "reference()"
            reference = decision.reference(since, estimate)
            check_reference(reference, memory.x_c)
        except Exception as error:  # of anybody's code: x_r is held
            memory.guides = False
            self._fail(call, error)
            return
        out = memory.reference
        out.position, out.velocity = reference.position, reference.velocity
        out.acceleration, out.yaw = reference.acceleration, reference.yaw
        out.phase = Phase.REACT
        memory.publish_due = True

    def take_early_events(self, now_ns: int) -> None:
        """Take the collisions that came before the mission's first set point, if it is there."""
        if self.memory.pending and self.memory.has_mission:
            early, self._pending = self._pending, []
            self.memory.pending = 0
            for event in early:
                self.event(event, now_ns)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Decide; return the set point and the status, each when there is a new one."""
        memory = self.memory
        if now_ns < memory.now_ns - CLOCK_SET_BACK_NS:
            self._pending.clear()
            begin_reaction(memory)
        self.take_early_events(now_ns)
        if reference_due(memory, now_ns):
            self._guide(now_ns)
        outputs = super().step(now_ns)
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
            InputError: the name of the reaction is unknown.
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
