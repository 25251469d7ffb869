"""The messages between cores as records of compiled code, derived from the dataclasses.

A record has the message's numbers under the same names; texts are left out.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any, TypeVar

import numpy as np

from tombo_dynamics import messages
from tombo_dynamics.jit import compiled_call

_Message = TypeVar("_Message")
_LENGTHS = {"attitude": 4, "speed": 4}
_TYPES = {"int": np.int64, "float": np.float64, "bool": np.bool_}


def _record_type(kind: type[Any]) -> np.dtype[Any]:
    columns: list[Any] = []
    for one in fields(kind):
        if one.type == "Array":
            columns.append((one.name, np.float64, _LENGTHS.get(one.name, 3)))
        elif one.type in _TYPES:
            columns.append((one.name, _TYPES[str(one.type)]))
    return np.dtype(columns, align=True)


POSITION_SETPOINT = _record_type(messages.PositionSetpoint)
ODOMETRY = _record_type(messages.Odometry)
ESTIMATOR_STATUS = _record_type(messages.EstimatorStatus)
COLLISION_EVENT = _record_type(messages.CollisionEvent)
DETECTOR_STATUS = _record_type(messages.DetectorStatus)
REACTION_STATUS = _record_type(messages.ReactionStatus)
MISSION_STATUS = _record_type(messages.MissionStatus)


@compiled_call
def copy_status(to: Any, source: Any) -> None:
    """Copy a reaction's status."""
    to.stamp_ns = source.stamp_ns
    to.state = source.state
    to.collisions = source.collisions
    for i in range(3):
        to.x_c[i] = source.x_c[i]
        to.x_r[i] = source.x_r[i]
        to.n_r[i] = source.n_r[i]


@compiled_call
def copy_event(to: Any, source: Any) -> None:
    """Copy a collision."""
    to.stamp_ns = source.stamp_ns
    to.trigger = source.trigger
    to.contact_stamp_ns = source.contact_stamp_ns
    for i in range(3):
        to.contact_position[i] = source.contact_position[i]
        to.flight_direction[i] = source.flight_direction[i]
    to.confidence = source.confidence
    to.statistic = source.statistic
    to.count = source.count


def message_of(kind: type[_Message], record: Any, **texts: str) -> _Message:
    """Return a record as the message that it stands for."""
    values: dict[str, Any] = dict(texts)
    for name in record.dtype.names:
        value = record[name]
        values[name] = value.copy() if value.ndim else value.item()
    return kind(**values)


def fill_record(record: Any, message: Any) -> None:
    """Write the numbers of a message into a record."""
    for name in record.dtype.names:
        record[name] = getattr(message, name)
