"""Observation and action of a policy (a neural network) that steers a recovery from a collision.

The vehicle has met an obstacle at x_c; n_r is the unit vector away from the obstacle, and
x_r = x_c + d_r n_r is where to come to rest. Frame of the policy: x along the horizontal part of
n_r, z up, y to the left. A policy thus sees the same from whichever side the obstacle is met.

The reaction `policy` and the training environment run the same compiled functions, so that a
policy flies alike in both, to the last bit.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from tombo_collision.decision import at_rest, turns
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotated
from tombo_dynamics.vectors import AnyVector

OBSERVATION = (
    *(("position from x_c", "m", 10.0, 3), ("x_r from the position", "m", 10.0, 3)),
    *(("velocity", "m/s", 20.0, 3), ("body x", "1", 1.0, 3), ("body z", "1", 1.0, 3)),
    ("body rates, base_link", "rad/s", 50.0, 3),
    ("time since the decision", "s", 60.0, 1),
    ("struck rotor, one of four; all zero: not known", "1", 1.0, 4),
)
"""Name, unit, largest magnitude and number of values of each part.

In the policy's frame unless said. Magnitudes are estimated; larger values are clipped."""
HIGH: Array = np.array([top for _, _, top, count in OBSERVATION for _ in range(count)])
"""(23) upper bounds of an observation."""
LOW: Array = np.where(np.arange(HIGH.size) < HIGH.size - 5, -HIGH, 0.0)
"""(23) lower bounds: time and struck rotor are not negative."""
ACTIONS = 6
"""Numbers of an action, each in [-1, 1]."""
REACH, ACCELERATION = 0.5, 5.0
"""m, m/s^2, estimated: offset of the set point where an action's first three numbers are 1, and
acceleration where its last three are."""


class Steering(Record):
    """A decision that a policy steers, as compiled code takes it. In map."""

    x_c = field("m", "base_link at contact", 3)
    x_r = field("m", "where to rest in the end", 3)
    along = field("1", "x axis of the policy's frame: map x and y of a unit vector", 2)
    timeout = field("s", "time after the decision at which the steering ends")
    yaw = field("rad", "the heading asked for")
    rotor = field("1", "number of the one struck, from 0; -1: not known", kind=int)
    decided_ns = field("ns", "when it was decided", kind=int)


@compiled(inline=False)
def observe(
    steering: Steering,
    time_s: float,
    position: Array,
    velocity: AnyVector,
    attitude: Array,
    rates: Array,
    out: Any,
) -> None:
    """Write the observation, with the parts of `OBSERVATION`.

    Args:
        steering: the decision.
        time_s: time since the decision [s].
        position: (3) estimate in map [m].
        velocity: (3) estimate in map [m/s].
        attitude: (4) estimate, quaternion xyzw, map from base_link.
        rates: (3) estimate, base_link [rad/s].
        out: (23) float32, filled, within `LOW` and `HIGH`.
    """
    observation = np.zeros(HIGH.size)
    _turn_in(steering, position, steering.x_c, observation, 0)
    _turn_in(steering, steering.x_r, position, observation, 3)
    zero = np.zeros(3)
    _turn_in(steering, velocity, zero, observation, 6)
    _turn_in(steering, rotated(attitude, (1.0, 0.0, 0.0)), zero, observation, 9)
    _turn_in(steering, rotated(attitude, (0.0, 0.0, 1.0)), zero, observation, 12)
    for i in range(3):
        observation[15 + i] = rates[i]
    observation[18] = time_s
    if steering.rotor >= 0:
        observation[19 + steering.rotor] = 1.0
    for i in range(HIGH.size):
        out[i] = min(max(observation[i], LOW[i]), HIGH[i])


@compiled(inline=False)
def _turn_in(steering: Steering, end: AnyVector, start: Array, out: Array, first: int) -> None:
    """Write `end` - `start`, (3) in map, in the policy's frame from `out[first]` on."""
    x, y = end[0] - start[0], end[1] - start[1]
    c, s = steering.along[0], steering.along[1]
    out[first] = c * x + s * y
    out[first + 1] = c * y - s * x
    out[first + 2] = end[2] - start[2]


@compiled(inline=False)
def steer(steering: Steering, action: Array, attitude: Array, rates: Array, out: Any) -> None:
    """Write the set point that an action asks for; no action (zeros) asks for rest at x_r.

    Args:
        steering: the decision; its heading follows the vehicle while it turns.
        action: (6) offset from x_r over `REACH`, acceleration fed forward over `ACCELERATION`, in
            the policy's frame; clipped to -1 and 1, NaN is 0.
        attitude: (4) estimate, quaternion xyzw, map from base_link.
        rates: (3) estimate, base_link [rad/s].
        out: `PositionSetpointRecord`; position, velocity, acceleration and yaw are filled, in map.
    """
    limited = np.zeros(ACTIONS)
    for i in range(ACTIONS):
        if action[i] == action[i]:
            limited[i] = min(max(action[i], -1.0), 1.0)
    c, s = steering.along[0], steering.along[1]
    out.position[0] = steering.x_r[0] + REACH * (c * limited[0] - s * limited[1])
    out.position[1] = steering.x_r[1] + REACH * (s * limited[0] + c * limited[1])
    out.position[2] = steering.x_r[2] + REACH * limited[2]
    out.acceleration[0] = ACCELERATION * (c * limited[3] - s * limited[4])
    out.acceleration[1] = ACCELERATION * (s * limited[3] + c * limited[4])
    out.acceleration[2] = ACCELERATION * limited[5]
    for i in range(3):
        out.velocity[i] = 0.0
    if turns(rates):  # the heading is the vehicle's own until it turns no more
        x, y, _ = rotated(attitude, (1.0, 0.0, 0.0))
        steering.yaw = math.atan2(y, x)
    out.yaw = steering.yaw


@compiled(inline=False)
def steering_over(
    steering: Steering, time_s: float, position: Array, velocity: AnyVector, rates: Array
) -> bool:
    """Return whether the vehicle rests at x_r, or time is up; arguments as of `observe`."""
    return bool(time_s > steering.timeout or at_rest(position, velocity, rates, steering.x_r))
