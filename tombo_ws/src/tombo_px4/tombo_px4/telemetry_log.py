"""Telemetry logs (`.tlog`): MAVLink frames, each behind its time of reception, as columns.

QGroundControl, Mission Planner and MAVProxy write them: 8 bytes with the time [us since 1970, big
endian], then a frame of MAVLink 1 or 2 (mavlink.io, "Serialization"). pymavlink decodes them.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from typing import Any

import numpy as np

from tombo_bag.columns import ColumnTable

_V1, _V2 = 0xFE, 0xFD
_AUTOPILOT = 1
"""Component that is the autopilot itself."""
_EARLIEST_US, _LATEST_US = 946_684_800_000_000, 4_102_444_800_000_000
"""2000 to 2100."""
_ODOMETRY = 331
MOCAP = (138, _ODOMETRY, 104, 102)
"""Poses from outside, best first: ATT_POS_MOCAP, ODOMETRY that is not the autopilot's, VICON_ and
VISION_POSITION_ESTIMATE."""
_PLACE, _ANGLES = {"position": "x y z"}, {"rpy": "roll pitch yaw"}
_IMU = {"acc": "xacc yacc zacc", "gyro": "xgyro ygyro zgyro"}
_FIELDS = {
    138: {"q": "q", **_PLACE},
    _ODOMETRY: {"q": "q", **_PLACE},
    104: {**_PLACE, **_ANGLES},
    102: {**_PLACE, **_ANGLES},
    32: _PLACE,  # LOCAL_POSITION_NED
    31: {"q": "q1 q2 q3 q4"},  # ATTITUDE_QUATERNION
    30: _ANGLES,  # ATTITUDE
    105: _IMU,  # HIGHRES_IMU
    26: _IMU,  # SCALED_IMU
    27: _IMU,  # RAW_IMU
    93: {"control": "controls"},  # HIL_ACTUATOR_CONTROLS
    36: {"output": " ".join(f"servo{k}_raw" for k in range(1, 9))},  # SERVO_OUTPUT_RAW
    11030: {"rpm": "rpm"},  # ESC_TELEMETRY_1_TO_4
    1: {"voltage": "voltage_battery", "current": "current_battery"},  # SYS_STATUS
}
"""Number of a message → column → its fields; best first where several hold the same."""
_TIMES = {"time_usec": 1.0, "usec": 1.0, "time_boot_ms": 1e3}
"""Field with the vehicle's time → one count of it [us]."""
_Streams = dict[tuple[int, int, int], list[tuple[int, Any]]]
"""Message, system, component → times of reception [us] and messages."""


def is_tlog(start: bytes) -> bool:
    """Return whether a file starts with a time of reception and a MAVLink frame."""
    stamp = int.from_bytes(start[:8], "big")
    return len(start) > 8 and start[8] in (_V1, _V2) and _EARLIEST_US < stamp < _LATEST_US


def telemetry_messages(raw: bytes) -> tuple[dict[int, ColumnTable], list[str]]:
    """Return number of a message → its fields as columns, of one vehicle; and the damage.

    Each table has `timestamp`, the time of reception [us since 1970]. Its `timestamp_sample` is
    the vehicle's stamp, on the same clock at the mean delay. Poses of a motion capture are taken
    from any sender.
    """
    streams, damage = _streams(raw)
    senders: Counter[int] = Counter()
    for (number, system, component), rows in streams.items():
        if number not in MOCAP and component == _AUTOPILOT:
            senders[system] += len(rows)
    vehicle = senders.most_common(1)[0][0] if senders else 0
    tables = {}
    for number, fields in _FIELDS.items():
        fitting = [
            rows
            for (other, system, component), rows in streams.items()
            if other == number
            and (number in MOCAP or system == vehicle)
            and (number != _ODOMETRY or component != _AUTOPILOT)
        ]
        if fitting:
            tables[number] = _table(fields, max(fitting, key=len))
    if len(senders) > 1:
        damage.append(f"{len(senders)} vehicles in one log; that with most messages is read")
    return tables, damage


def _streams(raw: bytes) -> tuple[_Streams, list[str]]:
    """Return the messages of each sender, and the unreadable parts."""
    from pymavlink.dialects.v20 import ardupilotmega  # takes time, which other logs need not

    link = ardupilotmega.MAVLink(None)
    streams: _Streams = defaultdict(list)
    at = rejected = 0
    while at + 16 <= len(raw):
        begin = at + 8
        head = 10 if raw[begin] == _V2 else 6
        signature = 13 if head == 10 and raw[begin + 2] & 1 else 0
        end = begin + head + raw[begin + 1] + 2 + signature
        number = int.from_bytes(raw[begin + (5 if head == 6 else 7) : begin + head], "little")
        if raw[begin] in (_V1, _V2) and end > len(raw):
            break
        try:
            if raw[begin] not in (_V1, _V2):
                raise ardupilotmega.MAVError("no frame")
            message = link.decode(bytearray(raw[begin:end])) if number in _FIELDS else None
        except ardupilotmega.MAVError:
            at, rejected = at + 1, rejected + 1
            continue
        if message is not None:
            sender = (message.get_srcSystem(), message.get_srcComponent())
            streams[number, *sender].append((int.from_bytes(raw[at:begin], "big"), message))
        at = end
    damage = [f"damaged: {rejected} bytes are left out"] if rejected else []
    if at < len(raw):
        damage.append("cut off within a frame; read up to there")
    return streams, damage


def _table(fields: dict[str, str], rows: list[tuple[int, Any]]) -> ColumnTable:
    received = np.array([arrival for arrival, _ in rows], np.float64)
    messages = [message for _, message in rows]
    table: ColumnTable = {"timestamp": received, "timestamp_sample": received}
    for key, names in fields.items():
        values = [np.hstack([getattr(m, name) for name in names.split()]) for m in messages]
        table[key] = np.squeeze(
            np.array(values, np.float64), axis=1 if len(values[0]) == 1 else ()
        )
    for name in _TIMES.keys() & set(messages[0].get_fieldnames()):
        vehicle_us = _TIMES[name] * np.array([getattr(m, name) for m in messages], np.float64)
        # the clock of the vehicle, at the mean delay of the link
        table["timestamp_sample"] = vehicle_us + np.median(received - vehicle_us)
    return table
