"""The mission: take off, hover, fly towards the goal, and after a collision hold at x_r and land.

Pure and event-driven: one call per pose or at a fixed rate, with time as an argument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

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
from tombo_control.reference import progress
from tombo_dynamics.params import param

Array = NDArray[np.float64]

_ACCELERATION = 0.8
_ARRIVED = 0.08
_STILL = 0.15
_SETTLED_RADIUS = 0.1
_SETTLED_SPEED = 0.1
_SETTLED_TIME = 1.0
_FOREVER = 1e9


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
    hold_time: float = param(4.0, "s", (0.0, 600.0), "hold at x_r before landing", "seen steady")
    land_time: float = param(
        42.0, "s", (1.0, 3600.0), "land at the latest, reaction or not", "one battery, short film"
    )
    land_speed: float = param(0.4, "m/s", (0.1, 2.0), "descent", "estimated: gentle")


@dataclass(frozen=True)
class Leg:
    """A straight reference, from begin to end, then held (map, SI); see `reference.progress`."""

    start: tuple[float, float, float]
    velocity: tuple[float, float, float]
    """While cruising."""
    begin_s: float
    end_s: float
    ramp_s: float = 0.0
    yaw: float = 0.0

    def as_array(self) -> Array:
        """Return start, velocity, begin, end, ramp, yaw as an array (10)."""
        times = (self.begin_s, self.end_s, self.ramp_s, self.yaw)
        return np.array([*self.start, *self.velocity, *times])

    def position(self, time_s: float) -> tuple[float, float, float]:
        """Return the reference position at `time_s`."""
        way, _, _ = progress(time_s - self.begin_s, self.end_s - self.begin_s, self.ramp_s)
        x, y, z = (s + v * way for s, v in zip(self.start, self.velocity, strict=True))
        return x, y, z


def stay(point: tuple[float, float, float], now_s: float) -> Leg:
    """Return the leg that holds a point."""
    return Leg(point, (0.0, 0.0, 0.0), now_s, _FOREVER)


def straight(
    start: tuple[float, float, float], goal: tuple[float, float, float], speed: float, now_s: float
) -> Leg:
    """Return the leg from `start` to `goal` at `speed` [m/s], with ramps of 0.8 m/s^2."""
    way = [g - s for g, s in zip(goal, start, strict=True)]
    length = math.sqrt(sum(w * w for w in way))
    if length < 1e-9:
        return stay(goal, now_s)
    ramp = min(speed / _ACCELERATION, math.sqrt(length / _ACCELERATION))
    cruise = ramp * _ACCELERATION
    vx, vy, vz = (cruise * w / length for w in way)
    return Leg(start, (vx, vy, vz), now_s, now_s + length / cruise + ramp, ramp)


@dataclass(frozen=True)
class MissionState:
    """Where the mission stands."""

    mode: int
    leg: Leg
    home: tuple[float, float, float]
    steps: int = 0
    settled_since_s: float = math.inf
    settled_s: float = math.nan
    """When the vehicle was first settled at x_r [s]; NaN before."""


def begin(home: Array) -> MissionState:
    """Return the state on the ground at `home` (3)."""
    x, y, z = (float(v) for v in home)
    return MissionState(IDLE, stay((x, y, z), 0.0), (x, y, z))


def begin_in_flight(position: Array, ground: float) -> MissionState:
    """Return the state of a mission that begins in the air: hold at `position` (3), then land.

    Args:
        position: of the vehicle.
        ground: height of a vehicle that stands on the ground [m].
    """
    x, y, z = (float(v) for v in position)
    return MissionState(HOLD, stay((x, y, z), 0.0), (x, y, ground), settled_s=0.0)


def wait(state: MissionState, now_s: float, position: Array) -> MissionState:
    """Stay at `position` (3) in the plan's present phase."""
    x, y, z = (float(v) for v in position)
    return replace(state, leg=stay((x, y, z), now_s))


def grounded(state: MissionState, now_s: float, position: Array) -> MissionState:
    """End the flight at `position` (3): the vehicle stands on the ground."""
    return replace(wait(state, now_s, position), mode=LANDED)


