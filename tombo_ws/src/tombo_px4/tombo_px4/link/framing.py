"""Finds MAVLink frames in datagrams and streams, and tells them from garbage.

pymavlink's parser reads garbage byte by byte, raises on it, and trusts the length of a frame: a
wrong one removes the frames behind it. Here a frame is one whose checksum is right, and
a candidate that fails costs one byte. Work and memory are bounded whatever comes.

pymavlink leaves out messages of MAVLink's common set that are marked unfinished; PX4 sends its
words as one of them, EVENT. Importing this module adds those that are used here to pymavlink's
dialect. Source: MAVLink's `common.xml`, from which the extra bytes of the checksums are computed.
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common
from pymavlink.dialects.v20.common import mavlink_map, x25crc

PROTOCOL_VERSION, COMPONENT_METADATA, EVENT = 300, 397, 410
UNREAD = {8: 117, 290: 251, 291: 10, 380: 232, 411: 106, 436: 193}
"""LINK_NODE_STATUS, ESC_INFO, ESC_STATUS, TIME_ESTIMATE_TO_TARGET, CURRENT_EVENT_SEQUENCE,
CURRENT_MODE, and the extra bytes of their checksums: pymavlink leaves them out too; PX4 1.17 sends
them unasked, and nothing here reads them."""
ARGUMENTS = 40
"""Bytes of the arguments of an event."""
URI = 100
"""Bytes of the URI of a file with metadata."""
_TYPES = {"B": "uint8_t", "H": "uint16_t", "I": "uint32_t", "s": "char"}


def _define(number: int, name: str, extra: int, wire: dict[str, tuple[str, int]]) -> Any:
    """Make pymavlink's class of a message, and enter it into the dialect.

    Args:
        number: of the message.
        name: of the message.
        extra: last byte that its checksum counts.
        wire: field, in the order on the wire and of the constructor, to its kind in `struct` and
            its length, 0: no array.
    """
    fields = list(wire)
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
            "ordered_fieldnames": fields,
            "fieldtypes": [_TYPES[kind] for kind, _ in wire.values()],
            "orders": list(range(len(fields))),
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


EventMessage: Any = _define(
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
)
ComponentMetadata: Any = _define(
    COMPONENT_METADATA,
    "COMPONENT_METADATA",
    182,
    {"time_boot_ms": ("I", 0), "file_crc": ("I", 0), "uri": ("s", URI)},
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
)


DATAGRAM_TRIES = 64
"""Failed candidates in one datagram after which the rest of it is garbage."""

STREAM_TRIES = 512
"""The same for one piece of a stream."""

_MAGIC = re.compile(b"[\xfd\xfe]")
_V1, _V2 = 0xFE, 0xFD
_V1_FRAME, _V2_FRAME = 8, 12  # without payload
_SIGNED = 0x01
_SIGNATURE = 13
_CRC_EXTRA = {number: bytes([message.crc_extra]) for number, message in mavlink_map.items()}
_CRC_EXTRA |= {number: bytes([extra]) for number, extra in UNREAD.items()}
_DECODER = common.MAVLink(None)


class Frame(NamedTuple):
    """One frame whose checksum is right and whose message is known; ids of its sender."""

    data: bytes
    """All of it, signature included."""
    system: int
    component: int
    message_id: int
    signed: bool
    """It carries a signature, not yet verified."""


@dataclass
class FrameCounts:
    """Counts of bytes that gave no message; `mavlink_link.COUNTED` says of which."""

    garbage_bytes: int = 0
    bad_checksum: int = 0
    unknown_message: int = 0
    tries: int = 0
    """Failed candidates; a measure of the work."""

    def counts(self) -> dict[str, int]:
        """Return the counts by name, without the measure of the work."""
        return {
            "garbage_bytes": self.garbage_bytes,
            "bad_checksum": self.bad_checksum,
            "unknown_message": self.unknown_message,
        }


def frames_of(datagram: bytes, counts: FrameCounts) -> list[Frame]:
    """Return the frames of a datagram; no frame continues in the next datagram."""
    return _scan(datagram, counts, True, DATAGRAM_TRIES)[0]


class StreamFramer:
    """Frames of a stream of bytes that comes in pieces; it keeps a frame of them at most."""

    def __init__(self, counts: FrameCounts) -> None:
        self._counts = counts
        self._rest = b""

    def feed(self, piece: bytes) -> list[Frame]:
        """Take some more bytes; return the frames that are complete."""
        data = self._rest + piece
        frames, used = _scan(data, self._counts, False, STREAM_TRIES)
        self._rest = data[used:]
        return frames


def encoder(system: int, component: int) -> common.MAVLink:
    """Return pymavlink's encoder of messages with these ids of the sender."""
    return common.MAVLink(None, srcSystem=system, srcComponent=component)


