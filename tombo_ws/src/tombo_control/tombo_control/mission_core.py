"""The mission as a node sees it: estimates may stop, others may fail, and it may begin in flight.

`mission.py` knows the plan; this keeps the plan's clock, waits while the plan can't be flown, and
turns its legs into set points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from tombo_control.planning.commanded_course import (
    CourseProgress,
    begin_course,
    course_here,
    course_of,
    plan_with,
    progress,
)
from tombo_control.planning.leg import (
    LegRecord,
    leg_position,
    leg_yaw,
    motion_end,
    store_leg,
    stored_leg,
)
from tombo_control.planning.mission import (
    MissionParams,
    MissionState,
    Plan,
    advance_mission,
    begin,
    compiled_plan,
    initial_state_in_flight,
    land,
    resume,
    set_landed,
    start_reaction,
    wait,
)
from tombo_control.planning.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS, Compiled, Core, Output
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import MissionStatusRecord, PositionSetpointRecord
from tombo_dynamics.messages import (
    PHASE_NAMES,
    MissionStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionPhase,
    ReactionStatus,
    Reason,
)
from tombo_dynamics.params import param
from tombo_dynamics.records import Record, field, parameter_record
from tombo_dynamics.rotation import rotate_vector, rotated
from tombo_dynamics.time_base import TICK_NS
from tombo_dynamics.vectors import AnyVector


class WaitReason(Reason):
    """Why the plan waits. From REACTION_HOLDS on it is the reaction that it waits for."""

    NONE = 0
    ESTIMATE_SILENT = 1, "no estimates: the plan stands still"
    TWO_ESTIMATORS = 2, "two nodes publish odometry: the plan stands still"
    REACTION_HOLDS = 3, "the reaction holds: the plan waits"
    BLIND = 4, "the reaction sees stale poses: the plan waits"
    REACTION_SILENT = 5, "no message from the reaction: the plan waits"
    OPERATOR = 6, "held by an operator: the plan waits"


_PERIOD_TICKS = 20
_NEVER = -1
_AIRBORNE = 0.3
"""m above the ground: it flies."""
_LOW, _BELOW, _REST, _REST_S = 0.1, 0.15, 0.15, 1.0
"""m above the ground, m below the plan, slower than m/s, for s: it stands there."""
_NO_LIFT_S = 9.0
"""s: the same, for a vehicle that has not lifted off yet. PX4 needs 3 to 5: mode and arming are
confirmed, rotors spin up (COM_SPOOLUP_TIME), thrust rises (MPC_TKO_RAMP_T); a refusal costs 1."""
_LIFTED, _BACK, _BACK_S = 0.05, 0.03, 0.3
"""m, m, s: a take-off that has been so high, and is so low again for so long, is over."""
_SHOWS_IDLE_NS = -200_000_000
"""A commanded plan shows phase idle for so long: those behind it see it begin on the ground."""
_DRIFT = 0.05
"""m: a waiting reference follows the vehicle when it is further away."""
_MAX_CLOCK_STEP_NS = 100_000_000
"""The plan's clock goes on by no more than this at a time: the node may have been stopped."""


@dataclass(frozen=True)
class MissionLimits:
    """When the plan waits, and what it takes for granted."""

    estimate_timeout: float = param(
        0.25,
        "s",
        (0.02, 5.0),
        "silence of the estimator after which the plan's clock stands still",
        "as control.blind_timeout",
    )
    reaction_timeout: float = param(
        0.3,
        "s",
        (0.04, 10.0),
        "silence of the reaction, after its first message, after which the plan waits",
        "15 set points",
    )
    lag_max: float = param(
        0.5,
        "m",
        (0.05, 10.0),
        "the plan begins again from a vehicle this far behind a moving reference",
        "ten times the lag of an undisturbed flight",
    )
    escape_age: float = param(
        12.0,
        "s",
        (0.1, 600.0),
        "an older decision of the reaction is none to follow",
        "reaction.timeout",
    )
    ground_height: float = param(
        0.18,
        "m",
        (-1e3, 1e3),
        "height of a vehicle that stands on the ground; one 0.3 m higher is taken to fly",
        "vehicle.leg_height",
    )


