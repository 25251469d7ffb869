"""The mission: take off, hover, fly to the goal or a course; hold after a collision; land.

Pure and event-driven: one call per pose or at a fixed rate, with time as an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from tombo_control.autopilot import (
    APPROACH,
    HOLD,
    HOVER,
    IDLE,
    LAND,
    LANDED,
    REACT,
    TAKEOFF,
)
from tombo_control.course import (
    Course,
    ResolvedWaypoint,
    Waypoint,
    leg_to,
    read_course,
    resolved_waypoints,
)
from tombo_control.leg import Leg, Point, hold_leg, straight_leg
from tombo_dynamics.arrays import Array
from tombo_dynamics.params import param, structure

_ARRIVED = 0.08
_STILL = 0.15
_SETTLED_RADIUS = 0.1
_SETTLED_SPEED = 0.1
_SETTLED_TIME = 1.0
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
    course: tuple[Waypoint, ...] | None = structure(
        read_course,
        "in place of the approach: waypoints, each {x, y, z, yaw, speed, acceleration, yaw_rate, "
        "hold}; what one leaves out is as at the one before; after the last it lands",
    )
    hold_time: float = param(4.0, "s", (0.0, 600.0), "hold at x_r before landing", "seen steady")
    land_time: float = param(
        42.0, "s", (1.0, 3600.0), "land at the latest, reaction or not", "one battery, short film"
    )
    land_speed: float = param(0.4, "m/s", (0.1, 2.0), "descent", "estimated: gentle")


@dataclass(frozen=True)
class MissionState:
    """Where the mission stands."""

    mode: int
    leg: Leg
    home: Point
    steps: int = 0
    """Jumps made, or waypoints begun."""
    settled_since_s: float = math.inf
    settled_s: float = math.nan
    """When the vehicle was first settled at x_r [s]; NaN before."""


def begin(home: Array) -> MissionState:
    """Return the state on the ground at `home` (3)."""
    x, y, z = (float(v) for v in home)
    return MissionState(IDLE, hold_leg((x, y, z), 0.0), (x, y, z))


def initial_state_in_flight(position: Array, ground: float) -> MissionState:
    """Return the state of a mission that begins in the air: hold at `position` (3), then land.

    Args:
        position: of the vehicle.
        ground: height of a vehicle that stands on the ground [m].
    """
    x, y, z = (float(v) for v in position)
    return MissionState(HOLD, hold_leg((x, y, z), 0.0), (x, y, ground), settled_s=0.0)


def wait(state: MissionState, now_s: float, position: Array) -> MissionState:
    """Stay at `position` (3) in the plan's present phase."""
    x, y, z = (float(v) for v in position)
    return replace(state, leg=hold_leg((x, y, z), now_s, state.leg.yaw_at(now_s)))


def set_landed(state: MissionState, now_s: float, position: Array) -> MissionState:
    """End the flight at `position` (3): the vehicle stands on the ground."""
    return replace(wait(state, now_s, position), mode=LANDED)


def resume(
    state: MissionState, params: MissionParams, now_s: float, position: Array
) -> MissionState:
    """Go on with the plan's present phase from `position` (3), at rest there."""
    x, y, z = (float(v) for v in position)
    here = (x, y, z)
    if state.mode in (TAKEOFF, HOVER):
        return replace(
            state, leg=straight_leg(here, _top(state, params), params.climb_speed, now_s)
        )
    if state.mode == APPROACH and params.course is not None:
        target = _targets(state, params)[_waypoint(state, params.course)]
        return replace(state, leg=leg_to(target, here, state.leg.yaw_at(now_s), now_s))
    if state.mode == APPROACH:
        goal = (params.goal_x, params.goal_y, params.height)
        if params.step_size > 0.0:
            goal = _corner(state, params, state.steps - 1)
        return replace(state, leg=straight_leg(here, goal, params.approach_speed, now_s))
    return state


def start_reaction(state: MissionState, x_r: Array, now_s: float) -> MissionState:
    """Leave the plan for the safe point x_r (3); a point that is not finite changes nothing."""
    x, y, z = (float(v) for v in x_r)
    if not math.isfinite(x + y + z):
        return state
    leg = hold_leg((x, y, z), now_s, state.leg.yaw_at(now_s))
    return replace(state, mode=REACT, leg=leg, settled_since_s=math.inf, settled_s=math.nan)


