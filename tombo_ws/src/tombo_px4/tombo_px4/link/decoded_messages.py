"""Messages of PX4 as records in ENU/FLU and SI; `message_decoder.py` makes them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

from tombo_dynamics.arrays import Array
from tombo_px4.modes import Mode

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


class RefusedMessage(ValueError):
    """A message that can't be used; the text is the reason that is counted."""


@dataclass(frozen=True)
class StampedMessage:
    """A message with the time of what it tells."""

    arrival_ns: int
    stamp_ns: int | None
    """Of the content, our clock; None while the clocks are not known to each other."""
    boot_ns: int
    """The same in PX4's clock."""


@dataclass(frozen=True)
class Heartbeat:
    """HEARTBEAT of the autopilot."""

    arrival_ns: int
    armed: bool
    mode: Mode
    failsafe: bool = False
    """PX4 flies another mode than was asked for, or has stopped its rotors for good."""


@dataclass(frozen=True)
class VehicleOdometry(StampedMessage):
    """PX4's estimate."""

    position: Array
    """(3) in map [m]."""
    attitude: Array
    """(4) xyzw, map from base_link, unit."""
    velocity: Array
    """(3) in map [m/s]."""
    rates: Array
    """(3) base_link [rad/s]."""
    pose_covariance: Array | None
    """(6, 6) in axes of map; None: PX4 does not know it."""
    resets: int
    """Counts jumps of PX4's own estimate."""


@dataclass(frozen=True)
class VehicleImu(StampedMessage):
    """PX4's gyro and accelerometer."""

    gyro: Array
    """(3) base_link [rad/s]."""
    accel: Array
    """(3) specific force, base_link [m/s^2]."""
    pressure_altitude: float = math.nan
    """Height that the barometer shows [m]; NaN: not sent."""


@dataclass(frozen=True)
class ThrustSetpoint:
    """Collective thrust that PX4 commands (ATTITUDE_TARGET)."""

    arrival_ns: int
    throttle: float
    """0 to 1."""


@dataclass(frozen=True)
class BatteryReading:
    """Voltage [V], current [A], what is left 0..1; NaN: not known."""

    arrival_ns: int
    voltage: float
    current: float
    remaining: float
    cells: tuple[float, ...] = ()
    """[V] of each cell, as far as known."""


@dataclass(frozen=True)
class BatterySummary(BatteryReading):
    """The battery as SYS_STATUS has it, without its cells."""


@dataclass(frozen=True)
class StatusText:
    """A text of PX4 (STATUSTEXT)."""

    arrival_ns: int
    severity: int
    """MAV_SEVERITY: 0 emergency .. 3 error, 4 warning, 6 info."""
    text: str


@dataclass(frozen=True)
class CommandAck:
    """PX4's answer to a command; to DO_SET_MODE there are two, and the first says nothing."""

    arrival_ns: int
    command: int
    result: int


@dataclass(frozen=True)
class ParameterValue:
    """A parameter of the vehicle."""

    name: str
    value: float | int
    kind: int
    """MAV_PARAM_TYPE."""


@dataclass(frozen=True)
class EstimatorStatusFlags:
    """State of PX4's estimator (ESTIMATOR_STATUS)."""

    arrival_ns: int
    has_position: bool
    """Horizontal, relative or absolute."""
    is_aided: bool
    """A position source is fused. (CONST_POS_MODE does not tell: it is set at rest, too.)"""
    position_ratio: float
    """Innovation test ratio; above 1 the poses are refused. NaN: not reported."""
    height_ratio: float


@dataclass(frozen=True)
class TimesyncMessage:
    """TIMESYNC: a request (tc1 = 0) or an answer."""

    arrival_ns: int
    tc1: int
    ts1: int


@dataclass(frozen=True)
class AutopilotVersion:
    """AUTOPILOT_VERSION."""

    firmware: str
    """`major.minor.patch`."""
    hardware_id: str
    """The autopilot's unique number, hexadecimal; empty: it has none."""
