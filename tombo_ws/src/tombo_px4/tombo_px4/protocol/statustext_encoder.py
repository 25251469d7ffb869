"""Encodes STATUSTEXT; long texts are sent in pieces, repeated refusals at a limited rate."""

from __future__ import annotations

from typing import Any

PIECE = 50
"""Bytes of text that a message carries."""
_MOST_PIECES = 6
_AGAIN_US = 30_000_000
"""A refusal for the same reason is sent again after this time."""
_MOST_TOPICS = 256


class StatusTextEncoder:
    """Makes the messages; counts texts, as the pieces of a long one carry its number."""

    def __init__(self) -> None:
        self._number = 0

    def messages(self, mav: Any, severity: int, text: str) -> list[Any]:
        """Return the STATUSTEXT messages of a text; what is not ASCII becomes `?`."""
        data = text.encode("ascii", "replace")[: _MOST_PIECES * PIECE]
        if len(data) <= PIECE:
            return [mav.statustext_encode(severity, data, 0, 0)]
        self._number = self._number % 65535 + 1
        pieces = [data[i : i + PIECE] for i in range(0, len(data), PIECE)]
        if len(pieces[-1]) == PIECE:
            pieces.append(b"")  # only a piece that is not full ends a text
        return [
            mav.statustext_encode(severity, piece, self._number, i)
            for i, piece in enumerate(pieces)
        ]


class RefusalLog:
    """Counts refusals by reason, and tells when to send a text about one."""

    def __init__(self) -> None:
        self.counts: dict[str, int] = {}
        self._said_us: dict[str, int] = {}

    def note(self, reason: str, boot_us: int) -> bool:
        """Count a refusal; return whether to send a text now."""
        if reason not in self.counts and len(self.counts) >= _MOST_TOPICS:
            reason = "other"
        self.counts[reason] = self.counts.get(reason, 0) + 1
        said = self._said_us.get(reason)
        if said is not None and boot_us - said < _AGAIN_US:
            return False
        self._said_us[reason] = boot_us
        return True
