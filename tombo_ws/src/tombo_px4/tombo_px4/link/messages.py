"""Messages to and from PX4: ours in its frames; its own as records in ENU/FLU and SI, checked.

An invalid message is dropped and counted under a reason: `not_finite`, `wrong_frame`,
`not_unit`, `stamp`, `not_px4`, `range`, `not_for_us`, `unknown_kind`. Texts of more than 50
characters come in pieces, which are joined.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import is_future
from tombo_dynamics.messages import PositionSetpoint
from tombo_dynamics.rotation import rotate_vector
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import (
    UPPER_DIAGONAL,
    enu_from_ned,
    flu_from_frd,
    ned_from_enu,
    px4_quaternion,
    px4_yaw,
    ros_pose_covariance,
    ros_quaternion,
)
from tombo_px4.link.mavlink_link import Received
from tombo_px4.link.timesync import TimeSync
from tombo_px4.modes import MavLandedState, Mode, mode_of

POSITION_MASK = mav.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
"""Position, velocity, acceleration and yaw count; the rate of yaw doesn't."""
ATTITUDE_MASK = (
    mav.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | mav.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
    | mav.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
)
_TRACKED = 100
"""ODOMETRY.quality of a valid pose, in percent."""
_UNKNOWN = [math.nan] + 20 * [0.0]
"""A covariance of which nothing is known: NaN in front (MAVLink common)."""
_MICRO, _MILLI = 1_000, 1_000_000
"""[ns]. The 32 bits of `time_boot_ms` carry our time; PX4 does not read them."""


class MessageTarget(NamedTuple):
    """System and component that the messages are for."""

    system: int
    component: int


def pose_message(stamp_ns: int, position: Array, attitude: Array) -> Any:
    """Return a pose of the motion capture as the ODOMETRY that PX4 fuses.

    Args:
        stamp_ns: capture, of the clock that answers TIMESYNC.
        position: (3) of base_link in map [m].
        attitude: (4) xyzw, map from base_link.
    """
    q = px4_quaternion(attitude / np.linalg.norm(attitude))  # else PX4 drops it, silently
    return mav.MAVLink_odometry_message(
        stamp_ns // _MICRO,
        mav.MAV_FRAME_LOCAL_NED,
        mav.MAV_FRAME_BODY_FRD,
        *ned_from_enu(position).tolist(),
        q.tolist(),
        *(6 * [math.nan]),
        _UNKNOWN,
        _UNKNOWN,
        0,
        mav.MAV_ESTIMATOR_TYPE_VISION,
        _TRACKED,
    )


def position_target(setpoint: PositionSetpoint, to: MessageTarget, now_ns: int) -> Any:
    """Return a set point of position, velocity and acceleration fed forward, and yaw."""
    return mav.MAVLink_set_position_target_local_ned_message(
        now_ns // _MILLI % 2**32,
        *to,
        mav.MAV_FRAME_LOCAL_NED,
        POSITION_MASK,
        *ned_from_enu(setpoint.position).tolist(),
        *ned_from_enu(setpoint.velocity).tolist(),
        *ned_from_enu(setpoint.acceleration).tolist(),
        px4_yaw(setpoint.yaw),
        0.0,
    )


def attitude_target(attitude: Array, throttle: float, to: MessageTarget, now_ns: int) -> Any:
    """Return a set point of attitude (4) xyzw, map from base_link, and throttle 0..1."""
    q, no_rates = px4_quaternion(attitude).tolist(), (0.0, 0.0, 0.0)
    return mav.MAVLink_set_attitude_target_message(
        now_ns // _MILLI % 2**32, *to, ATTITUDE_MASK, q, *no_rates, throttle
    )


def throttle_of(thrust: float, mass: float, hover_thrust: float) -> float:
    """Return the throttle 0..1 for a thrust [N]: `hover_thrust` carries the weight of `mass`."""
    return min(max(thrust / (mass * GRAVITY) * hover_thrust, 0.0), 1.0)


