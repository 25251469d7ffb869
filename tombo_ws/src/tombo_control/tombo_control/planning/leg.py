"""The reference between two points: a straight line, a turn on the way, then a hold."""

from __future__ import annotations

import math
from typing import NamedTuple

from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.vectors import add_scaled, scale

Point = tuple[float, float, float]

ACCELERATION = 0.8
"""m/s^2: of a leg that asks for nothing else."""
_TURN_RAMP = 0.3
"""s: a turn takes this long to reach its rate."""
_FOREVER = 1e9
_SAME = 1e-9
"""m or rad: nearer points are the same."""


class Leg(NamedTuple):
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
    acceleration: Point = (0.0, 0.0, 0.0)
    """Of a leg without ramps; it is fed forward, the way does not have it."""


class LegRecord(Record):
    """A `Leg` in memory."""

    start = field("m", "in map", 3)
    velocity = field("m/s", "while cruising, in map", 3)
    begin_s = field("s", "begin of way and turn")
    end_s = field("s", "end of the way")
    ramp_s = field("s", "from rest to cruise, and back")
    yaw = field("rad", "at the begin")
    yaw_rate = field("rad/s", "while turning")
    turn_s = field("s", "how long the turn lasts, from the begin")
    turn_ramp_s = field("s", "from rest to the rate, and back")
    hold_s = field("s", "how long it is held before the next leg of a course")
    acceleration = field("m/s^2", "of a leg without ramps, in map", 3)


AnyLeg = Leg | LegRecord


@compiled(inline=False)
def store_leg(record: LegRecord, leg: Leg) -> None:
    """Write a leg into a record."""
    for i in range(3):
        record.start[i] = leg.start[i]
        record.velocity[i] = leg.velocity[i]
        record.acceleration[i] = leg.acceleration[i]
    record.begin_s, record.end_s, record.ramp_s = leg.begin_s, leg.end_s, leg.ramp_s
    record.yaw, record.yaw_rate = leg.yaw, leg.yaw_rate
    record.turn_s, record.turn_ramp_s = leg.turn_s, leg.turn_ramp_s
    record.hold_s = leg.hold_s


@compiled
def trapezoidal_profile(since: float, duration: float, ramp: float) -> tuple[float, float, float]:
    """Return way, speed and acceleration along a leg, each divided by the cruise speed.

    Speed rises linearly from 0 to 1 within `ramp`, stays, and falls to 0 within the last `ramp`.

    Args:
        since: time since the leg's begin [s]; before 0 and after `duration` it stands still.
        duration: length of the leg in time [s], at least twice the ramp.
        ramp: time to reach cruise speed [s]; 0 starts and stops at once.

    Returns:
        way [s], speed [1], acceleration [1/s].
    """
    t = min(max(since, 0.0), duration)
    if t < ramp:
        return 0.5 * t * t / ramp, t / ramp, 1.0 / ramp if since >= 0.0 else 0.0
    if t <= duration - ramp and since < duration:
        return t - 0.5 * ramp, 1.0 if since >= 0.0 else 0.0, 0.0
    left = duration - t
    if left <= 0.0:
        return duration - ramp, 0.0, 0.0
    return duration - ramp - 0.5 * left * left / ramp, left / ramp, -1.0 / ramp


@compiled(inline=False)
def leg_position(leg: AnyLeg, time_s: float) -> Point:
    """Return the reference position at `time_s` [s]."""
    way, _, _ = trapezoidal_profile(time_s - leg.begin_s, leg.end_s - leg.begin_s, leg.ramp_s)
    return add_scaled(leg.start, way, leg.velocity)


@compiled(inline=False)
def leg_yaw(leg: AnyLeg, time_s: float) -> float:
    """Return the reference yaw [rad] at `time_s` [s]."""
    way, _, _ = trapezoidal_profile(time_s - leg.begin_s, leg.turn_s, leg.turn_ramp_s)
    return leg.yaw + leg.yaw_rate * way


@compiled(inline=False)
def leg_reference(leg: AnyLeg, time_s: float) -> tuple[Point, Point, Point, float]:
    """Return position, the feed-forward of velocity and acceleration, and yaw at `time_s` [s]."""
    since = time_s - leg.begin_s
    _, speed, change = trapezoidal_profile(since, leg.end_s - leg.begin_s, leg.ramp_s)
    acceleration = scale(change, leg.velocity)
    if leg.ramp_s == 0.0:
        acceleration = scale(speed, leg.acceleration)
    velocity = scale(speed, leg.velocity)
    return leg_position(leg, time_s), velocity, acceleration, leg_yaw(leg, time_s)


@compiled(inline=False)
def motion_end(leg: AnyLeg) -> float:
    """Return when way and turn are over [s]."""
    return max(leg.end_s, leg.begin_s + leg.turn_s)


@compiled(inline=False)
def hold_leg(point: Point, now_s: float, yaw: float = 0.0) -> Leg:
    """Return the leg that holds a point."""
    still = (0.0, 0.0, 0.0)
    return Leg(point, still, now_s, _FOREVER, 0.0, float(yaw), 0.0, 0.0, 0.0, 0.0, still)


@compiled(inline=False)
def straight_leg(start: Point, goal: Point, speed: float, now_s: float, yaw: float = 0.0) -> Leg:
    """Return the leg from `start` to `goal` at `speed` [m/s], with ramps of 0.8 m/s^2."""
    if _distance(start, goal) < _SAME:
        return hold_leg(goal, now_s, yaw)
    return turning_leg(start, goal, (float(yaw), float(yaw)), now_s, speed, ACCELERATION, 1.0)


@compiled(inline=False)
def turning_leg(
    start: Point,
    goal: Point,
    yaws: tuple[float, float],
    now_s: float,
    speed: float,
    acceleration: float,
    yaw_rate: float,
    hold_s: float = 0.0,
) -> Leg:
    """Return the leg from `start` to `goal` that turns from the first to the second yaw [rad].

    Both begin at once, each as fast as its own limits allow; yaw is not wrapped.
    """
    velocity = (0.0, 0.0, 0.0)
    lasts = 0.0
    ramp = 0.0
    length = _distance(start, goal)
    if length < _SAME:
        start = goal
    else:
        cruise, lasts, ramp = _trapezoid(length, speed, acceleration)
        velocity = (
            cruise * (goal[0] - start[0]) / length,
            cruise * (goal[1] - start[1]) / length,
            cruise * (goal[2] - start[2]) / length,
        )
    yaw = yaws[1]
    rate = 0.0
    turn_s = 0.0
    turn_ramp_s = 0.0
    change = yaws[1] - yaws[0]
    if abs(change) >= _SAME:
        yaw = yaws[0]
        rate, turn_s, turn_ramp_s = _trapezoid(abs(change), yaw_rate, yaw_rate / _TURN_RAMP)
        rate = math.copysign(rate, change)
    return Leg(
        start,
        velocity,
        now_s,
        now_s + lasts,
        ramp,
        yaw,
        rate,
        turn_s,
        turn_ramp_s,
        float(hold_s),
        (0.0, 0.0, 0.0),
    )


@compiled(inline=False)
def _distance(a: Point, b: Point) -> float:
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return math.sqrt(x * x + y * y + z * z)


@compiled(inline=False)
def _trapezoid(length: float, speed: float, acceleration: float) -> tuple[float, float, float]:
    """Return the speed reached, the whole time and that of a ramp."""
    ramp = min(speed / acceleration, math.sqrt(length / acceleration))
    cruise = ramp * acceleration
    return cruise, length / cruise + ramp, ramp