def resume(
    state: MissionState, params: MissionParams, now_s: float, position: Array
) -> MissionState:
    """Go on with the plan's present phase from `position` (3), at rest there."""
    x, y, z = (float(v) for v in position)
    here = (x, y, z)
    top = (state.home[0], state.home[1], params.height)
    if state.mode in (TAKEOFF, HOVER):
        return replace(state, leg=straight(here, top, params.climb_speed, now_s))
    if state.mode == APPROACH:
        goal = (params.goal_x, params.goal_y, params.height)
        if params.step_size > 0.0:
            goal = _corner(state, params, state.steps - 1)
        return replace(state, leg=straight(here, goal, params.approach_speed, now_s))
    return state


def escape(state: MissionState, x_r: Array, now_s: float) -> MissionState:
    """Leave the plan for the safe point x_r (3); a point that is not finite changes nothing."""
    x, y, z = (float(v) for v in x_r)
    if not math.isfinite(x + y + z):
        return state
    return replace(
        state, mode=REACT, leg=stay((x, y, z), now_s), settled_since_s=math.inf, settled_s=math.nan
    )


def proceed(
    state: MissionState, params: MissionParams, now_s: float, position: Array, velocity: Array
) -> MissionState:
    """Return the state after looking at the clock and the estimate (map, SI)."""
    mode = state.mode
    if mode in (LAND, LANDED):
        return _landing(state, params, now_s, position, velocity)
    if mode != IDLE and now_s >= params.land_time:
        return _land(state, params, now_s, position)
    if mode == IDLE and now_s >= params.takeoff_time:
        top = (state.home[0], state.home[1], params.height)
        return replace(
            state, mode=TAKEOFF, leg=straight(state.home, top, params.climb_speed, now_s)
        )
    if mode == TAKEOFF and now_s >= state.leg.end_s:
        top = (state.home[0], state.home[1], params.height)
        if _near(position, top, _ARRIVED) and _speed(velocity) < _STILL:
            return replace(state, mode=HOVER, leg=stay(top, now_s))
    if mode == HOVER and now_s >= params.approach_time:
        goal = (params.goal_x, params.goal_y, params.height)
        if params.step_size > 0.0:
            return _next_step(state, params, now_s)
        start = state.leg.position(now_s)
        return replace(
            state, mode=APPROACH, leg=straight(start, goal, params.approach_speed, now_s)
        )
    next_step_s = params.approach_time + params.step_period * state.steps
    if mode == APPROACH and params.step_size > 0.0 and now_s >= next_step_s:
        return _next_step(state, params, now_s)
    if mode in (REACT, HOLD):
        return _settling(state, params, now_s, position, velocity)
    return state


def _next_step(state: MissionState, params: MissionParams, now_s: float) -> MissionState:
    """Jump to the next corner of a square with a change of height: a hard test for a detector."""
    point = _corner(state, params, state.steps)
    return replace(state, mode=APPROACH, leg=stay(point, now_s), steps=state.steps + 1)


def _corner(state: MissionState, params: MissionParams, step: int) -> tuple[float, float, float]:
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
    return replace(state, mode=LAND, leg=straight((x, y, height), below, params.land_speed, now_s))


def _landing(
    state: MissionState, params: MissionParams, now_s: float, position: Array, velocity: Array
) -> MissionState:
    if state.mode == LANDED:
        return state
    lag = float(position[2]) - state.leg.position(now_s)[2]
    if lag > 0.25 and abs(float(velocity[2])) < 0.15 and float(position[2]) < state.home[2] + 0.3:
        return replace(state, mode=LANDED, leg=stay(state.leg.position(now_s), now_s))
    return state


def _near(position: Array, point: tuple[float, float, float], radius: float) -> bool:
    dx, dy, dz = (float(position[i]) - point[i] for i in range(3))
    return dx * dx + dy * dy + dz * dz < radius * radius


def _speed(velocity: Array) -> float:
    vx, vy, vz = float(velocity[0]), float(velocity[1]), float(velocity[2])
    return math.sqrt(vx * vx + vy * vy + vz * vz)
