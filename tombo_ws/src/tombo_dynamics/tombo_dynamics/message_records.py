"""The messages between cores as records of compiled code, derived from the dataclasses.

A record has the message's numbers under the same names and with their units; texts are left out.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

from tombo_dynamics import messages
from tombo_dynamics.frames import FRAME_MAP
from tombo_dynamics.records import Record, field

_Message = TypeVar("_Message")
_TYPES = {"int": int, "float": float, "bool": bool}


def record_of(message: type[Any]) -> type[Record]:
    """Return the record of a message: its numbers under the same names."""
    kind: Any = message
    return _record_of(kind)


@cache
def _record_of(message: Any) -> type[Record]:
    named: dict[str, Any] = {}
    for declared in fields(message):
        unit, length = declared.metadata.get("unit", "1"), declared.metadata.get("length", ())
        if declared.type != "str":
            kind = _TYPES.get(str(declared.type), float)
            named[declared.name] = field(unit, f"as in {message.__name__}", length, kind)
    return type(f"{message.__name__}Record", (Record,), named)


PoseRecord = record_of(messages.Pose)
ImuRecord = record_of(messages.Imu)
PositionSetpointRecord = record_of(messages.PositionSetpoint)
OdometryRecord = record_of(messages.Odometry)
EstimatorStatusRecord = record_of(messages.EstimatorStatus)
CollisionEventRecord = record_of(messages.CollisionEvent)
DetectorStatusRecord = record_of(messages.DetectorStatus)
ReactionStatusRecord = record_of(messages.ReactionStatus)
MissionStatusRecord = record_of(messages.MissionStatus)
RotorSpeedsRecord = record_of(messages.RotorSpeeds)
AttitudeSetpointRecord = record_of(messages.AttitudeSetpoint)
RatesSetpointRecord = record_of(messages.RatesSetpoint)


def message_of(kind: type[_Message], record: Any, **texts: str) -> _Message:
    """Return a record as a message; the record may have further fields.

    Texts that are not given are empty, and frames the map.
    """
    empty: Any = kind
    values: dict[str, Any] = {**_texts_of(empty), **texts}
    for name in record_of(kind).fields:
        value = record[name]
        values[name] = value.copy() if value.ndim else value.item()
    return kind(**values)


@cache
def _texts_of(kind: Any) -> dict[str, str]:
    texts = [declared.name for declared in fields(kind) if declared.type == "str"]
    return {name: FRAME_MAP if name == "frame_id" else "" for name in texts}
