"""What the simulator writes down in every tick."""

from __future__ import annotations

import math
from collections import namedtuple
from typing import Any

import numpy as np

from tombo_dynamics.records import Record, field


class LogRow(Record):
    """Truth, then what the autopilot knew and wanted. Map is ENU, body FLU."""

    position = field("m", "map", 3)
    velocity = field("m/s", "map", 3)
    attitude = field("1", "quaternion xyzw, map from body", 4)
    rates = field("rad/s", "body", 3)
    rotor_speed = field("rad/s", "of each rotor", 4)
    rotor_thrust = field("N", "of each rotor", 4)
    fold = field("1", "0: blade straight, 1: folded back", 4)
    damage = field("1", "0: new, 1: torn off", 4)
    contact_force = field("N", "of the obstacle on blades and frame, map", 3)
    contact = field("", "touching (0/1), rotor (-1: frame), point in map [m] (3)", 5)
    gyro = field("rad/s", "as measured, body", 3)
    accel = field("m/s^2", "specific force as measured, body", 3)
    est_position = field("m", "estimated, map", 3)
    est_velocity = field("m/s", "estimated, map", 3)
    est_attitude = field("1", "estimated quaternion xyzw", 4)
    position_setpoint = field("m", "map", 3)
    velocity_setpoint = field("m/s", "what the reference feeds forward, map", 3)
    acceleration_setpoint = field("m/s^2", "what the reference feeds forward, map", 3)
    attitude_setpoint = field("1", "quaternion xyzw", 4)
    rates_setpoint = field("rad/s", "body", 3)
    thrust_setpoint = field("N", "collective", 1)
    rotor_command = field("rad/s", "of each rotor", 4)
    mode = field("1", "phase of the set point, or blind", 1)
    wind = field("m/s", "velocity of the air, map", 3)
    battery = field("", "charge used [A h], current [A], voltage [V]", 3)


Log = namedtuple("Log", list(LogRow.fields))  # type: ignore[misc]
"""One array a column of `LogRow`, a row a tick."""


_STAGGER = 8
"""Numbers, of 8 bytes: a line of cache."""


def new_log(ticks: int) -> Any:
    """Return an empty `Log`: each column lies in one piece, since it is read as one.

    All are written in every tick, so they start at different places of their memory pages: a
    processor's first cache has room for few lines of the same place.
    """
    shapes = [one.shape for one in LogRow.fields.values()]
    sizes = [-(-ticks * math.prod(shape) // 512) * 512 + _STAGGER for shape in shapes]
    pieces = np.split(np.zeros(sum(sizes)), np.cumsum(sizes)[:-1])
    return Log(
        *(
            piece[: ticks * math.prod(shape)].reshape(ticks, *shape)
            for piece, shape in zip(pieces, shapes, strict=True)
        )
    )


def part_of(log: Any, ticks: int) -> Any:
    """Return the first rows of a `Log`: views."""
    return Log(*(column[:ticks] for column in log))