def heartbeat(kind: int = mav.MAV_TYPE_GCS) -> Any:
    """Return our HEARTBEAT, that of a ground station: PX4 sends its texts to those alone."""
    content = (kind, mav.MAV_AUTOPILOT_INVALID, 0, 0, mav.MAV_STATE_ACTIVE, 3)
    return mav.MAVLink_heartbeat_message(*content)


def command(to: MessageTarget, number: int, *values: float) -> Any:
    """Return COMMAND_LONG with up to seven values, the rest 0."""
    padded = [*values, *((7 - len(values)) * [0.0])]
    return mav.MAVLink_command_long_message(*to, number, 0, *padded)


def request_message(to: MessageTarget, number: int) -> Any:
    """Ask for a message once."""
    return command(to, mav.MAV_CMD_REQUEST_MESSAGE, float(number))


def read_parameter(to: MessageTarget, name: str) -> Any:
    """Ask for a parameter by name."""
    return mav.MAVLink_param_request_read_message(*to, name.encode(), -1)


def float_of_int(value: int) -> float:
    """Return the float that has the bytes of an int32: PX4 takes whole numbers by their bytes."""
    number: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return number


def int_of_float(value: float) -> int:
    """Return the int32 that has the bytes of a float."""
    number: int = struct.unpack("<i", struct.pack("<f", value))[0]
    return number


def override_channels(to: MessageTarget, channels: Sequence[int]) -> Any:
    """Set the channels of the remote control: 18 pulse widths [us]."""
    return mav.MAVLink_rc_channels_override_message(*to, *channels)


def fail_battery(to: MessageTarget) -> Any:
    """Ask a simulated vehicle to let its battery run empty."""
    unit, kind = mav.FAILURE_UNIT_SYSTEM_BATTERY, mav.FAILURE_TYPE_OFF
    return command(to, mav.MAV_CMD_INJECT_FAILURE, float(unit), float(kind))


class RefusedMessage(ValueError):
    """A message that can't be used; the text is the reason that is counted."""


@dataclass(frozen=True)
class StampedMessage:
    """A message with the time of its data."""

    arrival_ns: int
    stamp_ns: int | None
    """Of the content, our clock; None while the clocks are not known to each other."""
    boot_ns: int
    """The same in PX4's clock."""


class Heartbeat(NamedTuple):
    """HEARTBEAT of the autopilot."""

    arrival_ns: int
    armed: bool
    mode: Mode
    failsafe: bool = False
    """PX4 flies another mode than was asked for, or has stopped its rotors for good."""
    killed: bool = False
    """A kill switch, or PX4 itself, has stopped the rotors."""


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


@dataclass(frozen=True)
class VehicleImu(StampedMessage):
    """PX4's gyro and accelerometer."""

    gyro: Array
    """(3) base_link [rad/s]."""
    accel: Array
    """(3) specific force, base_link [m/s^2]."""
    pressure_altitude: float = math.nan
    """Height that the barometer shows [m]; NaN: not sent."""


class BatteryReading(NamedTuple):
    """Voltage [V], current [A], remaining charge 0..1; NaN: not known."""

    arrival_ns: int
    voltage: float
    current: float
    remaining: float
    cells: tuple[float, ...] = ()
    """[V] of each cell, as far as known."""


class StatusText(NamedTuple):
    """A text of PX4 (STATUSTEXT), and its severity (`Severity`)."""

    arrival_ns: int
    severity: int
    text: str


class CommandAck(NamedTuple):
    """PX4's answer to a command; to DO_SET_MODE there are two, and the first says nothing."""

    arrival_ns: int
    command: int
    result: int


class ParameterValue(NamedTuple):
    """A parameter of the vehicle, and its MAV_PARAM_TYPE."""

    name: str
    value: float | int
    kind: int