class StatusEntry(MissionStatusRecord):  # type: ignore[misc, valid-type]
    """The mission's status, and what its text is made of."""

    wait_reason = field("1", "a `WaitReason`", kind=int)


class MissionMemory(Record):
    """Memory of the mission's core."""

    begun = field("1", "the first estimate has come", kind=bool)
    started = field("1", "false: waits on the ground, the plan's clock at 0", kind=bool)
    takeoff_commands = field("1", "of an operator; `auto_start` is none", kind=int)
    mode = field("1", "from here to settled_s: the `MissionState`", kind=int)
    leg = field("", "the reference", kind=LegRecord)
    home = field("m", "in map", 3)
    steps = field("1", "jumps made, or waypoints begun", kind=int)
    settled_since_s = field("s", "at x_r since then")
    settled_s = field("s", "when it was first settled there; NaN before")
    wait_reason = field("1", "a `WaitReason`", kind=int)
    position = field("m", "last estimate, in map", 3)
    velocity = field("m/s", "last estimate, in map", 3)
    estimate_ns = field("ns", "when it came; -1: never, as in the next two", kind=int)
    answer_ns = field("ns", "when the reaction's last set point came", kind=int)
    now_ns = field("ns", "of the last step", kind=int)
    time_ns = field("ns", "flight time", kind=int)
    two_estimators = field("1", "two nodes publish odometry", kind=bool)
    held = field("1", "an operator has said hold", kind=bool)
    reaction = field("1", "the reaction's state", kind=int)
    decided_collisions = field("1", "number of collisions in the last one; -1: none", kind=int)
    decided_place = field("m", "x_r of the last decision taken, in map", 3)
    escape = field("m", "x_r to leave for, in map; NaN: none", 3)
    rest_since_s = field("s", "stands still since then")
    has_flown = field("1", "it has been in the air", kind=bool)
    has_lifted = field("1", "it has left the ground", kind=bool)
    setpoint = field("", "the newest", kind=PositionSetpointRecord)
    setpoint_due = field("1", "it is to be published", kind=bool)
    published_mode = field("1", "phase in the last status", kind=int)
    published_reason = field("1", "reason to wait in the last status", kind=int)
    status = field("", "the newest", kind=StatusEntry)
    status_due = field("1", "it is to be published: another phase, or reason", kind=bool)


def status_texts(status: Any) -> dict[str, str]:
    """Return the text of `/mission/status`: the phase, and why the plan waits."""
    text = PHASE_NAMES[status.phase].replace("_", " ")
    if status.wait_reason:
        text += f", waits: {WaitReason(status.wait_reason).text}"
    return {"text": text}


@compiled(inline=False)
def begin_mission(memory: MissionMemory, started: bool) -> None:
    """Forget everything but what was published."""
    memory.begun = False
    memory.started = started
    memory.takeoff_commands = 0
    memory.mode = Phase.IDLE
    memory.wait_reason = WaitReason.NONE
    memory.estimate_ns = _NEVER
    memory.answer_ns = _NEVER
    memory.now_ns = _NEVER
    memory.time_ns = 0
    memory.two_estimators = False
    memory.held = False
    memory.reaction = ReactionPhase.IDLE
    memory.decided_collisions = _NEVER
    for i in range(3):
        memory.decided_place[i] = math.nan
        memory.escape[i] = math.nan
    memory.rest_since_s = math.inf
    memory.has_flown = False
    memory.has_lifted = False


@compiled(inline=False)
def mission_state(memory: MissionMemory) -> MissionState:
    """Return where the plan stands."""
    home = (memory.home[0], memory.home[1], memory.home[2])
    return MissionState(
        memory.mode,
        stored_leg(memory.leg),
        home,
        memory.steps,
        memory.settled_since_s,
        memory.settled_s,
    )


