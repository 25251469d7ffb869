"""Messages to arrays and back; times as integer nanoseconds."""

from __future__ import annotations

from typing import Any

import numpy as np
from builtin_interfaces.msg import Time

from tombo_dynamics.arrays import Array
from tombo_dynamics.time_base import SECOND_NS


def to_ns(time: Any) -> int:
    """Return a builtin_interfaces/Time as nanoseconds."""
    return int(time.sec) * SECOND_NS + int(time.nanosec)


def to_time(time_ns: int) -> Time:
    """Return nanoseconds as builtin_interfaces/Time; below 0 becomes 0."""
    seconds, rest = divmod(max(int(time_ns), 0), SECOND_NS)
    return Time(sec=min(seconds, 2**31 - 1), nanosec=rest)


def array(value: Any) -> Array:
    """Return a Point or Vector3 as (3), a Quaternion as (4) xyzw."""
    if hasattr(value, "w"):
        return np.array([value.x, value.y, value.z, value.w])
    return np.array([value.x, value.y, value.z])
