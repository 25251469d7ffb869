"""Results, states and texts of the vehicle, with the numbers of MAVLink."""

from __future__ import annotations

from enum import IntEnum
from typing import Final, NamedTuple

FORCE_ARMING: Final = 21196
"""Second parameter of ARM_DISARM that leaves out all checks."""


class Result(IntEnum):
    """Answer to a command (MAV_RESULT)."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5
    CANCELLED = 6
    UNSUPPORTED_FRAME = 8
    """MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME."""


class Severity(IntEnum):
    """Severity of a text (MAV_SEVERITY)."""

    EMERGENCY = 0
    ALERT = 1
    CRITICAL = 2
    ERROR = 3
    WARNING = 4
    NOTICE = 5
    INFO = 6


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
