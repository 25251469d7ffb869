"""The mission: take off, hover, fly to the goal or a course; hold after a collision; land.

Pure, compiled and event-driven: one call per pose or at a fixed rate, with time as an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

from tombo_control.planning.course import (
    YAW_RATE,
    ResolvedWaypoint,
    Waypoint,
    leg_to,
    read_course,
    resolved_waypoint,
    waypoint_table,
)
from tombo_control.planning.leg import (
    ACCELERATION,
    Leg,
    LegRecord,
    Point,
    hold_leg,
    leg_position,
    leg_yaw,
    motion_end,
    store_leg,
    straight_leg,
    turning_leg,
)
from tombo_control.planning.timed_course import (
    PIECE_COLUMNS,
    course_pieces,
    moving_leg,
    piece_reference,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.params import param, structure
from tombo_dynamics.records import Record, field, parameter_record
from tombo_dynamics.vectors import dot, norm, subtract

_ARRIVED, _STILL = 0.08, 0.15
"""m, m/s, estimated: nearer to the top of the climb and slower, it hovers."""
_SETTLED_RADIUS, _SETTLED_SPEED, _SETTLED_TIME = 0.1, 0.1, 1.0
"""m, m/s, s, estimated: this near to x_r and this slow for this time, it has recovered."""
_LATE = 0.1
"""s: a leg of a course begins when the last one is over, whenever within this it is looked at."""


@dataclass(frozen=True)
class MissionParams:
    """What to fly."""

    takeoff_time: float = param(1.0, "s", (0.0, 600.0), "begin of the climb", "lab routine")
    height: float = param(2.0, "m", (0.3, 50.0), "hover height", "paper: 2 m")
    climb_speed: float = param(0.5, "m/s", (0.1, 3.0), "climb to the hover", "estimated: calm")
    approach_time: float = param(
        20.2,
        "s",
        (0.0, 3600.0),
        "begin of the flight towards the goal",
        "set so that contact comes at about 23 s, as in the paper",
    )
    approach_speed: float = param(
        0.7,
        "m/s",
        (0.05, 8.0),
        "speed towards the goal",
        "calibrated: the falling distance and unstable phase that the paper prints",
    )
    goal_x: float = param(3.4, "m", (-1e3, 1e3), "goal, map x", "twice the way to the obstacle")
    goal_y: float = param(0.0, "m", (-1e3, 1e3), "goal, map y", "straight ahead")
    step_size: float = param(
        0.0, "m", (0.0, 20.0), "in place of the approach: jumps of the set point of this size", ""
    )
    step_period: float = param(3.0, "s", (0.2, 60.0), "time between such jumps", "")
    course: tuple[Waypoint, ...] | str | None = structure(
        read_course,
        "in place of the approach: waypoints, each {x, y, z, yaw, speed, acceleration, yaw_rate, "
        "hold}; what one leaves out is as at the one before; or a CSV of places over time, its "
        "path or its text; after the last it lands",
    )
    hold_time: float = param(4.0, "s", (0.0, 600.0), "hold at x_r before landing", "seen steady")
    land_time: float = param(
        42.0, "s", (1.0, 3600.0), "land at the latest, reaction or not", "one battery, short film"
    )
    land_speed: float = param(0.4, "m/s", (0.1, 2.0), "descent", "estimated: gentle")


class Plan(NamedTuple):
    """`MissionParams` as compiled code takes them."""

    params: Any
    """The numbers."""
    waypoints: Array
    """(N, 8) the course, `waypoint_table`; or (N, 34), of a timed one, `course_pieces`."""


def compiled_plan(params: MissionParams) -> Plan:
    """Return the parameters as compiled code takes them."""
    course = params.course
    if isinstance(course, str):
        return Plan(parameter_record(params), course_pieces(course, params.height))
    return Plan(parameter_record(params), waypoint_table(course))


class MissionState(Record):
    """Where the mission stands; the functions below change it. Times are those of `now_s`."""

    mode = field("1", "a `Phase`", kind=int)
    leg = field("", "the present reference", kind=LegRecord)
    home = field("m", "where it stood before the take-off, in map", 3)
    steps = field("1", "jumps made, or waypoints begun", kind=int)
    settled_since_s = field("s", "near x_r and slow since then; inf: it is not")
    settled_s = field("s", "when it was first settled at x_r; NaN before")
    course_s = field("s", "when a timed course has begun, or will; NaN: it is not begun")


@compiled(inline=False)
def _point(place: Array) -> Point:
    return place[0], place[1], place[2]


@compiled(inline=False)
def _go_on(state: MissionState, mode: int, leg: Leg, steps: int) -> None:
    """Go on in a phase, along a leg, with a number of steps."""
    state.mode, state.steps = mode, steps
    store_leg(state.leg, leg)


@compiled(inline=False)
def begin(state: MissionState, home: Array) -> None:
    """Begin on the ground at `home` (3)."""
    _go_on(state, Phase.IDLE.value, hold_leg(_point(home), 0.0), 0)
    state.home = home
    state.settled_since_s = math.inf
    state.settled_s = state.course_s = math.nan


@compiled(inline=False)
def begin_in_flight(state: MissionState, position: Array, ground: float) -> None:
    """Begin in the air: hold at `position` (3), then land.

    Args:
        state: of the mission.
        position: of the vehicle.
        ground: height of a vehicle that stands on the ground [m].
    """
    begin(state, position)
    state.mode = Phase.HOLD.value
    state.home[2] = ground
    state.settled_s = 0.0


@compiled(inline=False)
def wait(state: MissionState, mode: int, now_s: float, position: Array) -> None:
    """Stay at `position` (3) in a phase: the plan's present one, or landed."""
    leg = hold_leg(_point(position), now_s, leg_yaw(state.leg, now_s))
    _go_on(state, mode, leg, state.steps)


