"""Flight time [s] as the integer times [ns] of messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array

EPOCH_NS = 1_000_000_000
"""Flight time 0 in a file: one second, since 0 means "no time" to many readers."""


def nanoseconds(times_s: Any) -> NDArray[np.int64]:
    """Turn flight times [s] into stamps [ns], exact to the nanosecond, never below 0."""
    scaled = np.rint(np.asarray(times_s, np.float64) * 1e9).astype(np.int64)
    return np.asarray(np.maximum(scaled + EPOCH_NS, 0))


def flight_seconds(times_ns: Any) -> Array:
    """Turn stamps or log times [ns] back into flight time [s]."""
    return np.asarray((np.asarray(times_ns, np.int64) - EPOCH_NS) / 1e9)


def split_stamps(times_ns: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Split times [ns] into the two fields of a stamp: whole seconds and the rest [ns]."""
    return np.divmod(times_ns, 1_000_000_000)


def stamp(time_ns: int) -> dict[str, int]:
    """Return one time [ns] as the fields of builtin_interfaces/Time."""
    seconds, rest = divmod(int(time_ns), 1_000_000_000)
    return {"sec": seconds, "nanosec": rest}
