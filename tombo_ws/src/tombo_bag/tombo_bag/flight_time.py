"""Time base and metadata records of a recorded flight."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS

FLIGHT_METADATA = "tombo_flight"
"""Metadata record with the scenario, the events and the epoch of a flight."""
RECORDER_METADATA = "tombo_recorder"
"""Metadata record with the recorder's counts of messages and losses."""


def nanoseconds(times_s: Any) -> NDArray[np.int64]:
    """Turn flight times [s] into stamps [ns], exact to the nanosecond, never below 0."""
    scaled = np.rint(np.asarray(times_s, np.float64) * SECOND_NS).astype(np.int64)
    return np.asarray(np.maximum(scaled + EPOCH_NS, 0))


def stamp(time_ns: int) -> dict[str, int]:
    """Return one time [ns] as the fields of builtin_interfaces/Time."""
    seconds, rest = divmod(int(time_ns), SECOND_NS)
    return {"sec": seconds, "nanosec": rest}
