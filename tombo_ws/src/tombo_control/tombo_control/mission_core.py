"""The mission as a node sees it: estimates may stop, others may fail, and it may begin in flight.

`mission.py` knows the plan; this keeps the plan's clock, waits while the plan can't be flown, and
turns its legs into set points.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from tombo_control.planning.commanded_course import (
    CourseProgress,
    begin_course,
    course_here,
    course_of,
    plan_with,
    progress,
)
from tombo_control.planning.leg import leg_position, leg_reference, motion_end
from tombo_control.planning.mission import (
    MissionParams,
    MissionState,
    Plan,
    advance_mission,
    begin,
    begin_in_flight,
    compiled_plan,
    land,
    resume,
    start_reaction,
    wait,
)
from tombo_control.planning.mission_memory import (
    NEVER,
    MissionLimits,
    MissionMemory,
    StatusEntry,
    WaitReason,
    begin_mission,
)
from tombo_control.safety.params import SafetyParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS, Compiled, Core, Output
from tombo_dynamics.effects.downwash import MOST_OTHERS
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import (
    PHASE_NAMES,
    MissionStatus,
    Odometry,
    Phase,
    Pose,
    PositionSetpoint,
    ReactionPhase,
    ReactionStatus,
)
from tombo_dynamics.records import parameter_record
from tombo_dynamics.rotation import rotated
from tombo_dynamics.time_base import TICK_NS
from tombo_dynamics.vectors import ZERO, all_finite, norm, subtract, vector

_PERIOD_TICKS = 20
_AIRBORNE_HEIGHT = 0.3
"""m above the ground: it flies."""
_GROUND_HEIGHT, _BELOW_PLAN, _REST_SPEED, _REST_TIME_S = 0.1, 0.15, 0.15, 1.0
"""m above the ground, m below the plan, slower than m/s, for s: it stands there."""
_NO_LIFT_S = 9.0
"""s: the same, for a vehicle that has not lifted off yet. PX4 needs 3 to 5: mode and arming are
confirmed, rotors spin up (COM_SPOOLUP_TIME), thrust rises (MPC_TKO_RAMP_T); a refusal costs 1."""
_LIFT_OFF_HEIGHT, _FALLEN_BACK_HEIGHT, _FALLEN_BACK_TIME_S = 0.05, 0.03, 0.3
"""m, m, s: a take-off that has been so high, and is so low again for so long, is over."""
_SHOWS_IDLE_NS = -200_000_000
"""A commanded plan shows phase idle for so long: those behind it see it begin on the ground."""
_LAG_S, _BRAKING, _LEG_SAMPLES = 0.5, 2.0, 5
"""s, m/s^2: the vehicle follows the reference so late, and brakes so; points of that way."""
_DRIFT = 0.05
"""m: a waiting reference follows the vehicle when it is further away."""
_MAX_CLOCK_STEP_NS = 100_000_000
"""The plan's clock goes on by no more than this at a time: the node may have been stopped."""


def status_texts(status: Any) -> dict[str, str]:
    """Return the text of `/mission/status`: the phase, and why the plan waits."""
    text = PHASE_NAMES[status.phase].replace("_", " ")
    if status.wait_reason:
        text += f", waits: {WaitReason(status.wait_reason).text}"
    return {"text": text}


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
    if not (all_finite(odometry.position) and all_finite(velocity)):
        return False
    memory.position = odometry.position
    memory.velocity = velocity
    memory.estimate_ns = now_ns
    return True


