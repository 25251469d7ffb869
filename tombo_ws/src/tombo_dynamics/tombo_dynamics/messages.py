"""What travels between the cores: one frozen dataclass for each message, and its constants.

The three standard ones are first, then those of `tombo_msgs`: one for each `.msg` file whose
fields have a fixed number of values. Stamps are capture times [ns]. World `map` is ENU, body
`base_link` FLU, SI units, quaternions xyzw.

The metadata of a field are its `unit` (none: it has no unit), the `length` of an array, and the
`path` where the message calls it otherwise. A class has the `frame` of its header, unless it
carries that as `frame_id`, and the `fixed` values of the message.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import Any, ClassVar, Self

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.frames import FRAME_BODY, FRAME_MAP
from tombo_dynamics.vehicle import GRAVITY


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


@dataclass(frozen=True)
class Pose:
    """`/mocap/pose`: pose of base_link in map as the motion capture sees it."""

    typename: ClassVar[str] = "geometry_msgs/msg/PoseStamped"
    stamp_ns: int = field(metadata={"unit": "ns"})
    frame_id: str
    position: Array = field(metadata={"unit": "m", "length": 3, "path": "pose.position"})
    attitude: Array = field(metadata={"unit": "1", "length": 4, "path": "pose.orientation"})
    """Quaternion xyzw, map from base_link."""


@dataclass(frozen=True)
class Imu:
    """`/imu/data_raw`."""

    typename: ClassVar[str] = "sensor_msgs/msg/Imu"
    frame: ClassVar[str] = FRAME_BODY
    fixed: ClassVar[Mapping[str, Any]] = {
        "orientation": {"w": 1.0},
        "orientation_covariance": [-1.0] + 8 * [0.0],
    }
    stamp_ns: int = field(metadata={"unit": "ns"})
    gyro: Array = field(metadata={"unit": "rad/s", "length": 3, "path": "angular_velocity"})
    """In base_link."""
    accel: Array = field(metadata={"unit": "m/s^2", "length": 3, "path": "linear_acceleration"})
    """Specific force in base_link."""


def unknown_covariance() -> Array:
    """Return a covariance (36) that says nothing."""
    return np.zeros(36)


@dataclass(frozen=True)
class Odometry:
    """`/odometry`: the estimate at the capture of its newest gyro sample."""

    typename: ClassVar[str] = "nav_msgs/msg/Odometry"
    frame: ClassVar[str] = FRAME_MAP
    fixed: ClassVar[Mapping[str, Any]] = {"child_frame_id": FRAME_BODY}
    stamp_ns: int = field(metadata={"unit": "ns"})
    position: Array = field(metadata={"unit": "m", "length": 3, "path": "pose.pose.position"})
    """Of base_link in map."""
    attitude: Array = field(metadata={"unit": "1", "length": 4, "path": "pose.pose.orientation"})
    """Quaternion xyzw, map from base_link."""
    velocity: Array = field(metadata={"unit": "m/s", "length": 3, "path": "twist.twist.linear"})
    """In base_link, as nav_msgs/Odometry has it."""
    rates: Array = field(metadata={"unit": "rad/s", "length": 3, "path": "twist.twist.angular"})
    """In base_link, bias removed."""
    pose_covariance: Array = field(
        default_factory=unknown_covariance,
        metadata={"unit": "m^2, rad^2", "length": 36, "path": "pose.covariance"},
    )
    """6 x 6 by rows: position, turns about the axes of map; 0: not known."""
    twist_covariance: Array = field(
        default_factory=unknown_covariance,
        metadata={"unit": "m^2/s^2, rad^2/s^2", "length": 36, "path": "twist.covariance"},
    )
    """6 x 6 by rows: velocity, 0 on the ground, and rates, in base_link; 0: not known."""


class Trigger(IntEnum):
    """Values of `CollisionEvent.trigger`."""

    REGION = 1  # the vehicle entered the known region around the obstacle
    INNOVATION = 2  # the pose left the prediction: an unknown obstacle
    IMU = 3  # the accelerometer saw a push


class Phase(IntEnum):
    """Values of `MissionStatus.phase`."""

    IDLE = 0
    TAKEOFF = 1
    HOVER = 2
    APPROACH = 3
    REACT = 4
    HOLD = 5
    LAND = 6
    LANDED = 7
    DESCEND_BLIND = 8


class RecoveryMode(IntEnum):
    """Values of `PositionSetpoint.recovery`."""

    OFF = 0  # the controller flies with the cascade's gains
    ON_CONTACT = 1  # it changes to those of the recovery when the accelerometer sees a strike
    ON = 2  # it flies with those of the recovery


class ReactionPhase(IntEnum):
    """Values of `ReactionStatus.state`."""

    IDLE = 0  # passes the mission's setpoint on
    REACTING = 1  # holds x_r = x_c + d_r n_r
    BLIND = 2  # the pose is stale: descends without it
    HOLDING = 3  # the detector or the mission is silent: holds where the vehicle was


ROTOR_UNKNOWN = -1
"""`CollisionEvent.ROTOR_UNKNOWN`: value of rotor where the trigger can't tell."""