def advance_mission(
    state: MissionState, params: MissionParams, now_s: float, position: Array, velocity: Array
) -> MissionState:
    """Return the state after looking at the clock and the estimate (map, SI)."""
    mode = state.mode
    if mode in (LAND, LANDED):
        return _landing(state, params, now_s, position, velocity)
    if mode != IDLE and now_s >= params.land_time:
        return _land(state, params, now_s, position)
    if mode == IDLE and now_s >= params.takeoff_time:
        top = _top(state, params)
        return replace(
            state, mode=TAKEOFF, leg=straight_leg(state.home, top, params.climb_speed, now_s)
        )
    if mode == TAKEOFF and now_s >= state.leg.end_s:
        top = _top(state, params)
        if _near(position, top, _ARRIVED) and _speed(velocity) < _STILL:
            return replace(state, mode=HOVER, leg=hold_leg(top, now_s))
    flying = mode == HOVER and now_s >= params.approach_time
    if params.course is not None and (flying or mode == APPROACH):
        return _along_course(state, params, params.course, now_s, position)
    if flying:
        goal = (params.goal_x, params.goal_y, params.height)
        if params.step_size > 0.0:
            return _next_step(state, params, now_s)
        start = state.leg.position(now_s)
        return replace(
            state, mode=APPROACH, leg=straight_leg(start, goal, params.approach_speed, now_s)
        )
    next_step_s = params.approach_time + params.step_period * state.steps
    if mode == APPROACH and params.step_size > 0.0 and now_s >= next_step_s:
        return _next_step(state, params, now_s)
    if mode in (REACT, HOLD):
        return _settling(state, params, now_s, position, velocity)
    return state


def _top(state: MissionState, params: MissionParams) -> Point:
    """Return where it hovers."""
    return state.home[0], state.home[1], params.height


def _targets(state: MissionState, params: MissionParams) -> list[ResolvedWaypoint]:
    return resolved_waypoints(params.course or (), _top(state, params), params.approach_speed)


def _waypoint(state: MissionState, course: Course) -> int:
    """Return which waypoint is flown to; the plan may have been changed in flight."""
    return min(max(state.steps - 1, 0), len(course) - 1)


def _along_course(
    state: MissionState, params: MissionParams, course: Course, now_s: float, position: Array
) -> MissionState:
    """Begin the leg to the next waypoint when the last one is over; after the last, land."""
    known: list[ResolvedWaypoint] = []
    while True:
        begun = state.mode == APPROACH and state.steps > 0
        hold_end_s = state.leg.hold_end_s if begun else params.approach_time
        if now_s < hold_end_s:
            return state
        if state.steps >= len(course):
            return _land(state, params, now_s, position)
        known = known or _targets(state, params)
        begin_s = hold_end_s if now_s - hold_end_s < _LATE else now_s
        here, yaw = state.leg.position(now_s), state.leg.yaw_at(now_s)
        leg = leg_to(known[state.steps], here, yaw, begin_s)
        state = replace(state, mode=APPROACH, leg=leg, steps=state.steps + 1)


def _next_step(state: MissionState, params: MissionParams, now_s: float) -> MissionState:
    """Jump to the next corner of a square with a change of height: a hard test for a detector."""
    point = _corner(state, params, state.steps)
    return replace(state, mode=APPROACH, leg=hold_leg(point, now_s), steps=state.steps + 1)


def _corner(state: MissionState, params: MissionParams, step: int) -> Point:
    corners = ((1.0, 0.0, 0.0), (1.0, 1.0, 0.4), (0.0, 1.0, -0.2), (0.0, 0.0, 0.3))
    dx, dy, dz = corners[step % 4]
    size = params.step_size
    return state.home[0] + size * dx, state.home[1] + size * dy, params.height + size * dz


def _settling(
    state: MissionState, params: MissionParams, now_s: float, position: Array, velocity: Array
) -> MissionState:
    goal = state.leg.start
    near = _near(position, goal, _SETTLED_RADIUS) and _speed(velocity) < _SETTLED_SPEED
    since = min(state.settled_since_s, now_s) if near else math.inf
    if state.mode == REACT and now_s - since >= _SETTLED_TIME:
        return replace(state, mode=HOLD, settled_since_s=since, settled_s=now_s)
    if state.mode == HOLD and now_s - state.settled_s >= params.hold_time:
        return _land(state, params, now_s, position)
    return replace(state, settled_since_s=since)


def _land(
    state: MissionState, params: MissionParams, now_s: float, position: Array
) -> MissionState:
    x, y, _ = state.leg.position(now_s)
    height = float(position[2])
    below = (x, y, state.home[2] - 0.6)
    yaw = state.leg.yaw_at(now_s)
    leg = straight_leg((x, y, height), below, params.land_speed, now_s, yaw)
    return replace(state, mode=LAND, leg=leg)


def _landing(
    state: MissionState, params: MissionParams, now_s: float, position: Array, velocity: Array
) -> MissionState:
    if state.mode == LANDED:
        return state
    lag = float(position[2]) - state.leg.position(now_s)[2]
    if lag > 0.25 and abs(float(velocity[2])) < 0.15 and float(position[2]) < state.home[2] + 0.3:
        here = hold_leg(state.leg.position(now_s), now_s, state.leg.yaw)
        return replace(state, mode=LANDED, leg=here)
    return state


def _near(position: Array, point: Point, radius: float) -> bool:
    dx, dy, dz = (float(position[i]) - point[i] for i in range(3))
    return dx * dx + dy * dy + dz * dz < radius * radius


def _speed(velocity: Array) -> float:
    vx, vy, vz = float(velocity[0]), float(velocity[1]), float(velocity[2])
    return math.sqrt(vx * vx + vy * vy + vz * vz)
