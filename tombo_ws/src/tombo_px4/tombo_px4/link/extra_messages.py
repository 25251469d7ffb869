"""Messages of MAVLink's common set that pymavlink leaves out because they are marked unfinished.

PX4 sends its words as one of them, EVENT. Importing this module adds them to pymavlink's dialect.
"""

from __future__ import annotations

import re
import struct
from typing import Any

from pymavlink.dialects.v20 import common

COMPONENT_METADATA, EVENT, ESC_STATUS = 397, 410, 291


def _define(number: int, name: str, extra: int, **wire: str) -> Any:
    """Enter a message into pymavlink's dialect; return its class.

    Args:
        number: of the message.
        name: of the message.
        extra: last byte that its checksum counts, computed from MAVLink's `common.xml`.
        wire: kind of each field for `struct`, in the order on the wire and of the constructor.
    """
    content = struct.Struct("<" + "".join(wire.values()))
    lengths = [int(re.sub("[a-zA-Z]|.*s", "", kind) or 1) for kind in wire.values()]

    def begin(self: Any, *values: Any) -> None:
        common.MAVLink_message.__init__(self, number, name)
        self._fieldnames = list(wire)
        for field, value in zip(wire, values, strict=True):
            setattr(self, field, value)

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:
        values: list[Any] = []
        for field, length in zip(wire, lengths, strict=True):
            value = getattr(self, field)
            values += value if length > 1 else [value]
        frame: bytes = self._pack(mav, extra, content.pack(*values), force_mavlink1=force_mavlink1)
        return frame

    content_of = {"id": number, "msgname": name, "crc_extra": extra, "unpacker": content}
    order = {
        "orders": list(range(len(wire))),
        "lengths": lengths,
        "ordered_fieldnames": list(wire),
    }
    made = {**content_of, **order, "fieldnames": list(wire), "__init__": begin, "pack": pack}
    message = type(f"MAVLink_{name.lower()}_message", (common.MAVLink_message,), made)
    return common.mavlink_map.setdefault(number, message)


EventMessage = _define(
    EVENT,
    "EVENT",
    160,
    id="I",
    event_time_boot_ms="I",
    sequence="H",
    destination_component="B",
    destination_system="B",
    log_levels="B",
    arguments="40B",
)
ComponentMetadata = _define(
    COMPONENT_METADATA, "COMPONENT_METADATA", 182, time_boot_ms="I", file_crc="I", uri="100s"
)
EscStatus = _define(
    ESC_STATUS, "ESC_STATUS", 10, time_usec="Q", rpm="4i", voltage="4f", current="4f", index="B"
)
