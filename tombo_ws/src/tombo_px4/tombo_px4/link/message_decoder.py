"""Decodes the messages of PX4: fields checked, in our frames and units, stamped by our clock.

An invalid message is dropped and counted under a reason: `not_finite`, `wrong_frame`,
`not_unit`, `stamp`, `not_px4`, `range`, `not_for_us`, `unknown_kind`.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import rotate_vectors
from tombo_px4.bridge.decoded_messages import (
    Battery,
    CommandAck,
    EstimatorStatusFlags,
    ExtendedSysState,
    FirmwareVersion,
    Heartbeat,
    ImuSample,
    LocalPosition,
    MavLandedState,
    ParameterValue,
    Record,
    StatusText,
    SystemStatus,
    TimesyncMessage,
    VehicleAttitude,
    VehicleOdometry,
)
from tombo_px4.bridge.modes import mode_of
from tombo_px4.frames import enu_from_ned, flu_from_frd, ros_pose_covariance, ros_quaternion
from tombo_px4.link.mavlink_link import Received
from tombo_px4.link.status_text import StatusTextAssembler
from tombo_px4.link.timesync import TimeSync

_MICRO_NS, _MILLI_NS = 1_000, 1_000_000
_OLDEST_NS, _AHEAD_NS = 1_000_000_000, 20_000_000
"""A stamp may be so far before its arrival; so far after it, for a clock still being measured."""
_UNIT = 0.02
_FAR = 1e6
"""[m], [m/s]: no number of a flight is larger."""
_FASTEST_TURN, _HARDEST = 100.0, 1e4
"""[rad/s], [m/s^2] of sensors that work."""
_BOTH_SENSORS = 0x3F
"""HIGHRES_IMU.fields_updated: three axes of accelerometer and gyro."""
_INTEGERS = {
    mav.MAV_PARAM_TYPE_UINT8: "<B3x",
    mav.MAV_PARAM_TYPE_INT8: "<b3x",
    mav.MAV_PARAM_TYPE_UINT16: "<H2x",
    mav.MAV_PARAM_TYPE_INT16: "<h2x",
    mav.MAV_PARAM_TYPE_UINT32: "<I",
    mav.MAV_PARAM_TYPE_INT32: "<i",
}
_OWN_VARIANCES = [0, 6, 11, 15, 18, 20]
"""Places of the diagonal in the upper triangle of a covariance."""
_HEADER = 10
"""Bytes before the payload of a MAVLink 2 frame."""
_NO_CELL, _NO_VOLTAGE = 0xFFFF, 0xFFFF


class MessageDecoder:
    """Reads messages one by one; keeps pieces of texts until they are whole."""

    def __init__(self, sync: TimeSync, own_system: int, own_component: int) -> None:
        self.refused: Counter[str] = Counter()
        """Dropped messages: `MESSAGE.reason` -> count."""
        self._sync = sync
        self._own = (own_system, own_component)
        self._chunks = StatusTextAssembler()

    def read(self, received: Received) -> Record | None:
        """Return the record of a message; None if it has none, or was refused."""
        kind = str(received.message.get_type())
        reader = _READERS.get(kind)
        if reader is None:
            return None
        try:
            found = reader(self, received.message, received.arrival_ns)
        except (ValueError, TypeError, OverflowError, struct.error, AttributeError):
            found = "unreadable"
        if isinstance(found, str):
            self.refused[f"{kind}.{found}"] += 1
            return None
        return found

    def take_expired(self, now_ns: int) -> list[StatusText]:
        """Return texts whose missing pieces are overdue."""
        return self._chunks.take_expired(now_ns)

    def _stamp(self, boot_ns: int, arrival_ns: int) -> int | str | None:
        """Return a stamp by our clock; None while it is not known; "stamp" if it can't be."""
        if boot_ns <= 0:
            return "stamp"
        if not self._sync.converged:
            return None
        stamp = self._sync.to_local_time(boot_ns)
        if not -_AHEAD_NS <= arrival_ns - stamp <= _OLDEST_NS:
            return "stamp"
        return stamp

    def _heartbeat(self, m: Any, arrival_ns: int) -> Record | str | None:
        if m.autopilot == mav.MAV_AUTOPILOT_INVALID:  # a camera, a ground station
            return None
        if m.autopilot != mav.MAV_AUTOPILOT_PX4:
            return "not_px4"
        armed = bool(m.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
        return Heartbeat(arrival_ns, armed, mode_of(m.custom_mode))

    def _odometry(self, m: Any, arrival_ns: int) -> Record | str:
        if m.frame_id != mav.MAV_FRAME_LOCAL_NED:
            return "wrong_frame"
        if m.child_frame_id not in (mav.MAV_FRAME_LOCAL_NED, mav.MAV_FRAME_BODY_FRD):
            return "wrong_frame"
        position, velocity = np.array([m.x, m.y, m.z]), np.array([m.vx, m.vy, m.vz])
        rates = np.array([m.rollspeed, m.pitchspeed, m.yawspeed])
        q = np.array(m.q)
        wrong = _not_place(position, velocity) or _not_rates(rates) or _not_rotation(q)
        if wrong:
            return wrong
        boot_ns = m.time_usec * _MICRO_NS
        stamp = self._stamp(boot_ns, arrival_ns)
        if isinstance(stamp, str):
            return stamp
        attitude = ros_quaternion(q / np.linalg.norm(q))
        if m.child_frame_id == mav.MAV_FRAME_BODY_FRD:
            moving = rotate_vectors(attitude, flu_from_frd(velocity))
        else:
            moving = enu_from_ned(velocity)
        upper = np.array(m.pose_covariance)
        own = upper[_OWN_VARIANCES]
        known = np.isfinite(own).all() and (own > 0.0).all()
        upper[~np.isfinite(upper)] = 0.0  # PX4 leaves out how they hang together
        return VehicleOdometry(
            arrival_ns,
            stamp,
            boot_ns,
            enu_from_ned(position),
            attitude,
            moving,
            flu_from_frd(rates),
            ros_pose_covariance(upper) if known else None,
            int(m.reset_counter),
        )

    def _local_position(self, m: Any, arrival_ns: int) -> Record | str:
        position, velocity = np.array([m.x, m.y, m.z]), np.array([m.vx, m.vy, m.vz])
        wrong = _not_place(position, velocity)
        boot_ns = m.time_boot_ms * _MILLI_NS
        stamp = wrong or self._stamp(boot_ns, arrival_ns)
        if isinstance(stamp, str):
            return stamp
        here, moving = enu_from_ned(position), enu_from_ned(velocity)
        return LocalPosition(arrival_ns, stamp, boot_ns, here, moving)

    def _attitude(self, m: Any, arrival_ns: int) -> Record | str:
        q = np.array([m.q1, m.q2, m.q3, m.q4])
        rates = np.array([m.rollspeed, m.pitchspeed, m.yawspeed])
        wrong = _not_rates(rates) or _not_rotation(q)
        boot_ns = m.time_boot_ms * _MILLI_NS
        stamp = wrong or self._stamp(boot_ns, arrival_ns)
        if isinstance(stamp, str):
            return stamp
        attitude = ros_quaternion(q / np.linalg.norm(q))
        return VehicleAttitude(arrival_ns, stamp, boot_ns, attitude, flu_from_frd(rates))

    def _imu(self, m: Any, arrival_ns: int) -> Record | str:
        if m.fields_updated & _BOTH_SENSORS != _BOTH_SENSORS:
            return "incomplete"
        gyro = np.array([m.xgyro, m.ygyro, m.zgyro])
        accel = np.array([m.xacc, m.yacc, m.zacc])
        wrong = _not_rates(gyro)
        if not np.isfinite(accel).all():
            return "not_finite"
        if np.abs(accel).max() > _HARDEST:
            return "range"
        boot_ns = m.time_usec * _MICRO_NS
        stamp = wrong or self._stamp(boot_ns, arrival_ns)
        if isinstance(stamp, str):
            return stamp
        return ImuSample(arrival_ns, stamp, boot_ns, flu_from_frd(gyro), flu_from_frd(accel))

    def _battery(self, m: Any, arrival_ns: int) -> Record | str | None:
        if m.id != 0:  # a second one: PX4 counts on the first
            return None
        cells = tuple(1e-3 * v for v in [*m.voltages, *m.voltages_ext] if 0 < v != _NO_CELL)
        voltage = sum(cells) if cells else math.nan
        return Battery(
            arrival_ns, voltage, _current(m.current_battery), _share(m.battery_remaining), cells
        )

    def _system(self, m: Any, arrival_ns: int) -> Record | str:
        voltage = math.nan if m.voltage_battery == _NO_VOLTAGE else 1e-3 * m.voltage_battery
        current, left = _current(m.current_battery), _share(m.battery_remaining)
        bit = mav.MAV_SYS_STATUS_PREARM_CHECK
        return SystemStatus(
            Battery(arrival_ns, voltage, current, left),
            bool(m.onboard_control_sensors_present & bit),
            bool(m.onboard_control_sensors_health & bit),
        )

    def _landed(self, m: Any, arrival_ns: int) -> Record | str:
        return ExtendedSysState(arrival_ns, MavLandedState(m.landed_state))

    def _text(self, m: Any, arrival_ns: int) -> Record | str | None:
        return self._chunks.take(m.severity, m.text, m.id, m.chunk_seq, arrival_ns)

    def _ack(self, m: Any, arrival_ns: int) -> Record | str:
        if m.target_system not in (0, self._own[0]) or m.target_component not in (0, self._own[1]):
            return "not_for_us"
        return CommandAck(arrival_ns, int(m.command), int(m.result))

    def _parameter(self, m: Any, arrival_ns: int) -> Record | str:
        name = str(m.param_id)
        if m.param_type == mav.MAV_PARAM_TYPE_REAL32:
            value = float(m.param_value)
            return ParameterValue(name, value, m.param_type) if math.isfinite(value) else "range"
        layout = _INTEGERS.get(m.param_type)
        if layout is None:
            return "unknown_kind"
        return ParameterValue(name, int(struct.unpack(layout, _value_bytes(m))[0]), m.param_type)

    def _estimator(self, m: Any, arrival_ns: int) -> Record | str:
        flags = m.flags
        horizontal = mav.ESTIMATOR_POS_HORIZ_REL | mav.ESTIMATOR_POS_HORIZ_ABS
        return EstimatorStatusFlags(
            arrival_ns,
            bool(flags & horizontal),
            bool(flags & mav.ESTIMATOR_PRED_POS_HORIZ_REL),
            float(m.pos_horiz_ratio),
            float(m.pos_vert_ratio),
        )

    def _time(self, m: Any, arrival_ns: int) -> Record | str:
        return TimesyncMessage(arrival_ns, int(m.tc1), int(m.ts1))

    def _version(self, m: Any, arrival_ns: int) -> Record | str:
        number = m.flight_sw_version
        return FirmwareVersion(number >> 24 & 0xFF, number >> 16 & 0xFF, number >> 8 & 0xFF)


_Reader = Callable[[MessageDecoder, Any, int], "Record | str | None"]
_READERS: dict[str, _Reader] = {
    "HEARTBEAT": MessageDecoder._heartbeat,
    "ODOMETRY": MessageDecoder._odometry,
    "LOCAL_POSITION_NED": MessageDecoder._local_position,
    "ATTITUDE_QUATERNION": MessageDecoder._attitude,
    "HIGHRES_IMU": MessageDecoder._imu,
    "BATTERY_STATUS": MessageDecoder._battery,
    "SYS_STATUS": MessageDecoder._system,
    "EXTENDED_SYS_STATE": MessageDecoder._landed,
    "STATUSTEXT": MessageDecoder._text,
    "COMMAND_ACK": MessageDecoder._ack,
    "PARAM_VALUE": MessageDecoder._parameter,
    "ESTIMATOR_STATUS": MessageDecoder._estimator,
    "TIMESYNC": MessageDecoder._time,
    "AUTOPILOT_VERSION": MessageDecoder._version,
}


def _not_place(position: Array, velocity: Array) -> str:
    total = position.sum() + velocity.sum()
    if not math.isfinite(total):
        return "not_finite"
    return "range" if max(np.abs(position).max(), np.abs(velocity).max()) > _FAR else ""


def _not_rates(rates: Array) -> str:
    if not np.isfinite(rates).all():
        return "not_finite"
    return "range" if np.abs(rates).max() > _FASTEST_TURN else ""


def _not_rotation(q: Array) -> str:
    square = float(q @ q)
    if not math.isfinite(square):
        return "not_finite"
    return "not_unit" if abs(square - 1.0) > _UNIT else ""


def _current(centi: int) -> float:
    return math.nan if centi < 0 else 1e-2 * centi


def _share(percent: int) -> float:
    return 1e-2 * percent if 0 <= percent <= 100 else math.nan


def _value_bytes(m: Any) -> bytes:
    """Return the four bytes of param_value as they came.

    As a float some whole numbers (-8388607 to -4194305) would be changed: they are NaNs that no
    processor hands on untouched.
    """
    data = m.get_msgbuf()
    if data and data[0] == 0xFD:
        return bytes(data[_HEADER : _HEADER + min(data[1], 4)]).ljust(4, b"\0")
    return struct.pack("<f", m.param_value)