@compiled(inline=False)
def store_state(memory: MissionMemory, state: MissionState) -> None:
    """Keep where the plan stands."""
    store_leg(memory.leg, state.leg)
    for i in range(3):
        memory.home[i] = state.home[i]
    memory.mode = state.mode
    memory.steps = state.steps
    memory.settled_since_s = state.settled_since_s
    memory.settled_s = state.settled_s


@compiled(inline=False)
def take_estimate(
    memory: MissionMemory, position: Array, velocity: AnyVector, now_ns: int
) -> bool:
    """Take an estimate (3), (3), map; False: not finite, not taken."""
    total = 0.0
    for i in range(3):
        total += position[i] + velocity[i]
    if not math.isfinite(total):
        return False
    for i in range(3):
        memory.position[i] = position[i]
        memory.velocity[i] = velocity[i]
    memory.estimate_ns = now_ns
    return True


@compiled(inline=False)
def take_reaction(
    memory: MissionMemory,
    limits: MissionLimits,
    state: int,
    x_r: Array,
    collisions: int,
    stamp_ns: int,
    now_ns: int,
) -> None:
    """Take the reaction's status.

    Args:
        memory: the mission's memory.
        limits: `MissionLimits`.
        state: a `ReactionPhase`.
        x_r: (3) in map [m]; counts with a collision only.
        collisions: of this flight so far.
        stamp_ns: of the decision.
        now_ns: the present.
    """
    memory.reaction = state
    if state == ReactionPhase.IDLE:
        memory.escape[0] = math.nan
    if state == ReactionPhase.IDLE or not math.isfinite(x_r[0] + x_r[1] + x_r[2]):
        return
    known = memory.decided_collisions == collisions
    for i in range(3):
        known = known and memory.decided_place[i] == x_r[i]
    if known:
        return
    memory.decided_collisions = collisions
    fresh = now_ns - stamp_ns <= limits.escape_age * 1e9
    for i in range(3):
        memory.decided_place[i] = x_r[i]
        if fresh:
            memory.escape[i] = x_r[i]


@compiled(inline=False)
def mission_step(memory: MissionMemory, plan: Plan, limits: MissionLimits, now_ns: int) -> bool:
    """Go on to `now_ns`; write `setpoint` and return True, False before the first estimate."""
    if memory.now_ns != _NEVER and now_ns < memory.now_ns - CLOCK_SET_BACK_NS:
        begin_mission(memory, False)  # another flight: it takes a command
    passed = 0 if memory.now_ns == _NEVER else max(now_ns - memory.now_ns, 0)
    memory.now_ns = now_ns
    if not memory.begun:
        if memory.estimate_ns == _NEVER or memory.two_estimators:
            return False
        memory.begun = True
        memory.has_flown = memory.position[2] > limits.ground_height + _AIRBORNE
        if memory.has_flown:
            store_state(memory, initial_state_in_flight(memory.position, limits.ground_height))
        else:
            store_state(memory, begin(memory.position))
        passed = 0
    waited = memory.wait_reason
    memory.wait_reason = _reason_to_wait(memory, limits, now_ns)
    still = (
        memory.wait_reason == WaitReason.ESTIMATE_SILENT
        or memory.wait_reason == WaitReason.TWO_ESTIMATORS
    )
    if not still:
        if memory.started or memory.mode != Phase.IDLE:
            memory.time_ns += min(passed, _MAX_CLOCK_STEP_NS)
        _advance(memory, plan, limits, waited)
    _set_point(memory, now_ns, still)
    mode, reason = memory.mode, memory.wait_reason
    memory.status_due = memory.published_mode != mode or memory.published_reason != reason
    memory.published_mode, memory.published_reason = mode, reason
    memory.status.stamp_ns = now_ns
    memory.status.phase = mode
    memory.status.wait_reason = reason
    memory.setpoint_due = True
    return True


@compiled(inline=False)
def _is_planned(mode: int) -> bool:
    return mode == Phase.IDLE or Phase.TAKEOFF <= mode <= Phase.APPROACH


