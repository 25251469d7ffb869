"""PX4's flight modes, the number that carries them in a heartbeat, and MAVLink's enumerations.

Numbers: PX4 `px4_custom_mode.h`; main mode in bits 16 to 23, sub mode in bits 24 to 31.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from enum import IntEnum
from typing import Any, Final, NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import Phase

FORCE_ARMING: Final = 21196
"""Second parameter of ARM_DISARM that leaves out all checks."""


class MavLandedState(IntEnum):
    """MAV_LANDED_STATE, the content of EXTENDED_SYS_STATE."""

    UNDEFINED = 0
    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4


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


class Mode(NamedTuple):
    """A flight mode."""

    main: int
    sub: int = 0


MANUAL = Mode(1)
ALTCTL = Mode(2)
POSCTL = Mode(3)
AUTO_READY = Mode(4, 1)
AUTO_TAKEOFF = Mode(4, 2)
AUTO_HOLD = Mode(4, 3)
AUTO_MISSION = Mode(4, 4)
AUTO_RTL = Mode(4, 5)
AUTO_LAND = Mode(4, 6)
ACRO = Mode(5)
OFFBOARD = Mode(6)
STABILIZED = Mode(7)
MODE_NAMES = {
    MANUAL: "manual",
    ALTCTL: "altitude",
    POSCTL: "position",
    AUTO_READY: "ready",
    AUTO_TAKEOFF: "takeoff",
    AUTO_HOLD: "hold",
    AUTO_MISSION: "mission",
    AUTO_RTL: "return",
    AUTO_LAND: "land",
    ACRO: "acro",
    OFFBOARD: "offboard",
    STABILIZED: "stabilized",
}
_AUTO = 4


def custom_mode(mode: Mode) -> int:
    """Return the number of a mode in HEARTBEAT.custom_mode."""
    return mode.main << 16 | mode.sub << 24


def mode_of(number: int) -> Mode:
    """Return the mode of HEARTBEAT.custom_mode; sub modes of other than AUTO are dropped."""
    main = number >> 16 & 0xFF
    return Mode(main, number >> 24 & 0xFF if main == _AUTO else 0)


def mode_name(mode: Mode) -> str:
    """Return the name a person reads; `mode 9.2` for one that is not known here."""
    return MODE_NAMES.get(mode, f"mode {mode.main}.{mode.sub}")


_LANDS = (mode_name(AUTO_LAND), mode_name(AUTO_RTL))
"""Modes that end on the ground."""


def landing_phases(armed: Iterable[Any], modes: Iterable[str]) -> Array:
    """Return the phase at each status of PX4: LAND, LANDED after it, NaN where it flies on.

    Args:
        armed: (N,) whether it is armed.
        modes: (N,) names of its modes.
    """
    phases = []
    phase = math.nan
    for is_armed, mode in zip(armed, modes, strict=True):
        if is_armed:
            phase = float(Phase.LAND) if mode in _LANDS else math.nan
        elif phase == Phase.LAND:
            phase = float(Phase.LANDED)
        phases.append(phase)
    return np.array(phases)
