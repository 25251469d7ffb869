"""The reference between two points: a straight line, a turn on the way, then a hold."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tombo_control.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array

Point = tuple[float, float, float]

ACCELERATION = 0.8
"""m/s^2: of a leg that asks for nothing else."""
_TURN_RAMP = 0.3
"""s: a turn takes this long to reach its rate."""
_FOREVER = 1e9


@dataclass(frozen=True)
class Leg:
    """A straight reference, from begin to end, then held (map, SI); see `trapezoidal_profile`."""

    start: Point
    velocity: Point
    """While cruising."""
    begin_s: float
    end_s: float
    ramp_s: float = 0.0
    yaw: float = 0.0
    """At the begin."""
    yaw_rate: float = 0.0
    """While turning."""
    turn_s: float = 0.0
    """How long the turn lasts, from the begin."""
    turn_ramp_s: float = 0.0
    hold_s: float = 0.0
    """How long it is held before the next leg of a course."""

    def as_array(self) -> Array:
        """Return it as the autopilot's memory has it (14)."""
        times = (self.begin_s, self.end_s, self.ramp_s)
        turn = (self.yaw, self.yaw, self.yaw_rate, self.turn_s, self.turn_ramp_s)
        return np.array([*self.start, *self.velocity, *times, *turn])

    def position(self, time_s: float) -> Point:
        """Return the reference position at `time_s`."""
        way, _, _ = trapezoidal_profile(
            time_s - self.begin_s, self.end_s - self.begin_s, self.ramp_s
        )
        x, y, z = (s + v * way for s, v in zip(self.start, self.velocity, strict=True))
        return x, y, z

    def yaw_at(self, time_s: float) -> float:
        """Return the reference yaw at `time_s`."""
        way, _, _ = trapezoidal_profile(time_s - self.begin_s, self.turn_s, self.turn_ramp_s)
        return self.yaw + self.yaw_rate * way

    @property
    def motion_end_s(self) -> float:
        """When way and turn are over."""
        return max(self.end_s, self.begin_s + self.turn_s)

    @property
    def hold_end_s(self) -> float:
        """When the hold after them is over, too."""
        return self.motion_end_s + self.hold_s


def hold_leg(point: Point, now_s: float, yaw: float = 0.0) -> Leg:
    """Return the leg that holds a point."""
    return Leg(point, (0.0, 0.0, 0.0), now_s, _FOREVER, yaw=yaw)


def straight_leg(start: Point, goal: Point, speed: float, now_s: float, yaw: float = 0.0) -> Leg:
    """Return the leg from `start` to `goal` at `speed` [m/s], with ramps of 0.8 m/s^2."""
    leg = _line(start, goal, speed, ACCELERATION, now_s)
    return hold_leg(goal, now_s, yaw) if leg is None else replace(leg, yaw=yaw)


def turning_leg(
    start: Point,
    goal: Point,
    yaws: tuple[float, float],
    now_s: float,
    *,
    speed: float,
    acceleration: float,
    yaw_rate: float,
) -> Leg:
    """Return the leg from `start` to `goal` that turns from the first to the second yaw [rad].

    Both begin at once, each as fast as its own limits allow; yaw is not wrapped.
    """
    leg = _line(start, goal, speed, acceleration, now_s)
    if leg is None:
        leg = Leg(goal, (0.0, 0.0, 0.0), now_s, now_s)
    change = yaws[1] - yaws[0]
    if abs(change) < 1e-9:
        return replace(leg, yaw=yaws[1])
    rate, lasts, ramp = _trapezoid(abs(change), yaw_rate, yaw_rate / _TURN_RAMP)
    return replace(
        leg,
        yaw=yaws[0],
        yaw_rate=math.copysign(rate, change),
        turn_s=lasts,
        turn_ramp_s=ramp,
    )


def _line(
    start: Point, goal: Point, speed: float, acceleration: float, now_s: float
) -> Leg | None:
    """Return the leg without a turn; None: there is no way to go."""
    way = [g - s for g, s in zip(goal, start, strict=True)]
    length = math.sqrt(sum(w * w for w in way))
    if length < 1e-9:
        return None
    cruise, lasts, ramp = _trapezoid(length, speed, acceleration)
    vx, vy, vz = (cruise * w / length for w in way)
    return Leg(start, (vx, vy, vz), now_s, now_s + lasts, ramp)


def _trapezoid(length: float, speed: float, acceleration: float) -> tuple[float, float, float]:
    """Return the speed reached, the whole time and that of a ramp."""
    ramp = min(speed / acceleration, math.sqrt(length / acceleration))
    cruise = ramp * acceleration
    return cruise, length / cruise + ramp, ramp