@compiled(inline=False)
def _reason_to_wait(memory: MissionMemory, limits: MissionLimits, now_ns: int) -> int:
    if memory.two_estimators:
        return WaitReason.TWO_ESTIMATORS
    if memory.estimate_ns == _NEVER or now_ns - memory.estimate_ns > limits.estimate_timeout * 1e9:
        return WaitReason.ESTIMATE_SILENT
    if memory.held and memory.mode != Phase.LAND and memory.mode != Phase.LANDED:
        return WaitReason.OPERATOR
    if not _is_planned(memory.mode):
        return WaitReason.NONE
    if memory.reaction == ReactionPhase.HOLDING:
        return WaitReason.REACTION_HOLDS
    if memory.reaction == ReactionPhase.BLIND:
        return WaitReason.BLIND
    if memory.answer_ns != _NEVER and now_ns - memory.answer_ns > limits.reaction_timeout * 1e9:
        return WaitReason.REACTION_SILENT
    return WaitReason.NONE


@compiled(inline=False)
def _advance(memory: MissionMemory, plan: Plan, limits: MissionLimits, waited: int) -> None:
    """Take the plan's next step, with a fresh estimate."""
    state, now, here = mission_state(memory), memory.time_ns * 1e-9, memory.position
    if not math.isnan(memory.escape[0]):
        if state.mode != Phase.IDLE and state.mode != Phase.LAND and state.mode != Phase.LANDED:
            state = start_reaction(state, memory.escape, now)
        memory.escape[0] = math.nan
    if state.mode == Phase.IDLE:
        state = begin(here)
    if _is_on_ground(memory, state, now):
        store_state(memory, set_landed(state, now, here))
        return
    waiting = memory.wait_reason == WaitReason.OPERATOR or (
        _is_planned(state.mode) and memory.wait_reason != WaitReason.NONE
    )
    off = _tracking_error(state, now, here)
    if state.mode != Phase.IDLE and _is_planned(state.mode):
        if waiting:
            if waited == WaitReason.NONE or off > _DRIFT:
                state = wait(state, now, here)
        elif (
            waited >= WaitReason.REACTION_HOLDS
            or (waited != WaitReason.NONE and off > _DRIFT)
            or (_reference_moves(state, now) and off > limits.lag_max)
        ):
            state = resume(state, plan, now, here)
    late = state.mode != Phase.IDLE and now >= plan.params.land_time
    ready = memory.started or state.mode != Phase.IDLE
    if (ready and not waiting) or late:
        state = advance_mission(state, plan, now, here, memory.velocity)
    store_state(memory, state)


@compiled(inline=False)
def _tracking_error(state: MissionState, now: float, here: Array) -> float:
    """Return how far the vehicle is from the reference [m]."""
    x, y, z = leg_position(state.leg, now)
    x, y, z = x - here[0], y - here[1], z - here[2]
    return math.sqrt(x * x + y * y + z * z)


@compiled(inline=False)
def _reference_moves(state: MissionState, now: float) -> bool:
    x, y, z = state.leg.velocity
    return (x != 0.0 or y != 0.0 or z != 0.0) and now < state.leg.end_s


@compiled(inline=False)
def _is_on_ground(memory: MissionMemory, state: MissionState, now: float) -> bool:
    """Say whether the vehicle stands on the ground though it is to fly.

    It has crashed, or somebody has put it there; or it does not lift off.
    """
    height = memory.position[2]
    if state.mode == Phase.IDLE:
        memory.has_flown = False
        memory.has_lifted = False
    elif height > state.home[2] + _AIRBORNE:
        memory.has_flown = True
    memory.has_lifted = memory.has_lifted or height > state.home[2] + _LIFTED
    _, _, wanted = leg_position(state.leg, motion_end(state.leg))
    low = height < state.home[2] + _LOW and height < wanted - _BELOW
    x, y, z = memory.velocity[0], memory.velocity[1], memory.velocity[2]
    slow = math.sqrt(x * x + y * y + z * z) < _REST
    flies = state.mode != Phase.IDLE and state.mode != Phase.LAND and state.mode != Phase.LANDED
    if not (low and slow and flies) or memory.wait_reason != WaitReason.NONE:
        memory.rest_since_s = math.inf
        return False
    memory.rest_since_s = min(memory.rest_since_s, now)
    rests_s = now - memory.rest_since_s
    back = state.mode == Phase.TAKEOFF and memory.has_lifted and height < state.home[2] + _BACK
    if back and rests_s >= _BACK_S:
        return True
    return bool(rests_s >= (_REST_S if memory.has_flown else _NO_LIFT_S))


