"""Decides from the truth when there is no more to see of a flight: landed, or crashed."""

from __future__ import annotations

from typing import Any

import numpy as np

from tombo_control.autopilot import IDLE, LAND, LANDED, TAKEOFF
from tombo_dynamics.jit import compiled

_AFTER_LANDING_S = 1.0
_AFTER_CRASH_S = 1.5
UNDECIDED = -1.0

FLIGHT_END = np.dtype(
    [
        ("ground", np.float64),  # height of a vehicle that stands on the ground [m]
        ("airborne", np.bool_),  # it has flown
        ("over", np.bool_),  # the end is decided
    ],
    align=True,
)


@compiled
def watch_end(r: Any, height: float, upright: float, phase: int) -> float:
    """Return how long to go on [s] once the flight is decided, else `UNDECIDED`.

    Args:
        r: memory, `FLIGHT_END`.
        height: of the vehicle in map [m].
        upright: cosine of its tilt.
        phase: of the mission.
    """
    if height > r.ground + 0.3:
        r.airborne = True
    if r.over or not r.airborne:
        return UNDECIDED
    if phase == LANDED:
        r.over = True
        return _AFTER_LANDING_S
    fallen = height < r.ground - 0.02 or (height < r.ground + 0.05 and upright < 0.8)
    if fallen and phase != IDLE and phase != TAKEOFF and phase != LAND:
        r.over = True
        return _AFTER_CRASH_S
    return UNDECIDED


class FlightEndDetector:
    """Watches one flight, as often as one likes."""

    def __init__(self, leg_height: float) -> None:
        self._memory: Any = np.zeros(1, FLIGHT_END)[0]
        self._memory["ground"] = leg_height

    def watch(self, height: float, upright: float, phase: int) -> float | None:
        """Return how long to go on [s] once the flight is decided, else None (`watch_end`)."""
        after = watch_end(self._memory, height, upright, phase)
        return None if after == UNDECIDED else after
