"""Telemetry logs (`.tlog`): MAVLink frames, each behind its time of reception, as columns.

QGroundControl, Mission Planner and MAVProxy write them: 8 bytes with the time [us since 1970, big
endian], then a frame of MAVLink 1 or 2 (mavlink.io, "Serialization"). Layouts are those of
`common.xml` and, for ESC_TELEMETRY_1_TO_4, `ardupilotmega.xml`; checksums are pymavlink's.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from pymavlink.generator.mavcrc import x25crc

from tombo_bag.columns import ColumnTable

_V1, _V2 = 0xFE, 0xFD
_AUTOPILOT = 1
"""Component that is the autopilot itself."""
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""2000 to 2100."""
_ODOMETRY = 331
_ESC_STATUS = 291
_ESC_STATUS_EXTRA = 10
"""Extra byte of its checksum; pymavlink leaves this message out."""


@dataclass(frozen=True)
class _Message:
    """One message: the fields from its start that are of use."""

    fields: str
    """As numpy has them: `name type` or `name type shape`, parted by commas."""
    time_us: float = 1.0
    """What one count of its first field is [us]; 0: it has no time."""

    @property
    def dtype(self) -> np.dtype[Any]:
        parts = [part.split() for part in self.fields.split(", ")]
        return np.dtype([(p[0], f"<{p[1]}", *map(int, p[2:])) for p in parts])


_MESSAGES: Mapping[int, _Message] = {
    138: _Message("t u8, q f4 4, position f4 3"),  # ATT_POS_MOCAP
    _ODOMETRY: _Message("t u8, position f4 3, q f4 4"),
    104: _Message("t u8, position f4 3, rpy f4 3"),  # VICON_POSITION_ESTIMATE
    102: _Message("t u8, position f4 3, rpy f4 3"),  # VISION_POSITION_ESTIMATE
    32: _Message("t u4, position f4 3", 1e3),  # LOCAL_POSITION_NED
    31: _Message("t u4, q f4 4", 1e3),  # ATTITUDE_QUATERNION
    30: _Message("t u4, rpy f4 3", 1e3),  # ATTITUDE
    105: _Message("t u8, acc f4 3, gyro f4 3"),  # HIGHRES_IMU
    26: _Message("t u4, acc i2 3, gyro i2 3", 1e3),  # SCALED_IMU
    27: _Message("t u8, acc i2 3, gyro i2 3"),  # RAW_IMU
    93: _Message("t u8, flags u8, control f4 16"),  # HIL_ACTUATOR_CONTROLS
    36: _Message("t u4, output u2 8, port u1"),  # SERVO_OUTPUT_RAW
    _ESC_STATUS: _Message("t u8, rpm i4 4, voltage f4 4, current f4 4, index u1"),
    11030: _Message("volt u2 4, current u2 4, total u2 4, rpm u2 4", 0.0),  # ESC_TELEMETRY
    1: _Message("sensors u4 3, load u2, voltage u2, current i2", 0.0),  # SYS_STATUS
}
"""By number, best first where several hold the same."""
MOCAP = (138, _ODOMETRY, 104, 102)
"""Poses from outside; ODOMETRY where it is not the autopilot's."""


@dataclass
class _Stream:
    """Payloads of one message, and when they were received [us]."""

    received: list[int] = field(default_factory=list)
    payloads: list[bytes] = field(default_factory=list)


def is_tlog(start: bytes) -> bool:
    """Return whether a file starts with a time of reception and a MAVLink frame."""
    stamp = int.from_bytes(start[:8], "big")
    return len(start) > 8 and start[8] in (_V1, _V2) and _EARLIEST_US < stamp < _LATEST_US


