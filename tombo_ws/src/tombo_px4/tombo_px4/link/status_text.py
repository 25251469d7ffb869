"""Texts of STATUSTEXT: those longer than 50 characters come in pieces."""

from __future__ import annotations

from dataclasses import dataclass, field

from tombo_px4.link.decoded_messages import Refused, StatusText

_FULL = 50
"""A piece of this length is followed by another."""
_PATIENCE_NS = 1_000_000_000
_MOST_TEXTS, _MOST_CHUNKS = 8, 8
_GAP = "…"


@dataclass
class _PartialText:
    severity: int
    arrival_ns: int
    chunks: dict[int, str] = field(default_factory=dict)
    last: int | None = None

    def text(self, number: int) -> StatusText:
        end = self.last if self.last is not None else max(self.chunks, default=0)
        words = "".join(self.chunks.get(k, _GAP) for k in range(end + 1))
        if self.last is None and (number or end):
            words += _GAP
        return _whole(self.arrival_ns, self.severity, words)


class StatusTextAssembler:
    """Puts pieces together in whichever order they come; a missing one becomes `…`."""

    def __init__(self) -> None:
        self._growing: dict[int, _PartialText] = {}

    def take(
        self, severity: int, text: str, number: int, chunk: int, arrival_ns: int
    ) -> StatusText | None:
        """Take a piece; return the text once it is whole.

        Args:
            severity: MAV_SEVERITY.
            text: up to 50 characters.
            number: of the text; 0: it is whole in itself, but also of PX4's first one in pieces.
            chunk: place of the piece in it.
            arrival_ns: when it came.

        Raises:
            Refused: out of bounds, or too many texts are incomplete.
        """
        if not 0 <= severity <= 7:
            raise Refused("range")
        if number == 0 and chunk == 0 and len(text) < _FULL:
            return _whole(arrival_ns, severity, text)
        if chunk >= _MOST_CHUNKS:
            raise Refused("range")
        if number not in self._growing and len(self._growing) >= _MOST_TEXTS:
            raise Refused("too_many")
        if number == 0 and chunk == 0 and 0 in self._growing:  # a sender without numbers
            before = self._growing.pop(0).text(0)
            self._growing[0] = _PartialText(severity, arrival_ns, {0: text})
            return before
        growing = self._growing.setdefault(number, _PartialText(severity, arrival_ns))
        growing.chunks[chunk] = text
        if len(text) < _FULL:
            growing.last = chunk
            for k in [k for k in growing.chunks if k > chunk]:
                del growing.chunks[k]
        if growing.last is None or len(growing.chunks) <= growing.last:
            return None
        del self._growing[number]
        return growing.text(number)

    def take_expired(self, now_ns: int) -> list[StatusText]:
        """Return incomplete texts that have waited for a second."""
        texts = self._growing.items()
        late = [number for number, text in texts if now_ns - text.arrival_ns > _PATIENCE_NS]
        return [self._growing.pop(number).text(number) for number in late]


def _whole(arrival_ns: int, severity: int, text: str) -> StatusText:
    """Return a text; PX4 ends those with a tabulator that it sends as an EVENT, too."""
    return StatusText(arrival_ns, severity, _printable(text), text.endswith("\t"))


def _printable(text: str) -> str:
    return "".join(c if c.isprintable() else " " for c in text).strip()