def decode_parameter(m: Any) -> ParameterValue:
    """Return the content of PARAM_VALUE: PX4 sends a whole number by its bytes.

    Raises:
        RefusedMessage: another type, or a value that is not finite.
    """
    name, value = str(m.param_id), float(m.param_value)
    if m.param_type == mav.MAV_PARAM_TYPE_INT32:
        return ParameterValue(name, int_of_float(value), m.param_type)
    if m.param_type != mav.MAV_PARAM_TYPE_REAL32:
        raise RefusedMessage("unknown_kind")
    return ParameterValue(name, float(_bounded(math.inf, value)[0]), m.param_type)


class EstimatorStatusFlags(NamedTuple):
    """State of PX4's estimator (ESTIMATOR_STATUS)."""

    arrival_ns: int
    has_position: bool
    """Horizontal, relative or absolute."""
    is_aided: bool
    """A position source is fused. (CONST_POS_MODE does not tell: it is set at rest, too.)"""
    position_ratio: float
    """Innovation test ratio; above 1 the poses are refused. NaN: not reported."""
    height_ratio: float


_FULL = 50
"""A piece of this length is followed by another one [characters]."""
_MOST_PIECES = 8


class StatusTextAssembler:
    """Joins the pieces of long texts, in the order of their arrival."""

    def __init__(self) -> None:
        self._begun: dict[int, str] = {}
        """Number of a text → its beginning."""

    def take(self, m: Any, arrival_ns: int) -> StatusText | None:
        """Take a STATUSTEXT; return the text once it is whole, without control characters.

        Raises:
            RefusedMessage: severity or place of the piece is out of bounds.
        """
        if not 0 <= m.severity <= 7 or m.chunk_seq >= _MOST_PIECES:
            raise RefusedMessage("range")
        text = (self._begun.pop(m.id, "") if m.chunk_seq else "") + m.text
        if len(m.text) >= _FULL:
            self._begun[m.id] = text
            return None
        # PX4 ends some texts with a tabulator
        printable = "".join(c if c.isprintable() else " " for c in text).strip()
        return StatusText(arrival_ns, m.severity, printable)


_OLDEST_NS, _SYNC_ERROR_NS = 1_000_000_000, 15_000_000
"""Largest time of a stamp before its arrival; the error of a clock that is still being
measured."""
_SAME_JUMP_NS = 100_000_000
"""Messages whose clocks differ by the same, within this, prove a jump of one of the clocks."""
_UNIT = 0.02
_FAILSAFE = (mav.MAV_STATE_CRITICAL, mav.MAV_STATE_EMERGENCY, mav.MAV_STATE_FLIGHT_TERMINATION)
_LARGEST = 1e6
"""[m], [m/s]: no number of a flight is larger."""
_FASTEST_TURN, _HARDEST = 100.0, 1e4
"""[rad/s], [m/s^2] of sensors that work."""
_BOTH_SENSORS = 0x3F
"""HIGHRES_IMU.fields_updated: three axes of accelerometer and gyro."""
_PRESSURE_ALTITUDE = mav.HIGHRES_IMU_UPDATED_PRESSURE_ALT
_NO_CELL = 0xFFFF


