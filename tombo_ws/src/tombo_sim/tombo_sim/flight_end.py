"""Decides from the truth when there is no more to see of a flight: landed, or crashed."""

from __future__ import annotations

from tombo_control.autopilot import IDLE, LAND, LANDED, TAKEOFF

_AFTER_LANDING_S = 1.0
_AFTER_CRASH_S = 1.5


class FlightEndDetector:
    """Watches one flight, as often as one likes."""

    def __init__(self, leg_height: float) -> None:
        self._ground = leg_height
        self._airborne = False
        self._over = False

    def watch(self, height: float, upright: float, mode: int) -> float | None:
        """Return how long to go on [s] once the flight is decided, else None.

        Args:
            height: of the vehicle in map [m].
            upright: cosine of its tilt.
            mode: of the mission.
        """
        if height > self._ground + 0.3:
            self._airborne = True
        if self._over or not self._airborne:
            return None
        if mode == LANDED:
            self._over = True
            return _AFTER_LANDING_S
        fallen = height < self._ground - 0.02 or (height < self._ground + 0.05 and upright < 0.8)
        if fallen and mode not in (IDLE, TAKEOFF, LAND):
            self._over = True
            return _AFTER_CRASH_S
        return None
