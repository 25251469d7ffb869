"""The messages between cores as records of compiled code, derived from the dataclasses.

A record has the message's numbers under the same names and with their units; texts are left out.
"""

from __future__ import annotations

from dataclasses import fields
from functools import cache
from typing import Any, TypeVar

from tombo_dynamics import messages
from tombo_dynamics.records import Record, field

_Message = TypeVar("_Message")
_TYPES = {"int": int, "float": float, "bool": bool}


@cache
def record_of(message: type[Any]) -> type[Record]:
    """Return the record of a message: its numbers under the same names."""
    named: dict[str, Any] = {}
    for one in fields(message):
        unit, length = one.metadata.get("unit", "1"), one.metadata.get("length", ())
        if one.type != "str":
            kind = _TYPES.get(str(one.type), float)
            named[one.name] = field(unit, f"as in {message.__name__}", length, kind)
    return type(f"{message.__name__}Record", (Record,), named)


PositionSetpointRecord = record_of(messages.PositionSetpoint)
OdometryRecord = record_of(messages.Odometry)
EstimatorStatusRecord = record_of(messages.EstimatorStatus)
CollisionEventRecord = record_of(messages.CollisionEvent)
DetectorStatusRecord = record_of(messages.DetectorStatus)
ReactionStatusRecord = record_of(messages.ReactionStatus)
MissionStatusRecord = record_of(messages.MissionStatus)


def message_of(kind: type[_Message], record: Any, **texts: str) -> _Message:
    """Return a record as the message that it stands for."""
    values: dict[str, Any] = dict(texts)
    for name in record.dtype.names:
        value = record[name]
        values[name] = value.copy() if value.ndim else value.item()
    return kind(**values)