@compiled(inline=False)
def take_reaction(
    memory: MissionMemory,
    params: Any,
    waypoints: Array,
    limits: MissionLimits,
    status: ReactionStatus,
    now_ns: int,
) -> None:
    """Take the reaction's status: its x_r, of a collision not known yet, is where to fly."""
    state, x_r = status.state, status.x_r
    memory.reaction = state
    if state == ReactionPhase.IDLE:
        memory.escape[0] = math.nan
    if state == ReactionPhase.IDLE or not all_finite(x_r):
        return
    same_place = vector(memory.decided_place) == vector(x_r)
    if same_place and memory.decided_collisions == status.collisions:
        return
    memory.decided_collisions = status.collisions
    memory.decided_place = x_r
    if now_ns - status.stamp_ns <= limits.escape_age * 1e9:
        memory.escape = x_r


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
    """Go on to `now_ns` with a plan whose two parts are given; write `setpoint`.

    Before the first estimate it is missing.
    """
    if memory.now_ns != NEVER and now_ns < memory.now_ns - CLOCK_SET_BACK_NS:
        begin_mission(memory, False)  # another flight: it takes a command
    passed = 0 if memory.now_ns == NEVER else max(now_ns - memory.now_ns, 0)
    memory.now_ns = now_ns
    if not memory.has_estimate:
        if memory.estimate_ns == NEVER or memory.two_estimators:
            return
        memory.has_estimate = True
        memory.has_flown = memory.position[2] > limits.ground_height + _AIRBORNE_HEIGHT
        if memory.has_flown:
            begin_in_flight(memory, memory.position, limits.ground_height)
        else:
            begin(memory, memory.position)
        passed = 0
    waited = memory.wait_reason
    passed = min(passed, _MAX_CLOCK_STEP_NS)
    memory.wait_reason = _reason_to_wait(memory, limits, now_ns, passed)
    still = (
        memory.wait_reason == WaitReason.ESTIMATE_SILENT
        or memory.wait_reason == WaitReason.TWO_ESTIMATORS
    )
    if not still:
        if memory.started or memory.mode != Phase.IDLE:
            memory.time_ns += passed
        _advance(memory, Plan(params, waypoints), limits, waited)
    _set_point(memory, now_ns, still)
    mode, reason = memory.mode, memory.wait_reason
    memory.status_due = memory.published_mode != mode or memory.published_reason != reason
    memory.published_mode, memory.published_reason = mode, reason
    memory.status.stamp_ns = now_ns
    memory.status.phase = mode
    memory.status.wait_reason = reason
    memory.setpoint_due = True


@compiled(inline=False)
def _flies(mode: int) -> bool:
    return mode != Phase.IDLE and mode != Phase.LAND and mode != Phase.LANDED


@compiled(inline=False)
def _is_planned(mode: int) -> bool:
    return mode == Phase.IDLE or Phase.TAKEOFF <= mode <= Phase.APPROACH


@compiled(inline=False)
def _reason_to_wait(
    memory: MissionMemory, limits: MissionLimits, now_ns: int, passed_ns: int
) -> int:
    if memory.two_estimators:
        return WaitReason.TWO_ESTIMATORS
    if memory.estimate_ns == NEVER or now_ns - memory.estimate_ns > limits.estimate_timeout * 1e9:
        return WaitReason.ESTIMATE_SILENT
    if memory.operator_hold and memory.mode != Phase.LAND and memory.mode != Phase.LANDED:
        return WaitReason.OPERATOR
    if not _is_planned(memory.mode):
        return WaitReason.NONE
    if memory.reaction == ReactionPhase.HOLDING:
        return WaitReason.REACTION_HOLDS
    if memory.reaction == ReactionPhase.BLIND:
        return WaitReason.BLIND
    if memory.answer_ns != NEVER and now_ns - memory.answer_ns > limits.reaction_timeout * 1e9:
        return WaitReason.REACTION_SILENT
    if _is_too_near(memory, 1e-9 * (memory.time_ns + passed_ns)):
        return WaitReason.COMPANY
    return WaitReason.NONE


@compiled(inline=False)
def _is_too_near(memory: MissionMemory, now_s: float) -> bool:
    """Say whether the way on from `now_s`, or the point refused, is too near to another vehicle.

    The way is looked at as far as the vehicle flies on when it brakes.
    """
    if memory.others_count == 0:
        return False
    if memory.wait_reason == WaitReason.COMPANY:
        return _is_taken(memory)
    leg = memory.leg
    ahead_s = _LAG_S + norm(leg.velocity) / (2.0 * _BRAKING)
    for k in range(_LEG_SAMPLES):
        memory.refused = leg_position(leg, now_s + ahead_s * k / (_LEG_SAMPLES - 1))
        if _is_taken(memory):
            return True
    return False


@compiled(inline=False)
def _is_taken(memory: MissionMemory) -> bool:
    """Say whether `refused` is too near to a vehicle; one that was not seen may be anywhere."""
    for k in range(memory.others_count):
        away = norm(subtract(memory.refused, memory.others[k]))
        if not away >= memory.separation:  # NaN
            return True
    return False