ROTOR_FRAME = -1
"""`Contact.FRAME`: value of rotor when the frame touches, no propeller."""


@dataclass(frozen=True)
class AttitudeSetpoint:
    """Wanted attitude and total thrust: the output of the position loop at 50 Hz."""

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the pose sample behind it."""
    orientation: Array = field(metadata={"unit": "1", "length": 4})
    """Unit quaternion xyzw that turns base_link vectors into map."""
    thrust: float = field(metadata={"unit": "N"})
    """Sum of the four rotors along base_link +z."""


@dataclass(frozen=True)
class CollisionEvent:
    """A collision.

    Seen by the detector in the motion-capture pose, or by the controller in the IMU.
    """

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the sample that triggered."""
    frame_id: str
    trigger: int
    """A `Trigger`."""
    contact_stamp_ns: int = field(metadata={"unit": "ns"})
    """Estimate of the time of contact, before the sample; clock of header."""
    contact_position: Array = field(metadata={"unit": "m", "length": 3})
    """x_c: position of base_link in map at contact, estimated."""
    flight_direction: Array = field(metadata={"unit": "1", "length": 3})
    """Unit vector in map along the velocity before contact."""
    confidence: float
    """0 a guess, 1 certain."""
    statistic: float
    """The trigger's test value when it fired."""
    count: int
    """Collisions of this flight so far, this one included."""
    rotor: int = ROTOR_UNKNOWN
    """Struck rotor in the order of RotorSpeeds, or ROTOR_UNKNOWN."""
    push: Array = field(default_factory=lambda: np.zeros(3), metadata={"unit": "1", "length": 3})
    """Unit vector in map, horizontal, of the push on the vehicle; zero: not known."""


@dataclass(frozen=True)
class Contact:
    """True contact of the vehicle with the obstacle or the ground."""

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Time of the contact."""
    in_contact: bool
    """True while something touches."""
    rotor: int
    """Rotor index in the order of RotorSpeeds, or FRAME."""
    force: Array = field(metadata={"unit": "N", "length": 3})
    """On the vehicle, in map."""
    point: Array = field(metadata={"unit": "m", "length": 3})
    """Of the contact, in map."""


@dataclass(frozen=True)
class DetectorStatus:
    """Result of the collision detector for one pose of the motion capture.

    Published for each, so it is also the detector's sign of life.
    """

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the pose."""
    statistic: float
    """Test value of this pose, 0 where there was none."""
    threshold: float
    """Test value that fires."""
    poses: int
    """Poses taken since the start."""
    rejected: int
    """Poses refused since the start: late, from the future, not a number, jumped."""


@dataclass(frozen=True)
class EstimatorStatus:
    """Sensor biases of the estimator, and counts of its poses."""

    frame: ClassVar[str] = FRAME_BODY
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the newest gyro sample."""
    initialised: bool
    """False until enough poses have come."""
    gyro_bias: Array = field(metadata={"unit": "rad/s", "length": 3})
    """In base_link, subtracted from the gyro."""
    accel_bias: Array = field(metadata={"unit": "m/s^2", "length": 3})
    """In base_link, subtracted from the accelerometer."""
    pose_stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the last pose that was used; clock of header."""
    poses: int
    """Poses used since the start."""
    rejected: int
    """Poses refused since the start: late, from the future, not a number, jumped."""


@dataclass(frozen=True)
class MissionStatus:
    """Phase of the flight."""

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Time of the status."""
    phase: int
    """A `Phase`."""
    text: str
    """The phase in words, for a person."""


@dataclass(frozen=True)
class PositionSetpoint:
    """Where the vehicle shall be.

    The mission's wish, and after the reaction what the controller follows.
    """

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Time of the setpoint."""
    position: Array = field(metadata={"unit": "m", "length": 3})
    """Of base_link in map."""
    velocity: Array = field(metadata={"unit": "m/s", "length": 3})
    """Of base_link in map, fed forward."""
    acceleration: Array = field(metadata={"unit": "m/s^2", "length": 3})
    """Of base_link in map, fed forward, without gravity."""
    yaw: float = field(metadata={"unit": "rad"})
    """Of base_link about map +z, counter-clockwise from east."""
    phase: int
    """Phase of the flight, a constant of MissionStatus."""
    recovery: int = 0
    """Which gains the controller flies with, a `RecoveryMode`."""
    takeoff_commands: int = 0
    """How often an operator has asked the mission to take off; auto_start is none."""