@compiled(inline=False)
def resume(state: MissionState, plan: Plan, now_s: float, position: Array) -> None:
    """Go on with the plan's present phase from `position` (3), at rest there."""
    here = _point(position)
    if state.mode == Phase.TAKEOFF or state.mode == Phase.HOVER:
        leg = straight_leg(here, _top(state, plan), plan.params.climb_speed, now_s)
    elif state.mode != Phase.APPROACH:
        return
    elif _is_timed(plan):
        _to_piece(state, plan, state.steps - 1, here, now_s)
        return
    elif plan.waypoints.shape[0] > 0:
        leg = leg_to(_target(state, plan, state.steps - 1), here, leg_yaw(state.leg, now_s), now_s)
    elif plan.params.step_size > 0.0:
        goal = _corner(state, plan, state.steps - 1)
        leg = straight_leg(here, goal, plan.params.approach_speed, now_s)
    else:
        leg = straight_leg(here, _goal(plan), plan.params.approach_speed, now_s)
    _go_on(state, state.mode, leg, state.steps)


@compiled(inline=False)
def start_reaction(state: MissionState, x_r: Array, now_s: float) -> None:
    """Leave the plan for the safe point x_r (3); a point that is not finite changes nothing."""
    if math.isfinite(x_r[0] + x_r[1] + x_r[2]):
        wait(state, Phase.REACT.value, now_s, x_r)
        state.settled_since_s = math.inf
        state.settled_s = math.nan


@compiled(inline=False)
def advance_mission(
    state: MissionState, plan: Plan, now_s: float, position: Array, velocity: Array
) -> None:
    """Go on after a look at the clock and the estimate (map, SI)."""
    mode = state.mode
    flying = mode == Phase.HOVER and now_s >= plan.params.approach_time
    along = flying or mode == Phase.APPROACH
    next_step_s = plan.params.approach_time + plan.params.step_period * state.steps
    if mode == Phase.LANDED:
        return
    if mode == Phase.LAND:
        _landing(state, now_s, position, velocity)
    elif mode != Phase.IDLE and now_s >= plan.params.land_time:
        land(state, plan, now_s, position)
    elif mode == Phase.IDLE and now_s >= plan.params.takeoff_time:
        top = _top(state, plan)
        leg = straight_leg(_point(state.home), top, plan.params.climb_speed, now_s)
        _go_on(state, Phase.TAKEOFF.value, leg, state.steps)
    elif mode == Phase.TAKEOFF and now_s >= state.leg.end_s:
        top = _top(state, plan)
        if _is_within(position, top, _ARRIVED) and norm(velocity) < _STILL:
            _go_on(state, Phase.HOVER.value, hold_leg(top, now_s), state.steps)
    elif along and _is_timed(plan):
        _along_pieces(state, plan, now_s, position)
    elif along and plan.waypoints.shape[0] > 0:
        _along_course(state, plan, now_s, position)
    elif along and plan.params.step_size > 0.0:
        if flying or now_s >= next_step_s:
            _next_step(state, plan, now_s)
    elif flying:
        start = leg_position(state.leg, now_s)
        leg = straight_leg(start, _goal(plan), plan.params.approach_speed, now_s)
        _go_on(state, Phase.APPROACH.value, leg, state.steps)
    elif Phase.REACT <= mode <= Phase.HOLD:
        _settling(state, plan, now_s, position, velocity)


@compiled(inline=False)
def _top(state: MissionState, plan: Plan) -> Point:
    """Return where it hovers."""
    return state.home[0], state.home[1], plan.params.height


@compiled(inline=False)
def _goal(plan: Plan) -> Point:
    return plan.params.goal_x, plan.params.goal_y, plan.params.height


@compiled(inline=False)
def _target(state: MissionState, plan: Plan, row: int) -> ResolvedWaypoint:
    """Return a waypoint; the plan may have been changed in flight, and be shorter."""
    row = min(max(row, 0), plan.waypoints.shape[0] - 1)
    return resolved_waypoint(plan.waypoints, row, _top(state, plan), plan.params.approach_speed)


