"""Decodes the messages of PX4: fields checked, in our frames and units, stamped by our clock.

An invalid message is dropped and counted under a reason: `not_finite`, `wrong_frame`,
`not_unit`, `stamp`, `not_px4`, `range`, `not_for_us`, `unknown_kind`. Texts of more than 50
characters come in pieces, which are put together.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import is_future
from tombo_dynamics.rotation import rotate_vector
from tombo_px4.frames import (
    UPPER_DIAGONAL,
    enu_from_ned,
    flu_from_frd,
    ros_pose_covariance,
    ros_quaternion,
)
from tombo_px4.link import decoded_messages as decoded
from tombo_px4.link.decoded_messages import RefusedMessage, StatusText
from tombo_px4.link.mavlink_link import Received
from tombo_px4.link.timesync import TimeSync
from tombo_px4.modes import mode_of

_FULL = 50
"""A piece of this length is followed by another."""
_PATIENCE_NS = 1_000_000_000
_MOST_TEXTS, _MOST_CHUNKS = 8, 8
_GAP = "…"


@dataclass
class _PartialText:
    severity: int
    arrival_ns: int
    chunks: dict[int, str] = field(default_factory=dict)
    count: int | None = None
    """Number of its pieces, once the last one has come."""

    def text(self) -> StatusText:
        count = self.count or max(self.chunks) + 2
        words = "".join(self.chunks.get(k, _GAP) for k in range(count))
        return _status_text(self.arrival_ns, self.severity, words)


class StatusTextAssembler:
    """Puts pieces together in whichever order they come; a missing one becomes `…`."""

    def __init__(self) -> None:
        self._growing: dict[int, _PartialText] = {}

    def take(
        self, severity: int, text: str, number: int, chunk: int, arrival_ns: int
    ) -> StatusText | None:
        """Take a piece; return the text once it is whole.

        Args:
            severity: MAV_SEVERITY.
            text: up to 50 characters.
            number: of the text; 0: it is whole in itself, but also of PX4's first one in pieces.
            chunk: place of the piece in it.
            arrival_ns: when it came.

        Raises:
            RefusedMessage: out of bounds, or too many texts are incomplete.
        """
        if not 0 <= severity <= 7 or chunk >= _MOST_CHUNKS:
            raise RefusedMessage("range")
        if number == 0 and chunk == 0 and len(text) < _FULL:
            return _status_text(arrival_ns, severity, text)
        if number not in self._growing and len(self._growing) >= _MOST_TEXTS:
            raise RefusedMessage("too_many")
        growing = self._growing.setdefault(number, _PartialText(severity, arrival_ns))
        growing.chunks[chunk] = text
        if len(text) < _FULL:
            growing.count = chunk + 1
        if growing.count is None or len(growing.chunks) < growing.count:
            return None
        return self._growing.pop(number).text()

    def take_expired(self, now_ns: int) -> list[StatusText]:
        """Return incomplete texts that have waited for a second."""
        texts = self._growing.items()
        late = [number for number, text in texts if now_ns - text.arrival_ns > _PATIENCE_NS]
        return [self._growing.pop(number).text() for number in late]


def _status_text(arrival_ns: int, severity: int, text: str) -> StatusText:
    """Return a text without control characters: PX4 ends some with a tabulator."""
    printable = "".join(c if c.isprintable() else " " for c in text).strip()
    return StatusText(arrival_ns, severity, printable)


_MICRO_NS, _MILLI_NS = 1_000, 1_000_000
_OLDEST_NS, _SYNC_ERROR_NS = 1_000_000_000, 15_000_000
"""A stamp may be so long before its arrival; the error of a clock that is still being measured."""
_SAME_JUMP_NS = 100_000_000
"""Messages whose clocks differ by the same, within this, prove a jump of one of the clocks."""
_UNIT = 0.02
_FAILSAFE = (mav.MAV_STATE_CRITICAL, mav.MAV_STATE_EMERGENCY, mav.MAV_STATE_FLIGHT_TERMINATION)
_FAR = 1e6
"""[m], [m/s]: no number of a flight is larger."""
_FASTEST_TURN, _HARDEST = 100.0, 1e4
"""[rad/s], [m/s^2] of sensors that work."""
_BOTH_SENSORS = 0x3F
"""HIGHRES_IMU.fields_updated: three axes of accelerometer and gyro."""
_PRESSURE_ALTITUDE = mav.HIGHRES_IMU_UPDATED_PRESSURE_ALT
_INTEGERS = {
    mav.MAV_PARAM_TYPE_UINT8: "<B3x",
    mav.MAV_PARAM_TYPE_INT8: "<b3x",
    mav.MAV_PARAM_TYPE_UINT16: "<H2x",
    mav.MAV_PARAM_TYPE_INT16: "<h2x",
    mav.MAV_PARAM_TYPE_UINT32: "<I",
    mav.MAV_PARAM_TYPE_INT32: "<i",
}
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
        self._age_ns = 0
        """How long the last message with a possible stamp was on its way."""
        self._impossible_ns: int | None = None
        """Arrival less time since boot of the last message, where its stamp was impossible."""
        self._chunks = StatusTextAssembler()

    def read(self, received: Received) -> object:
        """Return the record of a message; None if it has none, or was refused."""
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

    def take_expired(self, now_ns: int) -> list[decoded.StatusText]:
        """Return texts whose missing pieces are overdue."""
        return self._chunks.take_expired(now_ns)

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
        armed = bool(m.base_mode & mav.MAV_MODE_FLAG_SAFETY_ARMED)
        failsafe = armed and m.system_status in _FAILSAFE
        return decoded.Heartbeat(arrival_ns, armed, mode_of(m.custom_mode), failsafe)

    def _odometry(self, m: Any, arrival_ns: int) -> object:
        in_body = m.child_frame_id == mav.MAV_FRAME_BODY_FRD
        if m.frame_id != mav.MAV_FRAME_LOCAL_NED or not (
            in_body or m.child_frame_id == mav.MAV_FRAME_LOCAL_NED
        ):
            raise RefusedMessage("wrong_frame")
        place = _bounded(_FAR, m.x, m.y, m.z, m.vx, m.vy, m.vz)
        rates = _bounded(_FASTEST_TURN, m.rollspeed, m.pitchspeed, m.yawspeed)
        attitude = _attitude(m.q)
        velocity = place[3:]
        upper = np.array(m.pose_covariance)
        diagonal = upper[UPPER_DIAGONAL]
        known = np.isfinite(diagonal).all() and (diagonal > 0.0).all()
        upper[~np.isfinite(upper)] = 0.0  # PX4 leaves out how they hang together
        return decoded.VehicleOdometry(
            *self._times(m.time_usec * _MICRO_NS, arrival_ns),
            enu_from_ned(place[:3]),
            attitude,
            rotate_vector(attitude, flu_from_frd(velocity)) if in_body else enu_from_ned(velocity),
            flu_from_frd(rates),
            ros_pose_covariance(upper) if known else None,
            int(m.reset_counter),
        )

    def _imu(self, m: Any, arrival_ns: int) -> object:
        if m.fields_updated & _BOTH_SENSORS != _BOTH_SENSORS:
            raise RefusedMessage("incomplete")
        accel = _bounded(_HARDEST, m.xacc, m.yacc, m.zacc)
        gyro = _bounded(_FASTEST_TURN, m.xgyro, m.ygyro, m.zgyro)
        times = self._times(m.time_usec * _MICRO_NS, arrival_ns)
        measures_height = bool(m.fields_updated & _PRESSURE_ALTITUDE) and math.isfinite(
            m.pressure_alt
        )
        altitude = float(m.pressure_alt) if measures_height else math.nan
        return decoded.VehicleImu(*times, flu_from_frd(gyro), flu_from_frd(accel), altitude)

    def _battery(self, m: Any, arrival_ns: int) -> object:
        if m.id != 0:  # a second one: PX4 counts on the first
            return None
        cells = tuple(1e-3 * v for v in [*m.voltages, *m.voltages_ext] if 0 < v != _NO_CELL)
        voltage = sum(cells) if cells else math.nan
        current, left = _current(m.current_battery), _share(m.battery_remaining)
        return decoded.BatteryReading(arrival_ns, voltage, current, left, cells)

    def _system(self, m: Any, arrival_ns: int) -> object:
        voltage = math.nan if m.voltage_battery == _NO_VOLTAGE else 1e-3 * m.voltage_battery
        current, left = _current(m.current_battery), _share(m.battery_remaining)
        return decoded.BatterySummary(arrival_ns, voltage, current, left)

    def _text(self, m: Any, arrival_ns: int) -> object:
        return self._chunks.take(m.severity, m.text, m.id, m.chunk_seq, arrival_ns)

    def _ack(self, m: Any, arrival_ns: int) -> object:
        if m.target_system not in (0, self._own[0]) or m.target_component not in (0, self._own[1]):
            raise RefusedMessage("not_for_us")
        return decoded.CommandAck(arrival_ns, int(m.command), int(m.result))

    def _parameter(self, m: Any, arrival_ns: int) -> object:
        name = str(m.param_id)
        value: float | int = float(m.param_value)
        if m.param_type in _INTEGERS:
            value = int(struct.unpack(_INTEGERS[m.param_type], _value_bytes(m))[0])
        elif m.param_type != mav.MAV_PARAM_TYPE_REAL32:
            raise RefusedMessage("unknown_kind")
        elif not math.isfinite(value):
            raise RefusedMessage("range")
        return decoded.ParameterValue(name, value, m.param_type)

    def _version(self, m: Any, arrival_ns: int) -> object:
        major, minor, patch, _ = m.flight_sw_version.to_bytes(4, "big")
        number = bytes(m.uid2) if any(m.uid2) else int(m.uid).to_bytes(8, "big")
        hardware_id = number.hex().lstrip("0")
        return decoded.AutopilotVersion(f"{major}.{minor}.{patch}", hardware_id)


def _estimator(m: Any, arrival_ns: int) -> object:
    return decoded.EstimatorStatusFlags(
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
    "SYS_STATUS": MessageDecoder._system,
    "STATUSTEXT": MessageDecoder._text,
    "COMMAND_ACK": MessageDecoder._ack,
    "PARAM_VALUE": MessageDecoder._parameter,
    "AUTOPILOT_VERSION": MessageDecoder._version,
    "ATTITUDE_TARGET": lambda _, m, t: decoded.ThrustSetpoint(t, float(*_bounded(1.0, m.thrust))),
    "EXTENDED_SYS_STATE": lambda _, m, t: decoded.MavLandedState(m.landed_state),
    "ESTIMATOR_STATUS": lambda _, m, t: _estimator(m, t),
    "TIMESYNC": lambda _, m, t: decoded.TimesyncMessage(t, int(m.tc1), int(m.ts1)),
}
"""Message → its record, from the message and its arrival."""


def _bounded(limit: float, *values: float) -> Array:
    """Return values as an array; refused if one is not finite or beyond the limit."""
    array = np.array(values)
    if not np.isfinite(array).all():
        raise RefusedMessage("not_finite")
    if np.abs(array).max() > limit:
        raise RefusedMessage("range")
    return array


def _attitude(wxyz: Sequence[float]) -> Array:
    """Return an attitude (4) xyzw, map from base_link; refused if it is no rotation."""
    q = _bounded(math.inf, *wxyz)
    if abs(float(q @ q) - 1.0) > _UNIT:
        raise RefusedMessage("not_unit")
    return ros_quaternion(q / np.linalg.norm(q))


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
