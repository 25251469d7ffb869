"""The messages between cores as records of compiled code, derived from the dataclasses.

A record has the message's numbers under the same names; texts are left out.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

from tombo_dynamics import messages
from tombo_dynamics.records import Record, field

_Message = TypeVar("_Message")
_LENGTHS = {"attitude": 4, "speed": 4, "pose_covariance": 36, "twist_covariance": 36}
_TYPES = {"int": int, "float": float, "bool": bool}


def _record_of(message: type[Any]) -> type[Record]:
    named: dict[str, Any] = {}
    for one in fields(message):
        if one.type == "Array":
            named[one.name] = field("", "as in the message", _LENGTHS.get(one.name, 3))
        elif one.type in _TYPES:
            named[one.name] = field("", "as in the message", kind=_TYPES[str(one.type)])
    return type(f"{message.__name__}Record", (Record,), named)


PositionSetpointRecord = _record_of(messages.PositionSetpoint)
OdometryRecord = _record_of(messages.Odometry)
EstimatorStatusRecord = _record_of(messages.EstimatorStatus)
CollisionEventRecord = _record_of(messages.CollisionEvent)
DetectorStatusRecord = _record_of(messages.DetectorStatus)
ReactionStatusRecord = _record_of(messages.ReactionStatus)
MissionStatusRecord = _record_of(messages.MissionStatus)


def message_of(kind: type[_Message], record: Any, **texts: str) -> _Message:
    """Return a record as the message that it stands for."""
    values: dict[str, Any] = dict(texts)
    for name in record.dtype.names:
        value = record[name]
        values[name] = value.copy() if value.ndim else value.item()
    return kind(**values)