def telemetry_messages(raw: bytes) -> tuple[dict[int, ColumnTable], list[str]]:
    """Return number of a message → its fields as columns, of one vehicle; and what is damaged.

    Each table has `timestamp`, when its messages were received [us since 1970], and
    `timestamp_sample`, when the vehicle stamped them, on the same clock at the mean delay. Poses
    of a motion capture are taken from any sender.
    """
    streams, damage = _frames(raw)
    senders: Counter[int] = Counter()
    for (number, system, component), stream in streams.items():
        if number not in MOCAP and component == _AUTOPILOT:
            senders[system] += len(stream.received)
    vehicle = senders.most_common(1)[0][0] if senders else 0
    tables = {}
    for number, message in _MESSAGES.items():
        fitting = [
            stream
            for key, stream in streams.items()
            if key[0] == number
            and (number in MOCAP or key[1] == vehicle)
            and (number != _ODOMETRY or key[2] != _AUTOPILOT)
        ]
        if fitting:
            tables[number] = _table(message, max(fitting, key=lambda s: len(s.received)))
    if len(senders) > 1:
        damage.append(f"{len(senders)} vehicles in one log; that with most messages is read")
    return tables, damage


def _frames(raw: bytes) -> tuple[dict[tuple[int, int, int], _Stream], list[str]]:
    """Return (message, system, component) → its payloads, and what could not be read."""
    streams: dict[tuple[int, int, int], _Stream] = {}
    at, rejected, skipped = 0, 0, 0
    while at + 8 + 8 <= len(raw):
        begin = at + 8
        head = 10 if raw[begin] == _V2 else 6
        end = begin + head + raw[begin + 1] + 2
        if raw[begin] not in (_V1, _V2):
            at, skipped = at + 1, skipped + 1
            continue
        if end > len(raw):
            break
        number = int.from_bytes(raw[begin + (5 if head == 6 else 7) : begin + head], "little")
        message = _MESSAGES.get(number)
        if message is not None and not _is_whole(raw[begin:end], number):
            at, rejected = at + 1, rejected + 1
            continue
        if message is not None:
            sender = begin + (3 if head == 6 else 5)
            stream = streams.setdefault((number, raw[sender], raw[sender + 1]), _Stream())
            stream.received.append(int.from_bytes(raw[at:begin], "big"))
            stream.payloads.append(raw[begin + head : end - 2])
        signed = head == 10 and raw[begin + 2] & 1
        at = end + (13 if signed else 0)
    damage = []
    if rejected or skipped:
        damage.append(f"damaged: {rejected} frames and {skipped} bytes are left out")
    if at < len(raw):
        damage.append("cut off within a frame; read up to there")
    return streams, damage


def _is_whole(frame: bytes, number: int) -> bool:
    """Return whether a frame of a message has the right checksum."""
    crc = x25crc(frame[1:-2] + _extra_bytes()[number]).crc
    return bool(crc == int.from_bytes(frame[-2:], "little"))


@cache
def _extra_bytes() -> dict[int, bytes]:
    """Return number of a message → the extra byte of its checksum."""
    from pymavlink.dialects.v20 import ardupilotmega  # takes time, which other logs need not

    known = {number: m.crc_extra for number, m in ardupilotmega.mavlink_map.items()}
    known.setdefault(_ESC_STATUS, _ESC_STATUS_EXTRA)
    return {number: bytes([known[number]]) for number in _MESSAGES}


def _table(message: _Message, stream: _Stream) -> ColumnTable:
    dtype = message.dtype
    size = dtype.itemsize
    # MAVLink 2 leaves out zeros at the end
    whole = b"".join(payload[:size].ljust(size, b"\0") for payload in stream.payloads)
    records = np.frombuffer(whole, dtype)
    first = (
        records["index"] == 0 if "index" in (dtype.names or ()) else np.ones(len(records), bool)
    )
    records = records[first]  # of ESC_STATUS those of the first four
    table: ColumnTable = {key: records[key].astype(np.float64) for key in dtype.names or ()}
    received = np.array(stream.received, np.float64)[first]
    table["timestamp"] = table["timestamp_sample"] = received
    if message.time_us:
        vehicle_us = table["t"] * message.time_us
        # the clock of the vehicle, at the mean delay of the link
        table["timestamp_sample"] = vehicle_us + np.median(received - vehicle_us)
    return table
