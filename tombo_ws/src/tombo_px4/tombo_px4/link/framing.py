"""Finds MAVLink frames in datagrams and streams, and tells them from garbage.

pymavlink's parser reads garbage byte by byte, raises on it, and trusts the length of a frame: a
wrong one removes the frames behind it. Here a frame is one whose checksum is right, and
a candidate that fails costs one byte. Work and memory are bounded whatever comes.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import NamedTuple

from pymavlink.dialects.v20 import common
from pymavlink.dialects.v20.common import mavlink_map, x25crc

from tombo_px4.link import added_messages

DATAGRAM_TRIES = 64
"""Failed candidates in one datagram after which the rest of it is garbage."""

STREAM_TRIES = 512
"""The same for one piece of a stream."""

_MAGIC = re.compile(b"[\xfd\xfe]")
_V1, _V2 = 0xFE, 0xFD
_V1_FRAME, _V2_FRAME = 8, 12  # without payload
_SIGNED = 0x01
_SIGNATURE = 13
assert added_messages.EVENT in mavlink_map  # its import completes the dialect
_CRC_EXTRA = {number: bytes([message.crc_extra]) for number, message in mavlink_map.items()}
_CRC_EXTRA |= {number: bytes([extra]) for number, extra in added_messages.UNREAD.items()}
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
class Findings:
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


def frames_of(datagram: bytes, findings: Findings) -> list[Frame]:
    """Return the frames of a datagram; no frame continues in the next datagram."""
    return _scan(datagram, findings, True, DATAGRAM_TRIES)[0]


class StreamFramer:
    """Frames of a stream of bytes that comes in pieces; it keeps less than a frame of them."""

    def __init__(self, findings: Findings) -> None:
        self._findings = findings
        self._rest = b""

    def feed(self, piece: bytes) -> list[Frame]:
        """Take some more bytes; return the frames that are complete."""
        data = self._rest + piece
        frames, used = _scan(data, self._findings, False, STREAM_TRIES)
        self._rest = data[used:]
        return frames


def decode(frame: Frame) -> common.MAVLink_message:
    """Return the message of a frame."""
    return _DECODER.decode(bytearray(frame.data))


def _scan(data: bytes, findings: Findings, whole: bool, tries: int) -> tuple[list[Frame], int]:
    """Return the frames in `data` and how many of its bytes are done with.

    Args:
        data: the bytes.
        findings: what is counted.
        whole: nothing comes behind: a frame that is not complete is none.
        tries: how many candidates may come to nothing.
    """
    frames: list[Frame] = []
    at = good = 0
    last = findings.tries + tries
    while findings.tries < last:
        found = _MAGIC.search(data, at)
        if found is None:
            at = len(data)
            break
        at = found.start()
        size, frame = _candidate(data, at, findings)
        cut = at + size > len(data)
        if cut and not whole:
            break
        if cut or size == 0:
            findings.tries += 1
            at += 1
            continue
        if frame is None:
            findings.tries += 1
        else:
            frames.append(frame)
        findings.garbage_bytes += at - good
        at += size
        good = at
    else:
        at = len(data)
    findings.garbage_bytes += at - good
    return frames, at


def _candidate(data: bytes, at: int, findings: Findings) -> tuple[int, Frame | None]:
    """Look at the magic byte `data[at]`.

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
        if size < left and data[at + size] not in (_V1, _V2):
            return 0, None
        findings.unknown_message += 1
        return size, None
    if x25crc(data[at + 1 : crc_at] + extra).crc != data[crc_at] | data[crc_at + 1] << 8:
        findings.bad_checksum += 1
        return 0, None
    if message_id in added_messages.UNREAD:
        return size, None
    return size, Frame(data[at : at + size], system, component, message_id, signed)
