"""Observation and action of a policy in a recovery: one observation, one mapping of actions.

The reaction `policy` and the training environment run the same compiled functions, so that a
policy flies in both to the last bit alike. Frame of the policy: its x along n_r in the plane,
its z up, its y to the left.
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
"""Observation, unit, largest magnitude (larger values are clipped), number of values.

In the policy's frame unless said."""
HIGH: Array = np.array([top for _, _, top, count in OBSERVATION for _ in range(count)])
"""(23) upper bounds of an observation."""
LOW: Array = np.where(np.arange(HIGH.size) < HIGH.size - 5, -HIGH, 0.0)
"""(23) lower bounds: time and struck rotor are not negative."""
ACTIONS = 6
"""Numbers of an action, each in [-1, 1]."""
REACH, ACCELERATION = 0.5, 5.0
"""m, m/s^2: value of 1 in the first and in the last three numbers of an action."""


class Steering(Record):
    """A decision that a policy steers, as compiled code takes it. In map."""

    x_c = field("m", "base_link at contact", 3)
    x_r = field("m", "where to rest in the end", 3)
    along = field("1", "x of the policy's frame, in the plane", 2)
    timeout = field("s", "so long after the decision it is over")
    yaw = field("rad", "the heading asked for")
    rotor = field("1", "that was struck, -1: not known", kind=int)
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
    """Write what a policy sees.

    Args:
        steering: the decision.
        time_s: since it [s].
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
def _turn_in(steering: Steering, to: AnyVector, since: Array, out: Array, first: int) -> None:
    """Write the vector from `since` (3) to `to` (3), both in map, in the policy's frame."""
    x, y = to[0] - since[0], to[1] - since[1]
    c, s = steering.along[0], steering.along[1]
    out[first] = c * x + s * y
    out[first + 1] = c * y - s * x
    out[first + 2] = to[2] - since[2]


@compiled(inline=False)
def steer(steering: Steering, action: Array, attitude: Array, rates: Array, out: Any) -> None:
    """Write the set point that an action asks for; no action (zeros) asks for rest at x_r.

    Args:
        steering: the decision; its heading follows the vehicle while it turns.
        action: (6) offset from x_r over `REACH`, acceleration fed forward over `ACCELERATION`, in
            the policy's frame; cut at -1 and 1, NaN is 0.
        attitude: (4) estimate, quaternion xyzw.
        rates: (3) estimate, base_link [rad/s].
        out: `PositionSetpointRecord`; position, velocity, acceleration and yaw are filled.
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
    if turns(rates):
        x, y, _ = rotated(attitude, (1.0, 0.0, 0.0))
        steering.yaw = math.atan2(y, x)
    out.yaw = steering.yaw


@compiled(inline=False)
def steering_over(
    steering: Steering, time_s: float, position: Array, velocity: AnyVector, rates: Array
) -> bool:
    """Return whether the vehicle rests at x_r, or time is up; arguments as of `observe`."""
    return bool(time_s > steering.timeout or at_rest(position, velocity, rates, steering.x_r))
