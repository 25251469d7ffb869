"""Messages of MAVLink's common set that pymavlink leaves out, because they are marked unfinished.

PX4 sends its words as EVENT. Importing this module makes pymavlink's dialect know all four.
Source: MAVLink's `common.xml`, from which the extra bytes of the checksums are computed.
"""

from __future__ import annotations

import struct
from typing import Any

from pymavlink.dialects.v20 import common

PROTOCOL_VERSION, COMPONENT_METADATA, EVENT, CURRENT_EVENT_SEQUENCE = 300, 397, 410, 411
UNREAD = {8: 117, 290: 251, 291: 10, 380: 232, 436: 193}
"""LINK_NODE_STATUS, ESC_INFO, ESC_STATUS, TIME_ESTIMATE_TO_TARGET, CURRENT_MODE, and the extra
bytes of their checksums: pymavlink leaves them out too; PX4 1.17 sends them unasked, and nothing
here reads them."""
ARGUMENTS = 40
"""Bytes of the arguments of an event."""
URI = 100
"""Bytes of the URI of a file with metadata."""
_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "s": "char"}


def _define(
    number: int, name: str, extra: int, wire: dict[str, tuple[str, int]], fields: list[str]
) -> Any:
    """Make pymavlink's class of a message, and enter it into the dialect.

    Args:
        number: of the message.
        name: of the message.
        extra: last byte that its checksum counts.
        wire: field, in the order on the wire, to its kind in `struct` and its length, 0: no array.
        fields: names in the order of the constructor.
    """
    order = list(wire)
    content = struct.Struct("<" + "".join(f"{n or ''}{kind}" for kind, n in wire.values()))

    def begin(self: Any, *values: Any) -> None:
        common.MAVLink_message.__init__(self, number, name)
        self._fieldnames = fields
        self._instance_field, self._instance_offset = None, -1
        for field, value in zip(fields, values, strict=True):
            setattr(self, field, value)

    def pack(self: Any, mav: Any, force_mavlink1: bool = False) -> bytes:
        values: list[Any] = []
        for field, (kind, length) in wire.items():
            value = getattr(self, field)
            values += value if length and kind == "B" else [value]
        frame: bytes = self._pack(mav, extra, content.pack(*values), force_mavlink1=force_mavlink1)
        return frame

    made = type(
        f"MAVLink_{name.lower()}_message",
        (common.MAVLink_message,),
        {
            "id": number,
            "msgname": name,
            "name": name,
            "fieldnames": fields,
            "ordered_fieldnames": order,
            "fieldtypes": [_TYPES[wire[field][0]] for field in fields],
            "orders": [order.index(field) for field in fields],
            "lengths": [n if kind == "B" and n else 1 for kind, n in wire.values()],
            "array_lengths": [n for _, n in wire.values()],
            "crc_extra": extra,
            "unpacker": content,
            "instance_field": None,
            "instance_offset": -1,
            "__init__": begin,
            "pack": pack,
        },
    )
    common.mavlink_map.setdefault(number, made)
    return made


Event: Any = _define(
    EVENT,
    "EVENT",
    160,
    {
        "id": ("I", 0),
        "event_time_boot_ms": ("I", 0),
        "sequence": ("H", 0),
        "destination_component": ("B", 0),
        "destination_system": ("B", 0),
        "log_levels": ("B", 0),
        "arguments": ("B", ARGUMENTS),
    },
    [
        "destination_component",
        "destination_system",
        "id",
        "event_time_boot_ms",
        "sequence",
        "log_levels",
        "arguments",
    ],
)
CurrentEventSequence: Any = _define(
    CURRENT_EVENT_SEQUENCE,
    "CURRENT_EVENT_SEQUENCE",
    106,
    {"sequence": ("H", 0), "flags": ("B", 0)},
    ["sequence", "flags"],
)
ComponentMetadata: Any = _define(
    COMPONENT_METADATA,
    "COMPONENT_METADATA",
    182,
    {"time_boot_ms": ("I", 0), "file_crc": ("I", 0), "uri": ("s", URI)},
    ["time_boot_ms", "file_crc", "uri"],
)
ProtocolVersion: Any = _define(
    PROTOCOL_VERSION,
    "PROTOCOL_VERSION",
    217,
    {
        "version": ("H", 0),
        "min_version": ("H", 0),
        "max_version": ("H", 0),
        "spec_version_hash": ("B", 8),
        "library_version_hash": ("B", 8),
    },
    ["version", "min_version", "max_version", "spec_version_hash", "library_version_hash"],
)