@compiled(inline=False)
def _along_course(state: MissionState, plan: Plan, now_s: float, position: Array) -> None:
    """Begin the leg to the next waypoint when the last one is over; after the last, land."""
    while True:
        hold_end_s = plan.params.approach_time
        if state.mode == Phase.APPROACH and state.steps > 0:
            hold_end_s = motion_end(state.leg) + state.leg.hold_s
        if now_s < hold_end_s:
            return
        if state.steps >= plan.waypoints.shape[0]:
            land(state, plan, now_s, position)
            return
        begin_s = hold_end_s if now_s - hold_end_s < _LATE else now_s
        here, yaw = leg_position(state.leg, now_s), leg_yaw(state.leg, now_s)
        leg = leg_to(_target(state, plan, state.steps), here, yaw, begin_s)
        _go_on(state, Phase.APPROACH.value, leg, state.steps + 1)


@compiled(inline=False)
def _is_timed(plan: Plan) -> bool:
    return bool(plan.waypoints.shape[0] > 0 and plan.waypoints.shape[1] == PIECE_COLUMNS)


@compiled(inline=False)
def _to_piece(state: MissionState, plan: Plan, row: int, start: Point, now_s: float) -> None:
    """Fly straight from rest at `start` to the begin of a piece of a timed course (map, SI).

    On arrival the course goes on from there: its clock is set so. `row`: the piece, from 0; one
    outside of the plan is taken for the nearest, as the plan may have been changed in flight.
    """
    row = min(max(row, 0), plan.waypoints.shape[0] - 1)
    begin_s = plan.waypoints[row, 0]
    reference = piece_reference(plan.waypoints, row, begin_s)
    yaws = leg_yaw(state.leg, now_s), reference.yaw
    speed = plan.params.approach_speed
    leg = turning_leg(start, reference.position, yaws, now_s, speed, ACCELERATION, YAW_RATE)
    _go_on(state, Phase.APPROACH.value, leg, row + 1)
    state.course_s = motion_end(leg) - begin_s


@compiled(inline=False)
def _along_pieces(state: MissionState, plan: Plan, now_s: float, position: Array) -> None:
    """Take the reference of a timed course at this time; after its end, land."""
    if state.mode != Phase.APPROACH or math.isnan(state.course_s):
        _to_piece(state, plan, 0, leg_position(state.leg, now_s), now_s)
        return
    since, pieces = now_s - state.course_s, plan.waypoints
    row = min(max(state.steps - 1, 0), pieces.shape[0] - 1)
    if since < pieces[row, 0]:
        return
    while since >= pieces[row, 1]:
        row += 1
        if row == pieces.shape[0]:
            land(state, plan, now_s, position)
            return
    leg = moving_leg(piece_reference(pieces, row, since), now_s)
    _go_on(state, Phase.APPROACH.value, leg, row + 1)


@compiled(inline=False)
def _next_step(state: MissionState, plan: Plan, now_s: float) -> None:
    """Jump to the next corner of a square with a change of height: a hard test for a detector."""
    corner = _corner(state, plan, state.steps)
    _go_on(state, Phase.APPROACH.value, hold_leg(corner, now_s), state.steps + 1)


@compiled(inline=False)
def _corner(state: MissionState, plan: Plan, step: int) -> Point:
    corner = step % 4
    dx = 1.0 if corner < 2 else 0.0
    dy = 1.0 if corner == 1 or corner == 2 else 0.0
    dz = (0.0, 0.4, -0.2, 0.3)[corner]
    size = plan.params.step_size
    return state.home[0] + size * dx, state.home[1] + size * dy, plan.params.height + size * dz


@compiled(inline=False)
def _settling(
    state: MissionState, plan: Plan, now_s: float, position: Array, velocity: Array
) -> None:
    place = _point(state.leg.start)
    near = _is_within(position, place, _SETTLED_RADIUS) and norm(velocity) < _SETTLED_SPEED
    state.settled_since_s = min(state.settled_since_s, now_s) if near else math.inf
    if state.mode == Phase.REACT and now_s - state.settled_since_s >= _SETTLED_TIME:
        state.mode, state.settled_s = Phase.HOLD.value, now_s
    elif state.mode == Phase.HOLD and now_s - state.settled_s >= plan.params.hold_time:
        land(state, plan, now_s, position)


@compiled(inline=False)
def land(state: MissionState, plan: Plan, now_s: float, position: Array) -> None:
    """Land from `position` (3) at the place of the reference."""
    x, y, _ = leg_position(state.leg, now_s)
    below = (x, y, state.home[2] - 0.6)
    yaw = leg_yaw(state.leg, now_s)
    leg = straight_leg((x, y, position[2]), below, plan.params.land_speed, now_s, yaw)
    _go_on(state, Phase.LAND.value, leg, state.steps)


@compiled(inline=False)
def _landing(state: MissionState, now_s: float, position: Array, velocity: Array) -> None:
    planned = leg_position(state.leg, now_s)
    height = position[2]
    if height - planned[2] > 0.25 and abs(velocity[2]) < 0.15 and height < state.home[2] + 0.3:
        leg = hold_leg(planned, now_s, state.leg.yaw)
        _go_on(state, Phase.LANDED.value, leg, state.steps)


@compiled(inline=False)
def _is_within(position: Array, point: Point, radius: float) -> bool:
    off = subtract(position, point)
    return bool(dot(off, off) < radius * radius)