@compiled(inline=False)
def _advance(memory: MissionMemory, plan: Plan, limits: MissionLimits, waited: int) -> None:
    """Take the plan's next step, with a fresh estimate."""
    now, position = memory.time_ns * 1e-9, memory.position
    if not math.isnan(memory.escape[0]):
        if _flies(memory.mode):
            start_reaction(memory, memory.escape, now)
        memory.escape[0] = math.nan
    if memory.mode == Phase.IDLE:
        begin(memory, position)
    if _is_on_ground(memory, now):
        wait(memory, Phase.LANDED.value, now, position)
        return
    waiting = memory.wait_reason == WaitReason.OPERATOR or (
        _is_planned(memory.mode) and memory.wait_reason != WaitReason.NONE
    )
    error = norm(subtract(leg_position(memory.leg, now), position))
    moves = vector(memory.leg.velocity) != ZERO and now < memory.leg.end_s
    if memory.mode != Phase.IDLE and _is_planned(memory.mode):
        if waiting:
            follows = error > _DRIFT and memory.wait_reason != WaitReason.COMPANY
            if waited == WaitReason.NONE or follows:
                wait(memory, memory.mode, now, position)
        elif (
            waited >= WaitReason.REACTION_HOLDS
            or (waited != WaitReason.NONE and error > _DRIFT)
            or (moves and error > limits.lag_max)
        ):
            resume(memory, plan, now, position)
    late = memory.mode != Phase.IDLE and now >= plan.params.land_time
    ready = memory.started or memory.mode != Phase.IDLE
    if (ready and not waiting) or late:
        advance_mission(memory, plan, now, position, memory.velocity)


@compiled(inline=False)
def _is_on_ground(memory: MissionMemory, now: float) -> bool:
    """Say whether the vehicle stands on the ground though it is to fly.

    It has crashed, or somebody has put it there; or it does not lift off.
    """
    height = memory.position[2]
    if memory.mode == Phase.IDLE:
        memory.has_flown = False
        memory.has_lifted = False
    elif height > memory.home[2] + _AIRBORNE_HEIGHT:
        memory.has_flown = True
    memory.has_lifted = memory.has_lifted or height > memory.home[2] + _LIFT_OFF_HEIGHT
    _, _, planned = leg_position(memory.leg, motion_end(memory.leg))
    low = height < memory.home[2] + _GROUND_HEIGHT and height < planned - _BELOW_PLAN
    slow = norm(memory.velocity) < _REST_SPEED
    if not (low and slow and _flies(memory.mode)) or memory.wait_reason != WaitReason.NONE:
        memory.rest_since_s = math.inf
        return False
    memory.rest_since_s = min(memory.rest_since_s, now)
    rests_s = now - memory.rest_since_s
    fallen_back = (
        memory.mode == Phase.TAKEOFF
        and memory.has_lifted
        and height < memory.home[2] + _FALLEN_BACK_HEIGHT
    )
    if fallen_back and rests_s >= _FALLEN_BACK_TIME_S:
        return True
    return bool(rests_s >= (_REST_TIME_S if memory.has_flown else _NO_LIFT_S))


@compiled(inline=False)
def _set_point(memory: MissionMemory, now_ns: int, still: bool) -> None:
    """Write the reference at the present flight time; `still`: held where it is."""
    out = memory.setpoint
    position, velocity, acceleration, yaw = leg_reference(memory.leg, memory.time_ns * 1e-9)
    out.position = position
    out.velocity = ZERO if still else velocity
    out.acceleration = ZERO if still else acceleration
    out.yaw = yaw
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
    slow = norm(memory.velocity) < _REST_SPEED
    return bool(slow and memory.position[2] < memory.home[2] + _GROUND_HEIGHT)


