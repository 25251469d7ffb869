"""What travels between the cores: one frozen dataclass for each message, and its constants.

The fields are those of the ROS messages (`tombo_msgs` and the standard ones); a test compares the
constants. Stamps are capture times [ns]. World `map` is ENU, body `base_link` FLU, SI units,
quaternions xyzw.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, Self

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.vehicle import GRAVITY


class Phase(IntEnum):
    """Phase of the flight, as in `tombo_msgs/MissionStatus`."""

    IDLE = 0
    TAKEOFF = 1
    HOVER = 2
    APPROACH = 3
    REACT = 4
    HOLD = 5
    LAND = 6
    LANDED = 7
    DESCEND_BLIND = 8


PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)


class Reason(IntEnum):
    """Base of the reasons why something is not done, each with a text for users; 0: it is done."""

    text: str

    def __new__(cls, value: int, text: str = "") -> Self:
        """Make a member of its number and its text."""
        member = int.__new__(cls, value)
        member._value_ = value
        member.text = text
        return member

    @property
    def key(self) -> str:
        """The name as users see it; empty for 0."""
        return self.name.lower() if self else ""


class RecoveryMode(IntEnum):
    """Which gains the controller flies with, as in `tombo_msgs/PositionSetpoint`."""

    OFF = 0
    ON_CONTACT = 1
    ON = 2


class ReactionPhase(IntEnum):
    """What the reaction does, as in `tombo_msgs/ReactionStatus`."""

    IDLE = 0
    REACTING = 1
    BLIND = 2
    HOLDING = 3


class Trigger(IntEnum):
    """What detected a collision, as in `tombo_msgs/CollisionEvent`."""

    REGION = 1
    INNOVATION = 2
    IMU = 3


UNKNOWN_ROTOR = -1
"""A collision whose rotor is not known, as in `tombo_msgs/CollisionEvent`."""


@dataclass(frozen=True)
class Pose:
    """`/mocap/pose`: pose of base_link in map as the motion capture sees it."""

    stamp_ns: int
    frame_id: str
    position: Array
    """(3) [m]."""
    attitude: Array
    """(4) xyzw, map from base_link."""


@dataclass(frozen=True)
class Imu:
    """`/imu/data_raw`."""

    stamp_ns: int
    gyro: Array
    """(3) [rad/s], base_link."""
    accel: Array
    """(3) specific force [m/s^2], base_link."""


def unknown_covariance() -> Array:
    """Return a covariance (36) that says nothing."""
    return np.zeros(36)


@dataclass(frozen=True)
class Odometry:
    """`/odometry`: the estimate at the capture of its newest gyro sample."""

    stamp_ns: int
    position: Array
    """(3) of base_link in map [m]."""
    attitude: Array
    """(4) xyzw, map from base_link."""
    velocity: Array
    """(3) [m/s], in base_link as nav_msgs/Odometry has it."""
    rates: Array
    """(3) [rad/s], base_link, bias removed."""
    pose_covariance: Array = field(default_factory=unknown_covariance)
    """(36) 6 x 6 by rows: position [m^2], turns about the axes of map [rad^2]; 0: not known."""
    twist_covariance: Array = field(default_factory=unknown_covariance)
    """(36) the same of velocity [m^2/s^2], 0 on the ground, and rates [rad^2/s^2], base_link."""


@dataclass(frozen=True)
class EstimatorStatus:
    """`/estimator/status`."""

    stamp_ns: int
    initialised: bool
    gyro_bias: Array
    """(3) [rad/s], base_link."""
    accel_bias: Array
    """(3) [m/s^2], base_link."""
    pose_stamp_ns: int
    """Capture time of the last pose used."""
    poses: int
    rejected: int


@dataclass(frozen=True)
class PositionSetpoint:
    """`/mission/setpoint` and `/setpoint`: where the vehicle shall be."""

    stamp_ns: int
    position: Array
    """(3) of base_link in map [m]."""
    velocity: Array
    """(3) in map, fed forward [m/s]."""
    acceleration: Array
    """(3) in map, fed forward, without gravity [m/s^2]."""
    yaw: float
    """[rad] about map +z, counter-clockwise from east."""
    phase: int
    """A `Phase`."""
    recovery: int = RecoveryMode.OFF
    """A `RecoveryMode`."""
    takeoff_commands: int = 0
    """How often an operator has asked the mission to take off; `auto_start` is none."""

    def finite(self) -> bool:
        """Return whether every number is finite."""
        total = self.position.sum() + self.velocity.sum() + self.acceleration.sum() + self.yaw
        return bool(np.isfinite(total))


@dataclass(frozen=True)
class MissionStatus:
    """`/mission/status`, at each change."""

    stamp_ns: int
    phase: int
    """A `Phase`."""
    text: str


@dataclass(frozen=True)
class CollisionEvent:
    """`/collision_event` of the motion capture, `/contact_event` of the IMU."""

    stamp_ns: int
    """Capture time of the sample that triggered."""
    frame_id: str
    trigger: int
    """A `Trigger`."""
    contact_stamp_ns: int
    """Estimated time of contact."""
    contact_position: Array
    """(3) x_c: base_link in map at contact [m]."""
    flight_direction: Array
    """(3) unit vector in map along the velocity before contact."""
    confidence: float
    """0 a guess, 1 certain."""
    statistic: float
    """The trigger's test value."""
    count: int
    """Collisions of this flight so far, this one included."""
    rotor: int = UNKNOWN_ROTOR
    """Struck rotor; -1: not known."""
    push: Array = field(default_factory=lambda: np.zeros(3))
    """(3) unit vector in map of the push on the vehicle; zero: not known."""


