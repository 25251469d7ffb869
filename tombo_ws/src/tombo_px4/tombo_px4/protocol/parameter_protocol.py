"""MAVLink's parameter protocol as PX4 speaks it: whole numbers travel as the bytes of a float."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link.message_encoder import float_of_int

if TYPE_CHECKING:
    from tombo_px4.autopilot.parameters import ParameterTable

_NAME_LENGTH = 16
_TYPES = {"int32": mavlink.MAV_PARAM_TYPE_INT32, "float": mavlink.MAV_PARAM_TYPE_REAL32}
_BATCH = 5
"""Values of a list that leave at once."""


def int_of_float(value: float) -> int:
    """Return the int32 that has the bytes of a float."""
    number: int = struct.unpack("<i", struct.pack("<f", value))[0]
    return number


def name_of(field: Any) -> str:
    """Return a parameter's name from the field of a message, which may be bytes."""
    text = field.decode("ascii", "replace") if isinstance(field, bytes) else str(field)
    return text.split("\x00")[0][:_NAME_LENGTH]


class ParameterServer:
    """Answers for one table, in the order of the names, as PX4 does."""

    def __init__(self, table: ParameterTable) -> None:
        self.table = table
        self._names = sorted(table.names)
        self._index = {name: i for i, name in enumerate(self._names)}

    def __len__(self) -> int:
        return len(self._names)

    def value(self, mav: Any, name: str) -> Any | None:
        """Return PARAM_VALUE of a parameter; None: there is no such one."""
        index = self._index.get(name)
        if index is None:
            return None
        kind = self.table.type_of(name)
        value = self.table.stored(name)
        sent = float_of_int(int(value)) if kind == "int32" else float(value)
        return mav.param_value_encode(name.encode(), sent, _TYPES[kind], len(self), index)

    def value_at(self, mav: Any, index: int) -> Any | None:
        """Return PARAM_VALUE of the parameter with an index; None: there is no such one."""
        if not 0 <= index < len(self):
            return None
        return self.value(mav, self._names[index])

    def answer_read(self, mav: Any, message: Any) -> Any | None:
        """Return PARAM_VALUE for PARAM_REQUEST_READ; None: to an unknown name PX4 is silent."""
        name, index = name_of(message.param_id), message.param_index
        return self.value(mav, name) if index < 0 else self.value_at(mav, index)

    def answer_set(self, mav: Any, message: Any) -> tuple[Any, str]:
        """Carry out PARAM_SET, as PX4 does: out of bounds is taken, too.

        Returns:
            PARAM_VALUE that stands now, for everybody, and ""; None where PX4 is silent, and why.
        """
        name = name_of(message.param_id)
        if name not in self._index:
            return None, f"{name} is unknown"
        kind = self.table.type_of(name)
        if message.param_type != _TYPES[kind]:
            return None, f"{name} is {kind}"
        sent = message.param_value
        self.table.store(name, int_of_float(sent) if kind == "int32" else sent)
        return self.value(mav, name), ""

    def batches(self, mav: Any) -> Iterator[list[Any]]:
        """Yield the PARAM_VALUE messages of the whole list, as many as leave at once."""
        for first in range(0, len(self), _BATCH):
            last = min(first + _BATCH, len(self))
            yield [self.value_at(mav, index) for index in range(first, last)]