@compiled(inline=False)
def take_off(memory: MissionMemory, disarmed: bool) -> bool:
    """Begin the plan on the ground, or go on with one that an operator holds; False: it flies.

    A vehicle whose flight controller is `disarmed` does not fly, whatever the plan believes.
    """
    flies = memory.has_estimate and memory.mode != Phase.IDLE and memory.mode != Phase.LANDED
    put_down = flies and (disarmed or _was_put_down(memory))
    if memory.operator_hold and not put_down:
        memory.operator_hold = False
        return True
    memory.operator_hold = False
    if flies and not put_down:
        return False
    if memory.has_estimate and memory.mode == Phase.IDLE:
        memory.time_ns = _SHOWS_IDLE_NS
    memory.started = True
    memory.takeoff_commands += 1
    if memory.mode == Phase.LANDED or put_down:
        begin(memory, memory.position)
        memory.time_ns = _SHOWS_IDLE_NS
        memory.has_flown = False
        memory.has_lifted = False
        memory.rest_since_s = math.inf
        memory.escape[0] = math.nan
    return True


@compiled(inline=False)
def land_now(memory: MissionMemory, plan: Plan) -> bool:
    """Land where the vehicle is; a plan that has not first does not begin. False: it is down."""
    memory.operator_hold = False
    if not memory.has_estimate or memory.mode == Phase.IDLE:
        memory.started = False
        return True
    if memory.mode == Phase.LAND or memory.mode == Phase.LANDED:
        return bool(memory.mode == Phase.LAND)
    land(memory, plan, memory.time_ns * 1e-9, memory.position)
    return True


def refuse_take_off(status: Any) -> str:
    """Return why PX4 would not follow a take-off, by `/px4/status`; "": it would.

    Args:
        status: fields of `tombo_msgs/Px4Status`.
    """
    if not status.connected:
        return "no heartbeat of PX4"
    if status.armed:
        return "" if status.offboard else f"PX4 is armed, {status.stage}: {status.why}"
    return "" if status.ready else "PX4 is not ready: " + "; ".join(status.findings)