class MessageDecoder:
    """Reads messages one by one; keeps pieces of texts until they are whole."""

    def __init__(self, sync: TimeSync, own_system: int, own_component: int) -> None:
        self.refused: Counter[str] = Counter()
        """Dropped messages: `MESSAGE.reason` -> count."""
        self._sync = sync
        self._own = (own_system, own_component)
        self._age_ns = 0
        """How long the last message with a possible stamp was on its way."""
        self._impossible_ns: int | None = None
        """Arrival less time since boot of the last message, where its stamp was impossible."""
        self._chunks = StatusTextAssembler()

    def read(self, received: Received) -> object:
        """Return the content of a message; None if it has none, or was refused."""
        kind = str(received.message.get_type())
        reader = _READERS.get(kind)
        if reader is None:
            return None
        try:
            return reader(self, received.message, received.arrival_ns)
        except RefusedMessage as refused:
            reason = str(refused)
        except (ValueError, TypeError, OverflowError, struct.error, AttributeError):
            reason = "unreadable"
        self.refused[f"{kind}.{reason}"] += 1
        return None

    def _times(self, boot_ns: int, arrival_ns: int) -> tuple[int, int | None, int]:
        """Return arrival, stamp by our clock (None while it is not known) and time since boot.

        After a jump of a clock TIMESYNC takes three answers to measure it. Until then a stamp is
        the arrival less the time that messages take; two messages prove a jump, one is refused.
        """
        if boot_ns <= 0:
            raise RefusedMessage("stamp")
        if not self._sync.converged:
            return arrival_ns, None, boot_ns
        stamp_ns = self._sync.to_local_time(boot_ns)
        future = is_future(stamp_ns, arrival_ns + _SYNC_ERROR_NS)
        if not future and arrival_ns - stamp_ns <= _OLDEST_NS:
            self._age_ns, self._impossible_ns = arrival_ns - stamp_ns, None
            return arrival_ns, stamp_ns, boot_ns
        before_ns, self._impossible_ns = self._impossible_ns, arrival_ns - boot_ns
        if before_ns is None or abs(self._impossible_ns - before_ns) > _SAME_JUMP_NS:
            raise RefusedMessage("stamp")
        return arrival_ns, arrival_ns - self._age_ns, boot_ns

    def _heartbeat(self, m: Any, arrival_ns: int) -> object:
        if m.autopilot == mav.MAV_AUTOPILOT_INVALID:  # a camera, a ground station
            return None
        if m.autopilot != mav.MAV_AUTOPILOT_PX4:
            raise RefusedMessage("not_px4")
        armed = is_armed(m)
        failsafe = armed and m.system_status in _FAILSAFE
        return Heartbeat(arrival_ns, armed, mode_of(m.custom_mode), failsafe, is_killed(m))

    def _odometry(self, m: Any, arrival_ns: int) -> object:
        in_body = m.child_frame_id == mav.MAV_FRAME_BODY_FRD
        if m.frame_id != mav.MAV_FRAME_LOCAL_NED or not (
            in_body or m.child_frame_id == mav.MAV_FRAME_LOCAL_NED
        ):
            raise RefusedMessage("wrong_frame")
        place = _bounded(_LARGEST, m.x, m.y, m.z, m.vx, m.vy, m.vz)
        rates = _bounded(_FASTEST_TURN, m.rollspeed, m.pitchspeed, m.yawspeed)
        attitude = _attitude(m.q)
        velocity = place[3:]
        upper = np.array(m.pose_covariance)
        diagonal = upper[UPPER_DIAGONAL]
        known = np.isfinite(diagonal).all() and (diagonal > 0.0).all()
        upper[~np.isfinite(upper)] = 0.0  # PX4 leaves out how they hang together
        return VehicleOdometry(
            *self._times(m.time_usec * _MICRO, arrival_ns),
            enu_from_ned(place[:3]),
            attitude,
            rotate_vector(attitude, flu_from_frd(velocity)) if in_body else enu_from_ned(velocity),
            flu_from_frd(rates),
            ros_pose_covariance(upper) if known else None,
        )

    def _imu(self, m: Any, arrival_ns: int) -> object:
        if m.fields_updated & _BOTH_SENSORS != _BOTH_SENSORS:
            raise RefusedMessage("incomplete")
        accel = _bounded(_HARDEST, m.xacc, m.yacc, m.zacc)
        gyro = _bounded(_FASTEST_TURN, m.xgyro, m.ygyro, m.zgyro)
        times = self._times(m.time_usec * _MICRO, arrival_ns)
        measures_height = bool(m.fields_updated & _PRESSURE_ALTITUDE) and math.isfinite(
            m.pressure_alt
        )
        altitude = float(m.pressure_alt) if measures_height else math.nan
        return VehicleImu(*times, flu_from_frd(gyro), flu_from_frd(accel), altitude)

    def _battery(self, m: Any, arrival_ns: int) -> object:
        if m.id != 0:  # a second one: PX4 counts on the first
            return None
        cells = tuple(1e-3 * v for v in [*m.voltages, *m.voltages_ext] if 0 < v != _NO_CELL)
        voltage = sum(cells) if cells else math.nan
        current = math.nan if m.current_battery < 0 else 1e-2 * m.current_battery
        left = 1e-2 * m.battery_remaining if 0 <= m.battery_remaining <= 100 else math.nan
        return BatteryReading(arrival_ns, voltage, current, left, cells)

    def _ack(self, m: Any, arrival_ns: int) -> object:
        if m.target_system not in (0, self._own[0]) or m.target_component not in (0, self._own[1]):
            raise RefusedMessage("not_for_us")
        return CommandAck(arrival_ns, int(m.command), int(m.result))

    def _version(self, m: Any, arrival_ns: int) -> object:
        major, minor, patch, _ = m.flight_sw_version.to_bytes(4, "big")
        number = bytes(m.uid2) if any(m.uid2) else int(m.uid).to_bytes(8, "big")
        hardware_id = number.hex().lstrip("0")
        return f"{major}.{minor}.{patch}", hardware_id