@compiled(inline=False)
def _set_point(memory: MissionMemory, now_ns: int, still: bool) -> None:
    """Write the reference at the present flight time; `still`: held where it is."""
    leg, now = stored_leg(memory.leg), memory.time_ns * 1e-9
    _, speed, change = trapezoidal_profile(now - leg.begin_s, leg.end_s - leg.begin_s, leg.ramp_s)
    if still:
        speed = 0.0
        change = 0.0
    place = leg_position(leg, now)
    out = memory.setpoint
    for i in range(3):
        out.position[i] = place[i]
        out.velocity[i] = speed * leg.velocity[i]
        out.acceleration[i] = change * leg.velocity[i]
    out.yaw = leg_yaw(leg, now)
    out.phase = memory.mode
    out.takeoff_commands = memory.takeoff_commands
    out.stamp_ns = now_ns


@compiled(inline=False)
def _was_put_down(memory: MissionMemory) -> bool:
    """Say whether a vehicle that has flown stands on the ground, whatever the plan believes.

    The flight controller has landed it, or its rotors were stopped.
    """
    if memory.wait_reason == WaitReason.ESTIMATE_SILENT or not memory.has_flown:
        return False
    x, y, z = memory.velocity[0], memory.velocity[1], memory.velocity[2]
    slow = math.sqrt(x * x + y * y + z * z) < _REST
    return bool(slow and memory.position[2] < memory.home[2] + _LOW)


@compiled(inline=False)
def take_off(memory: MissionMemory) -> bool:
    """Begin the plan on the ground, or go on with one that an operator holds; False: it flies."""
    flies = memory.begun and memory.mode != Phase.IDLE and memory.mode != Phase.LANDED
    put_down = flies and _was_put_down(memory)
    if memory.held and not put_down:
        memory.held = False
        return True
    memory.held = False
    if flies and not put_down:
        return False
    if memory.begun and memory.mode == Phase.IDLE:
        memory.time_ns = _SHOWS_IDLE_NS
    memory.started = True
    memory.takeoff_commands += 1
    if memory.mode == Phase.LANDED or put_down:
        store_state(memory, begin(memory.position))
        memory.time_ns = _SHOWS_IDLE_NS
        memory.has_flown = False
        memory.has_lifted = False
        memory.rest_since_s = math.inf
        memory.escape[0] = math.nan
    return True


@compiled(inline=False)
def land_now(memory: MissionMemory, plan: Plan) -> bool:
    """Land where the vehicle is; a plan that has not begun does not begin. False: it is down."""
    memory.held = False
    if not memory.begun or memory.mode == Phase.IDLE:
        memory.started = False
        return True
    if memory.mode == Phase.LAND or memory.mode == Phase.LANDED:
        return bool(memory.mode == Phase.LAND)
    state = land(mission_state(memory), plan, memory.time_ns * 1e-9, memory.position)
    store_state(memory, state)
    return True


@compiled(inline=False)
def take_odometry(
    memory: MissionMemory,
    params: Any,
    waypoints: Array,
    limits: MissionLimits,
    odometry: Odometry,
    now_ns: int,
) -> bool:
    """Take an estimate; False: not finite, not taken."""
    velocity = rotated(odometry.attitude, odometry.velocity)
    return take_estimate(memory, odometry.position, velocity, now_ns)