@dataclass(frozen=True)
class RatesSetpoint:
    """Wanted body rates and total thrust: the output of the attitude loop at 250 Hz."""

    frame: ClassVar[str] = FRAME_BODY
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the sample behind it."""
    rates: Array = field(metadata={"unit": "rad/s", "length": 3})
    """Of base_link against map, given in base_link."""
    thrust: float = field(metadata={"unit": "N"})
    """Sum of the four rotors along base_link +z."""


@dataclass(frozen=True)
class ReactionStatus:
    """State of the reaction, which passes the mission's setpoint on or replaces it."""

    frame: ClassVar[str] = FRAME_MAP
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Time of the decision."""
    state: int
    """A `ReactionPhase`."""
    x_c: Array = field(metadata={"unit": "m", "length": 3})
    """Position of base_link in map at contact; NaN while IDLE."""
    x_r: Array = field(metadata={"unit": "m", "length": 3})
    """Position in map to hold after the collision; NaN while IDLE."""
    n_r: Array = field(metadata={"unit": "1", "length": 3})
    """Unit vector in map, from x_c to x_r; NaN while IDLE."""
    collisions: int
    """Collisions of this flight so far."""


@dataclass(frozen=True)
class RotorSpeeds:
    """Commanded rotor speeds: the output of the allocation.

    Rotor order: 0 front right, 1 rear left, 2 front left, 3 rear right. Rotors 0 and 1 turn
    counter-clockwise seen from above, 2 and 3 clockwise; a speed is positive either way.
    """

    frame: ClassVar[str] = FRAME_BODY
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Capture time of the gyro sample behind the command."""
    speed: Array = field(metadata={"unit": "rad/s", "length": 4})
    """About each rotor's own axis, base_link +z for all; 0 and above."""


@dataclass(frozen=True)
class RotorState:
    """True state of the four rotors and their folding propellers.

    In the rotor order of RotorSpeeds.
    """

    frame: ClassVar[str] = FRAME_BODY
    stamp_ns: int = field(metadata={"unit": "ns"})
    """Time of the state."""
    speed: Array = field(metadata={"unit": "rad/s", "length": 4})
    """About each rotor's own axis, base_link +z; 0 and above."""
    thrust: Array = field(metadata={"unit": "N", "length": 4})
    """Along base_link +z."""
    fold: Array = field(metadata={"unit": "1", "length": 4})
    """In the propeller's own frame: 0 blades stretched out, 1 folded by an impact."""
    damage: Array = field(metadata={"unit": "1", "length": 4})
    """In the propeller's own frame: 0 new, 1 broken or worn out."""


MESSAGES: tuple[type[Any], ...] = (
    AttitudeSetpoint,
    CollisionEvent,
    Contact,
    DetectorStatus,
    EstimatorStatus,
    MissionStatus,
    PositionSetpoint,
    RatesSetpoint,
    ReactionStatus,
    RotorSpeeds,
    RotorState,
)
"""Those of `tombo_msgs`."""

STANDARD_MESSAGES: tuple[type[Any], ...] = (Pose, Imu, Odometry)
PHASE_NAMES = tuple(phase.name.lower() for phase in Phase)


def typename_of(kind: type) -> str:
    """Return the type name of the ROS message of a dataclass."""
    return str(getattr(kind, "typename", f"tombo_msgs/msg/{kind.__name__}"))


def is_finite(message: Any) -> bool:
    """Return whether every number of a message is finite."""
    values = (getattr(message, one.name) for one in fields(message) if one.type in _REAL)
    return all(np.isfinite(value).all() for value in values)


_REAL = ("Array", "float")
_NEUTRAL: dict[str, Any] = {
    "frame_id": FRAME_MAP,
    "attitude": (0.0, 0.0, 0.0, 1.0),
    "orientation": (0.0, 0.0, 0.0, 1.0),
    "accel": (0.0, 0.0, GRAVITY),
    "flight_direction": (1.0, 0.0, 0.0),
    "phase": int(Phase.HOVER),
    "trigger": int(Trigger.REGION),
}
_NEUTRAL_OF_TYPE = {"float": 0.0, "int": 0, "bool": True, "str": ""}


def neutral(kind: type, stamp_ns: int) -> Any:
    """Return a message of a vehicle that hovers level at the origin, for warm-up and tests."""
    values: dict[str, Any] = {}
    for one in fields(kind):
        if one.name.endswith("stamp_ns"):
            values[one.name] = stamp_ns
        elif one.type == "Array":
            length = one.metadata["length"]
            values[one.name] = np.array(_NEUTRAL.get(one.name, length * (0.0,)))
        else:
            values[one.name] = _NEUTRAL.get(one.name, _NEUTRAL_OF_TYPE.get(str(one.type)))
    return kind(**values)