def decode(frame: Frame) -> common.MAVLink_message:
    """Return the message of a frame."""
    return _DECODER.decode(bytearray(frame.data))


def _scan(data: bytes, counts: FrameCounts, whole: bool, tries: int) -> tuple[list[Frame], int]:
    """Return the frames in `data` and how many of its bytes are done with.

    Args:
        data: the bytes.
        counts: what is counted.
        whole: nothing comes behind: a frame that is not complete is none.
        tries: how many candidates may come to nothing.
    """
    frames: list[Frame] = []
    at = good = 0
    last = counts.tries + tries
    while counts.tries < last:
        magic = _MAGIC.search(data, at)
        if magic is None:
            at = len(data)
            break
        at = magic.start()
        size, frame = _candidate(data, at, counts, whole)
        cut = at + size > len(data)
        if cut and not whole:
            break
        if cut or size == 0:
            counts.tries += 1
            at += 1
            continue
        if frame is None:
            counts.tries += 1
        else:
            frames.append(frame)
        counts.garbage_bytes += at - good
        at += size
        good = at
    else:
        at = len(data)
    counts.garbage_bytes += at - good
    return frames, at


def _candidate(data: bytes, at: int, counts: FrameCounts, whole: bool) -> tuple[int, Frame | None]:
    """Look at the magic byte `data[at]`; `whole`: nothing comes behind the data.

    Returns:
        Bytes from there to the end of the frame, beyond the data if it is not complete; 0 if it is
        no frame. And the frame; None if it is not complete, or its message not known.
    """
    left = len(data) - at
    if data[at] == _V1:
        if left < _V1_FRAME:
            return _V1_FRAME, None
        signed = False
        size = data[at + 1] + _V1_FRAME
        system, component, message_id = data[at + 3], data[at + 4], data[at + 5]
        crc_at = at + size - 2
    else:
        if left >= 3 and data[at + 2] & ~_SIGNED:  # flags that nobody has defined yet
            return 0, None
        if left < _V2_FRAME:
            return _V2_FRAME, None
        signed = data[at + 2] == _SIGNED
        crc_at = at + data[at + 1] + _V2_FRAME - 2
        size = crc_at + 2 - at + (_SIGNATURE if signed else 0)
        system, component = data[at + 5], data[at + 6]
        message_id = data[at + 7] | data[at + 8] << 8 | data[at + 9] << 16
    if size > left:
        return size, None
    extra = _CRC_EXTRA.get(message_id)
    if extra is None:
        # The checksum can't be known; a frame is where the next one begins behind it.
        if size == left and not whole:
            return size + 1, None
        if size < left and data[at + size] not in (_V1, _V2):
            return 0, None
        counts.unknown_message += 1
        return size, None
    if x25crc(data[at + 1 : crc_at] + extra).crc != data[crc_at] | data[crc_at + 1] << 8:
        counts.bad_checksum += 1
        return 0, None
    if message_id in UNREAD:
        return size, None
    return size, Frame(data[at : at + size], system, component, message_id, signed)