@compiled(inline=False)
def take_reaction_status(
    memory: MissionMemory,
    params: Any,
    waypoints: Array,
    limits: MissionLimits,
    status: ReactionStatus,
    now_ns: int,
) -> None:
    """Take the reaction's status."""
    s = status
    take_reaction(memory, limits, s.state, s.x_r, s.collisions, s.stamp_ns, now_ns)


@compiled(inline=False)
def take_answer(
    memory: MissionMemory,
    params: Any,
    waypoints: Array,
    limits: MissionLimits,
    setpoint: PositionSetpoint,
    now_ns: int,
) -> None:
    """Take a set point of the reaction as a sign of life."""
    memory.answer_ns = now_ns


@compiled(inline=False)
def step_mission(
    memory: MissionMemory, params: Any, waypoints: Array, limits: MissionLimits, now_ns: int
) -> None:
    """Go on to `now_ns` with a plan whose two parts are given."""
    mission_step(memory, Plan(params, waypoints), limits, now_ns)


class MissionCore(Core):
    """Keeps the plan's clock and state in a record; `step` gives the set point.

    All times are of one clock, `now_ns`. A clock set back by more than a second begins a new
    flight.
    """

    name = "mission"
    inputs = ("/odometry", "/reaction/status", "/setpoint", "/goal_pose")
    outputs: ClassVar[Mapping[str, Output]] = {
        "/mission/setpoint": Output(
            PositionSetpoint, "setpoint", "setpoint_due", every=_PERIOD_TICKS
        ),
        "/mission/status": Output(
            MissionStatus,
            "status",
            "status_due",
            record=StatusEntry,
            texts=status_texts,
            every=_PERIOD_TICKS,
        ),
    }
    compiled = Compiled(
        ("memory",),
        ("plan.params", "plan.waypoints", "limits"),
        {
            "/odometry": take_odometry,
            "/reaction/status": take_reaction_status,
            "/setpoint": take_answer,
        },
        step_mission,
    )
    period_ns = _PERIOD_TICKS * TICK_NS
    steps_on_messages = False
    sections: ClassVar[Mapping[str, type]] = {"mission": MissionParams, "inputs": MissionLimits}
    options: ClassVar[Mapping[str, tuple[Any, str]]] = {
        "auto_start": (True, "false: wait on the ground for ~/takeoff, or until it is set to true")
    }
    commands: ClassVar[Mapping[str, str]] = {
        "takeoff": "begin the plan, from the ground; while held: go on with it",
        "hold": "stay where it is, until ~/takeoff, ~/land or mission.land_time",
        "land": "land where it is, now; on the ground: do not take off",
        "abort": "give the plan up: as land",
    }

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> MissionCore:
        """Return a new mission."""
        return cls(records["mission"], records["inputs"])

    def __init__(self, params: MissionParams, limits: MissionLimits, started: bool = True) -> None:
        super().__init__()
        self._params = params
        self.plan = compiled_plan(params)
        self._course: tuple[Array, float] | None = None
        """Waypoints of a commanded course, and the flight time [s] at which it began."""
        self.courses = 0
        """How many were commanded."""
        self.limits = parameter_record(limits)
        self.memory = MissionMemory.new()
        self.memory.published_mode = -1
        begin_mission(self.memory, started)

    def on(
        self, topic: str, message: Odometry | ReactionStatus | PositionSetpoint | Pose, now_ns: int
    ) -> None:
        """Take an estimate, the reaction's status, its set point as a heartbeat, or a goal."""
        if isinstance(message, Odometry):
            velocity = rotate_vector(message.attitude, message.velocity)
            if not take_estimate(self.memory, message.position, velocity, now_ns):
                self.health.report_event("odometry_not_finite", "odometry with NaN or infinity")
        elif isinstance(message, ReactionStatus):
            take_reaction(
                self.memory,
                self.limits,
                message.state,
                message.x_r,
                message.collisions,
                message.stamp_ns,
                now_ns,
            )
        elif isinstance(message, Pose):
            try:
                self.fly_course("goal_pose", [message])
            except InputError as error:
                self.health.refuse("goal_refused", str(error))
        else:
            self.memory.answer_ns = now_ns

    def fly_course(
        self, name: str, poses: Sequence[Pose], speed: float = 0.0, hold: float = 0.0
    ) -> None:
        """Fly to places in place of what the plan has next, and hold at the last.

        It ends with another command, a reaction, or the landing.

        Args:
            name: of the command in an error.
            poses: places and headings, see `course_of`.
            speed: on the way [m/s]; 0: the plan's.
            hold: at each place but the last [s].

        Raises:
            InputError: not in this phase, or a place that can't be flown to.
        """
        state, now_s = mission_state(self.memory), self.time_s
        begun = begin_course(state, now_s)
        speed = speed or self._params.approach_speed
        self._begin(begun, course_of(name, poses, state, now_s, speed, hold))

    def hold_course(self) -> None:
        """End a commanded course where its reference is, and hold there."""
        if self._course is not None:
            state, now_s = mission_state(self.memory), self.time_s
            here = course_here(state, now_s, self._params.approach_speed)
            self._begin(begin_course(state, now_s), here)

    def _begin(self, state: MissionState, course: Array) -> None:
        self._course = course, self.time_s
        self.courses += 1
        self.plan = plan_with(self._params, *self._course)
        store_state(self.memory, state)

    @property
    def course_progress(self) -> CourseProgress | None:
        """How far a commanded course is; None without one."""
        if self._course is None:
            return None
        memory = self.memory
        return progress(mission_state(memory), self._course[0], self.time_s, memory.position)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Go on with the plan; return its set point, and its status when that has changed."""
        memory = self.memory
        mission_step(memory, self.plan, self.limits, now_ns)
        if self._course is not None and self.mode != Phase.APPROACH:  # a reaction, the landing
            self._course, self.plan = None, compiled_plan(self._params)
        waits = self.wait_reason
        for why in list(WaitReason)[1:]:
            self.health.fault(why.key, waits == why and self.mode != Phase.IDLE, why.text)
        self.health.values["phase"] = PHASE_NAMES[self.mode]
        self.health.values["flight_time_s"] = round(self.time_s, 2)
        return self.take_due()

    def set_params(self, section: str, params: Any) -> None:
        """Take a changed plan ("mission"), other limits ("inputs"), or the start command."""
        if section == "mission":
            self._params = params
            course = self._course
            self.plan = plan_with(params, *course) if course else compiled_plan(params)
        elif section == "inputs":
            self.limits = parameter_record(params)
        else:
            memory = self.memory
            if params and memory.begun and not memory.started:
                memory.takeoff_commands += 1
            memory.started = bool(params)

    def command(self, name: str) -> str:
        """Obey an operator: a name of `commands`; return why not, empty: it is obeyed."""
        memory, phase = self.memory, PHASE_NAMES[self.mode].replace("_", " ")
        if name == "takeoff":
            return "" if take_off(memory) else f"it flies: phase {phase}"
        if name == "hold":
            if self.mode in (Phase.IDLE, Phase.LAND, Phase.LANDED):
                return f"nothing to hold: phase {phase}"
            memory.held = True
            return ""
        return "" if land_now(memory, self.plan) else "it has landed"

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Stand still while two estimators speak."""
        super().set_multiple_publishers(topic, several)
        self.memory.two_estimators = "/odometry" in self.contested

    @property
    def state(self) -> MissionState | None:
        """Where the plan stands; None before the first estimate."""
        return mission_state(self.memory) if self.memory.begun else None

    @property
    def mode(self) -> int:
        """Phase of the plan."""
        return int(self.memory.mode)

    @property
    def wait_reason(self) -> WaitReason:
        """Why the plan waits."""
        return WaitReason(self.memory.wait_reason)

    @property
    def time_s(self) -> float:
        """Flight time: since the first estimate, without the times that there was none [s]."""
        return float(self.memory.time_ns) * 1e-9
