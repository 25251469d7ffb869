"""States of the simulated vehicle: what denies arming, battery, take-off."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple


class Health(NamedTuple):
    """Reasons that deny arming, as texts for the operator, and what is known."""

    problems: tuple[str, ...]
    """Empty: it may be armed in the present mode."""
    attitude: bool
    local_position: bool
    global_position: bool
    home: bool

    @property
    def armable(self) -> bool:
        """Whether arming is allowed in the current mode."""
        return not self.problems


class Battery(NamedTuple):
    """State of the battery."""

    voltage: float
    """[V]."""
    current: float
    """Drawn [A]."""
    remaining: float
    """Share of the charge, 1: full."""
    warning: int
    """0 none, 1 low, 2 critical, 3 emergency."""


class TakeoffState(IntEnum):
    """State of a take-off (PX4 `takeoff_status`)."""

    DISARMED = 1
    SPOOLUP = 2
    READY = 3
    RAMPUP = 4
    FLIGHT = 5
