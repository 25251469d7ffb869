"""A walk over the messages of a PX4 log (ULog), before its library reads it.

`pyulog` looks for the next message of a damaged file byte by byte. This walk takes the whole
messages alone and finds the next one behind damage by the log's sync messages.
(https://docs.px4.io/main/en/dev_log/ulog_file_format)
"""

from __future__ import annotations

import struct
from dataclasses import dataclass, field

_HEADER = 16
_KNOWN = frozenset(b"BFIMPQARDLCSO")
_FLAGS = ord("B")
_SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_LARGEST_UNKNOWN = 10_000
"""Bytes of a message of another kind, which is left out; a larger one is damage."""
_FLAGS_SIZE = 40
_OFFSETS = struct.Struct("<3Q")


@dataclass
class UlogMessages:
    """What is whole in a log.

    Attributes:
        spans: (start, end) of whole messages, those that follow each other joined.
        damaged: bytes between them are no messages.
        cut: the last message is not whole.
    """

    spans: list[tuple[int, int]] = field(default_factory=list)
    damaged: bool = False
    cut: bool = False

    def take(self, start: int, end: int) -> None:
        """Add a message."""
        if self.spans and self.spans[-1][1] == start:
            start = self.spans.pop()[0]
        self.spans.append((start, end))


def whole_messages(raw: bytes) -> tuple[bytes, UlogMessages]:
    """Return a log without bytes that are no message, and its messages; a whole log as it is."""
    messages = UlogMessages()
    ends = [*_appended(raw), len(raw)]
    at = _HEADER
    for end in ends:
        at = _walk(raw, at, end, messages)
        if at != end and end != len(raw):
            messages.damaged, at = True, end
    messages.cut = at != len(raw)
    if not messages.damaged:
        return raw, messages
    parts = [raw[:_HEADER]] + [raw[start:end] for start, end in messages.spans]
    return _without_offsets(b"".join(parts)), messages


def _walk(raw: bytes, at: int, end: int, messages: UlogMessages) -> int:
    """Take messages up to an end; return where they stop."""
    begun = at
    while at + 3 <= end:
        size, kind = raw[at] | raw[at + 1] << 8, raw[at + 2]
        after = at + 3 + size
        if kind in _KNOWN and size:
            if after > end:
                next_sync = raw.find(_SYNC, at + 1, end)
                if next_sync < 0:
                    break
                messages.take(begun, at)
                at = begun = next_sync
                messages.damaged = True
                continue
            at = after
            continue
        if at > begun:
            messages.take(begun, at)
        messages.damaged = True
        unknown = kind != 0 and 0 < size <= _LARGEST_UNKNOWN and after <= end
        next_sync = raw.find(_SYNC, at + 1, after if unknown else end)
        if next_sync < 0 and not unknown:
            return end  # nothing says where the next message begins
        at = begun = after if next_sync < 0 else next_sync
    if at > begun:
        messages.take(begun, at)
    return at


def _appended(raw: bytes) -> list[int]:
    """Return where data begin that were appended later, as after a crash of the autopilot."""
    size = int.from_bytes(raw[_HEADER : _HEADER + 2], "little")
    body = _HEADER + 3
    if raw[_HEADER + 2 : body] != bytes([_FLAGS]) or size < _FLAGS_SIZE:
        return []
    if len(raw) < body + _FLAGS_SIZE or not raw[body + 8] & 1:
        return []
    offsets = _OFFSETS.unpack_from(raw, body + 16)
    return sorted({offset for offset in offsets if body + _FLAGS_SIZE <= offset < len(raw)})


def _without_offsets(raw: bytes) -> bytes:
    """Return a log that says that nothing was appended."""
    body = _HEADER + 3
    if raw[_HEADER + 2 : body] != bytes([_FLAGS]) or len(raw) < body + _FLAGS_SIZE:
        return raw
    flags = bytearray(raw[body : body + _FLAGS_SIZE])
    flags[8] &= 0xFE
    flags[16:_FLAGS_SIZE] = bytes(_FLAGS_SIZE - 16)
    return raw[:body] + bytes(flags) + raw[body + _FLAGS_SIZE :]
