"""MAVLink's parameter protocol as PX4 speaks it: whole numbers travel as the bytes of a float."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any

from pymavlink.dialects.v20 import common as mavlink

if TYPE_CHECKING:
    from tombo_px4.autopilot.parameters import ParameterTable

_TYPES = {"int32": mavlink.MAV_PARAM_TYPE_INT32, "float": mavlink.MAV_PARAM_TYPE_REAL32}


class ParameterServer:
    """Answers for one table, in the order of the names, as PX4 does."""

    def __init__(self, table: ParameterTable) -> None:
        self._table = table
        self._names = sorted(table.names)

    def value(self, name: str) -> Any | None:
        """Return PARAM_VALUE of a parameter; None: there is no such one, and PX4 is silent."""
        if name not in self._names:
            return None
        kind, value = self._table.type_of(name), self._table.stored(name)
        if kind == "int32":
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        index, count = self._names.index(name), len(self._names)
        content = (name.encode(), value, _TYPES[kind], count, index)
        return mavlink.MAVLink_param_value_message(*content)

    def answer_read(self, message: Any) -> Any | None:
        """Return PARAM_VALUE for PARAM_REQUEST_READ, by name or by index."""
        index = message.param_index
        if index < 0:
            return self.value(message.param_id)
        return self.value(self._names[index]) if index < len(self._names) else None

    def answer_set(self, message: Any) -> tuple[Any, str]:
        """Carry out PARAM_SET, as PX4 does: out of bounds is taken, too.

        Returns:
            PARAM_VALUE that stands now, for everybody, and ""; None where PX4 is silent, and why.
        """
        name, value = message.param_id, message.param_value
        if name not in self._names:
            return None, f"{name} is unknown"
        kind = self._table.type_of(name)
        if message.param_type != _TYPES[kind]:
            return None, f"{name} is {kind}"
        if kind == "int32":
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        self._table.store(name, value)
        return self.value(name), ""

    def values(self) -> list[Any]:
        """Return PARAM_VALUE of all parameters."""
        return [self.value(name) for name in self._names]