def _estimator(m: Any, arrival_ns: int) -> object:
    return EstimatorStatusFlags(
        arrival_ns,
        bool(m.flags & (mav.ESTIMATOR_POS_HORIZ_REL | mav.ESTIMATOR_POS_HORIZ_ABS)),
        bool(m.flags & mav.ESTIMATOR_PRED_POS_HORIZ_REL),
        float(m.pos_horiz_ratio),
        float(m.pos_vert_ratio),
    )


_Reader = Callable[[MessageDecoder, Any, int], object]
_READERS: dict[str, _Reader] = {
    "HEARTBEAT": MessageDecoder._heartbeat,
    "ODOMETRY": MessageDecoder._odometry,
    "HIGHRES_IMU": MessageDecoder._imu,
    "BATTERY_STATUS": MessageDecoder._battery,
    "STATUSTEXT": lambda decoder, m, t: decoder._chunks.take(m, t),
    "COMMAND_ACK": MessageDecoder._ack,
    "PARAM_VALUE": lambda _, m, t: decode_parameter(m),
    "AUTOPILOT_VERSION": MessageDecoder._version,
    "ATTITUDE_TARGET": lambda _, m, t: float(*_bounded(1.0, m.thrust)),
    "EXTENDED_SYS_STATE": lambda _, m, t: MavLandedState(m.landed_state),
    "ESTIMATOR_STATUS": lambda _, m, t: _estimator(m, t),
    "TIMESYNC": lambda _, m, t: (t, int(m.tc1), int(m.ts1)),
}
"""Message → its content, from the message and its arrival.

Those without a record: the throttle 0 to 1 that PX4 commands (ATTITUDE_TARGET); arrival, tc1 and
ts1 (TIMESYNC); version of the firmware and unique number of the autopilot (AUTOPILOT_VERSION).
"""


def _bounded(limit: float, *values: float) -> Array:
    """Return values as an array; refused if one is not finite or beyond the limit."""
    array = np.array(values)
    if not np.isfinite(array).all():
        raise RefusedMessage("not_finite")
    if np.abs(array).max() > limit:
        raise RefusedMessage("range")
    return array


def is_armed(heartbeat: Any) -> bool:
    """Return whether a HEARTBEAT reports an armed vehicle."""
    return bool(heartbeat.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)


def is_killed(heartbeat: Any) -> bool:
    """Return whether a HEARTBEAT reports that the rotors are switched off, armed or not."""
    return bool(heartbeat.system_status == mav.MAV_STATE_FLIGHT_TERMINATION)


def _attitude(wxyz: Sequence[float]) -> Array:
    """Return an attitude (4) xyzw, map from base_link; refused if it is not a rotation."""
    q = _bounded(math.inf, *wxyz)
    if abs(float(q @ q) - 1.0) > _UNIT:
        raise RefusedMessage("not_unit")
    return ros_quaternion(q / np.linalg.norm(q))
