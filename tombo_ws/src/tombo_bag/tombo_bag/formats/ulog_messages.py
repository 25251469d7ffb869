"""A walk over the messages of a PX4 log (ULog), before its library reads it.

`pyulog` looks for the next message of a damaged file byte by byte and takes a definition at its
word, whatever it asks for. This walk takes the whole messages alone, finds the next one behind
damage by the log's sync messages, and bounds what the definitions ask for.
(https://docs.px4.io/main/en/dev_log/ulog_file_format)
"""

from __future__ import annotations

import re
import struct
from dataclasses import dataclass, field

from tombo_dynamics.errors import InputError

_HEADER = 16
_KNOWN = frozenset(b"BFIMPQARDLCSO")
_FLAGS, _FORMAT, _ADDED = b"BFA"
_SYNC = b"\x08\x00S\x2f\x73\x13\x20\x25\x0c\xbb\x12"
_LARGEST_UNKNOWN = 10_000
"""Bytes of a message of another kind, which is left out; a larger one is damage."""
_MOST_FIELDS = 500_000
"""Of all topics that are added; PX4's have some 20 000."""
_FIELD = re.compile(rb"^\s*([^\s\[]+)(?:\[(\d{1,9})\])? ")
_PLAIN = frozenset(
    f"{kind}_t".encode() for kind in ("int8", "uint8", "int16", "uint16", "int32", "uint32",
                                      "int64", "uint64")
) | {b"float", b"double", b"bool", b"char"}  # fmt: skip
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


def whole_messages(raw: bytes, what: str) -> tuple[bytes, UlogMessages]:
    """Return a log without what is no message, and what was found; a whole log as it is.

    Raises:
        InputError: its definitions ask for more than any log has; `what` names it.
    """
    messages, formats, fields = UlogMessages(), _Formats(what), 0
    ends = [*_appended(raw), len(raw)]
    at = _HEADER
    for end in ends:
        at, fields = _walk(raw, at, end, messages, formats, fields)
        if at != end and end != len(raw):
            messages.damaged, at = True, end
    messages.cut = at != len(raw)
    if not messages.damaged:
        return raw, messages
    parts = [raw[:_HEADER]] + [raw[start:end] for start, end in messages.spans]
    return _without_offsets(b"".join(parts)), messages


def _walk(
    raw: bytes, at: int, end: int, messages: UlogMessages, formats: _Formats, fields: int
) -> tuple[int, int]:
    """Take messages up to an end; return where they stop, and the fields of topics so far."""
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
            if kind == _FORMAT:
                formats.add(raw[at + 3 : after])
            elif kind == _ADDED:
                fields += formats.fields_of(raw[at + 6 : after])
                formats.check(fields)
            at = after
            continue
        if at > begun:
            messages.take(begun, at)
        messages.damaged = True
        unknown = kind != 0 and 0 < size <= _LARGEST_UNKNOWN and after <= end
        next_sync = raw.find(_SYNC, at + 1, after if unknown else end)
        if next_sync < 0 and not unknown:
            return end, fields  # nothing says where the next message begins
        at = begun = after if next_sync < 0 else next_sync
    if at > begun:
        messages.take(begun, at)
    return at, fields


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


class _Formats:
    """Formats of messages, by name, and how many fields each has in all."""

    def __init__(self, what: str) -> None:
        self._what = what
        self._parts: dict[bytes, list[tuple[bytes, int]]] = {}
        self._counts: dict[bytes, int] = {}

    def add(self, text: bytes) -> None:
        """Take a format: `name:type[n] field;type field;`."""
        name, _, rest = text.partition(b":")
        matches = (_FIELD.match(part) for part in rest.split(b";"))
        self._parts[name] = [(m[1], max(int(m[2] or 1), 1)) for m in matches if m is not None]
        self._counts.clear()

    def fields_of(self, name: bytes, outer: tuple[bytes, ...] = ()) -> int:
        """Return how many fields a message has, those within its fields counted.

        Raises:
            InputError: it contains itself, or too many.
        """
        if name in _PLAIN or name not in self._parts:
            return 1
        if name in outer:
            raise self._refused("a message that contains itself")
        if name not in self._counts:
            total = 0
            for kind, count in self._parts[name]:
                total += count * self.fields_of(kind, (*outer, name))
                self.check(total)
            self._counts[name] = total
        return self._counts[name]

    def check(self, fields: int) -> None:
        """Refuse more fields than any log has.

        Raises:
            InputError: there are.
        """
        if fields > _MOST_FIELDS:
            raise self._refused(f"messages of more than {_MOST_FIELDS} fields")

    def _refused(self, why: str) -> InputError:
        return InputError(f"{self._what} defines {why}; accepted: a PX4 log")