@dataclass(frozen=True)
class DetectorStatus:
    """`/detector/status`, for each pose."""

    stamp_ns: int
    statistic: float
    threshold: float
    poses: int
    rejected: int


@dataclass(frozen=True)
class ReactionStatus:
    """`/reaction/status`, at each change."""

    stamp_ns: int
    state: int
    """A `ReactionPhase`."""
    x_c: Array
    """(3) base_link in map at contact [m]; NaN while no decision is active."""
    x_r: Array
    """(3) where to hold [m]; NaN while no decision is active."""
    n_r: Array
    """(3) unit vector in map from x_c to x_r; NaN while no decision is active."""
    collisions: int


@dataclass(frozen=True)
class RotorCommand:
    """`/rotor_command`."""

    stamp_ns: int
    """Capture time of the gyro sample behind it."""
    speed: Array
    """(4) [rad/s]."""


@dataclass(frozen=True)
class AttitudeSetpoint:
    """`/attitude_setpoint`, of the position loop."""

    stamp_ns: int
    attitude: Array
    """(4) xyzw, map from base_link."""
    thrust: float
    """Collective [N]."""


@dataclass(frozen=True)
class RatesSetpoint:
    """`/rates_setpoint`, of the attitude loop."""

    stamp_ns: int
    rates: Array
    """(3) [rad/s], base_link."""
    thrust: float
    """Collective [N]."""


_NEUTRAL: dict[str, Any] = {
    "frame_id": FRAME_MAP,
    "attitude": (0.0, 0.0, 0.0, 1.0),
    "accel": (0.0, 0.0, GRAVITY),
    "flight_direction": (1.0, 0.0, 0.0),
    "speed": (0.0, 0.0, 0.0, 0.0),
    "pose_covariance": 36 * (0.0,),
    "twist_covariance": 36 * (0.0,),
    "phase": int(Phase.HOVER),
    "trigger": int(Trigger.REGION),
    "state": int(ReactionPhase.IDLE),
}
_NEUTRAL_OF_TYPE = {"Array": (0.0, 0.0, 0.0), "float": 0.0, "int": 0, "bool": True, "str": ""}


def neutral(kind: type, stamp_ns: int) -> Any:
    """Return a message of a vehicle that hovers level at the origin, for warm-up and tests."""
    values = {}
    for one in fields(kind):
        value = _NEUTRAL.get(one.name, _NEUTRAL_OF_TYPE[str(one.type)])
        if one.name.endswith("stamp_ns"):
            value = stamp_ns
        values[one.name] = np.array(value) if one.type == "Array" else value
    return kind(**values)