class MissionCore(Core):
    """Keeps the plan's clock and state in a record; `step` gives the set point.

    All times are of one clock, `now_ns`. A clock set back by more than a second begins a new
    flight.
    """

    name = "mission"
    inputs: tuple[str, ...] = ("/odometry", "/reaction/status", "/setpoint", "/goal_pose")  # type: ignore[misc]
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
        {"/odometry": take_odometry, "/reaction/status": take_reaction, "/setpoint": take_answer},
        step_mission,
    )
    period_ns = _PERIOD_TICKS * TICK_NS
    steps_on_messages = False
    sections: ClassVar[Mapping[str, type]] = {
        "mission": MissionParams,
        "inputs": MissionLimits,
        "safety": SafetyParams,
    }
    options: ClassVar[Mapping[str, tuple[Any, str]]] = {
        "auto_start": (
            True,
            "false: wait on the ground for ~/takeoff, or until it is set to true",
        ),
        "others": ("", "poses of other vehicles to keep away from: absolute topics, with spaces"),
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
        return cls(records["mission"], records["inputs"], safety=records["safety"])

    def __init__(
        self,
        params: MissionParams,
        limits: MissionLimits,
        started: bool = True,
        safety: SafetyParams | None = None,
    ) -> None:
        super().__init__()
        self._params = params
        self.plan = compiled_plan(params)
        self.vehicle_status: Any = None
        """The newest `/px4/status`; None: no flight controller tells."""
        self._course: tuple[Array, float] | None = None
        """Waypoints of a commanded course, and the flight time [s] at which it began."""
        self.courses = 0
        """How many were commanded."""
        self.limits = parameter_record(limits)
        self.memory = MissionMemory.new()
        self.memory.published_mode = -1
        self.memory.separation = (safety or SafetyParams()).separation
        begin_mission(self.memory, started)

    def on(
        self, topic: str, message: Odometry | ReactionStatus | PositionSetpoint | Pose, now_ns: int
    ) -> None:
        """Take an estimate, the reaction's status, its set point, a goal, or another vehicle."""
        if isinstance(message, Pose) and topic not in type(self).inputs:
            self.see_other(self.inputs.index(topic) - len(type(self).inputs), message.position)
        elif isinstance(message, Pose):
            try:
                self.fly_course("goal_pose", [message])
            except InputError as error:
                self.health.refuse("goal_refused", str(error))
        elif self.take(topic, message, now_ns) is False:
            self.health.report_event("odometry_not_finite", "odometry with NaN or infinity")

    def expect_others(self, count: int) -> None:
        """Keep away from `count` other vehicles; the plan waits until the place of each is known.

        Raises:
            InputError: `count` is above MOST_OTHERS.
        """
        if count > MOST_OTHERS:
            raise InputError(f"others: {count} vehicles; accepted: at most {MOST_OTHERS}")
        self.memory.others_count = count
        self.memory.others[:] = math.nan

    def see_other(self, number: int, position: Array) -> None:
        """Take the place (3) [m] of another vehicle, from 0, in map."""
        if np.isfinite(position).all():
            self.memory.others[number] = position

    def fly_course(
        self, name: str, poses: Sequence[Pose], speed: float = 0.0, hold: float = 0.0
    ) -> None:
        """Fly to places instead of the rest of the plan, and hold at the last.

        It ends with another command, a reaction, or the landing.

        Args:
            name: of the command in an error.
            poses: places and headings, see `course_of`.
            speed: on the way [m/s]; 0: the plan's.
            hold: at each place but the last [s].

        Raises:
            InputError: not in this phase, or a place that can't be flown to.
        """
        speed = speed or self._params.approach_speed
        self._begin(course_of(name, poses, self.memory, self.time_s, speed, hold))

    def hold_course(self) -> None:
        """End a commanded course where its reference is, and hold there."""
        if self._course is not None:
            self._begin(course_here(self.memory, self.time_s, self._params.approach_speed))

    def _begin(self, course: Array) -> None:
        begin_course(self.memory, self.time_s)
        self._course = course, self.time_s
        self.courses += 1
        self.plan = plan_with(self._params, *self._course)

    @property
    def course_progress(self) -> CourseProgress | None:
        """How far a commanded course is; None without one."""
        if self._course is None:
            return None
        memory = self.memory
        return progress(memory, self._course[0], self.time_s, memory.position)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Go on with the plan; return its set point, and its status when that has changed."""
        published = super().step(now_ns)
        if self._course is not None and self.mode != Phase.APPROACH:  # a reaction, the landing
            self._course, self.plan = None, compiled_plan(self._params)
        waits = self.wait_reason
        for why in list(WaitReason)[1:]:
            self.health.fault(why.key, waits == why and self.mode != Phase.IDLE, why.text)
        self.health.values["phase"] = PHASE_NAMES[self.mode]
        self.health.values["flight_time_s"] = round(self.time_s, 2)
        return published

    def set_params(self, section: str, params: Any) -> None:
        """Take a changed plan ("mission"), other limits ("inputs"), or the start command."""
        if section == "mission":
            self._params = params
            course = self._course
            self.plan = plan_with(params, *course) if course else compiled_plan(params)
        elif section == "inputs":
            self.limits = parameter_record(params)
        elif section == "safety":
            self.memory.separation = params.separation
        elif section == "others":
            topics = [f"//{topic.lstrip('/')}" for topic in params.split()]
            self.inputs = (*type(self).inputs, *topics)
            self.expect_others(len(topics))
        else:
            memory = self.memory
            if params and memory.has_estimate and not memory.started:
                memory.takeoff_commands += 1
            memory.started = bool(params)

    def command(self, name: str) -> str:
        """Obey an operator: a name of `commands`; return why not, empty: it is obeyed."""
        memory, phase = self.memory, PHASE_NAMES[self.mode].replace("_", " ")
        if name == "takeoff":
            status = self.vehicle_status
            if status is not None and (refusal := refuse_take_off(status)):
                return refusal
            disarmed = status is not None and not status.armed
            return "" if take_off(memory, disarmed) else f"it flies: phase {phase}"
        if name == "hold":
            if self.mode in (Phase.IDLE, Phase.LAND, Phase.LANDED):
                return f"nothing to hold: phase {phase}"
            memory.operator_hold = True
            return ""
        return "" if land_now(memory, self.plan) else "it has landed"

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Stand still while two estimators speak."""
        super().set_multiple_publishers(topic, several)
        self.memory.two_estimators = "/odometry" in self.contested

    @property
    def state(self) -> MissionState | None:
        """Where the plan stands; None before the first estimate."""
        return self.memory if self.memory.has_estimate else None

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
