"""STATUSTEXT where a ground station is heard, events on all links; refusals are counted.

Texts come in pieces if they are long, and are limited in rate.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from tombo_px4.link.decoded_messages import Severity
from tombo_px4.protocol.event_sender import EventSender, event_of
from tombo_px4.protocol.mavlink_channel import MavlinkChannel

PIECE = 50
"""Bytes of text that a message carries."""
_MOST_PIECES = 6
_BURST, _PER_SECOND = 40.0, 10.0
_KEPT = 256
_AGAIN_US = 30_000_000
"""A refusal for the same reason is sent again after this time."""
_MOST_REASONS = 256


class StatusTextSender:
    """Sends texts on all links and counts refusals."""

    def __init__(self, channels: Sequence[MavlinkChannel]) -> None:
        self._channels = channels
        self.events = EventSender(channels)
        self._number = -1
        """Of the last text. PX4 counts from 0."""
        self.counts: dict[str, int] = {}
        """How often something was refused, by reason."""
        self._said_us: dict[str, int] = {}
        self._rate_tokens = _BURST
        self._refilled_us = 0
        self.said: list[tuple[int, str]] = []
        """Severity and text of what was sent; the reader empties the list."""

    def say(self, severity: int, text: str, boot_us: int) -> None:
        """Send a text now, unless there were too many."""
        self._rate_tokens += (boot_us - self._refilled_us) * 1e-6 * _PER_SECOND
        self._rate_tokens = min(self._rate_tokens, _BURST)
        self._refilled_us = boot_us
        if self._rate_tokens < 1.0:
            return
        self._rate_tokens -= 1.0
        if len(self.said) < _KEPT:
            self.said.append((severity, text))
        self.events.say(severity, text, boot_us)
        also_event = event_of(text) is not None
        self._number = (self._number + 1) % 65536
        for port in self._channels:
            if port.hears_station(boot_us):
                for message in self.messages(port.mav, severity, text + "\t" * also_event):
                    port.send(message)

    def messages(self, mav: Any, severity: int, text: str) -> list[Any]:
        """Return the STATUSTEXT messages of a text; what is not ASCII becomes `?`."""
        data = text.encode("ascii", "replace")[: _MOST_PIECES * PIECE]
        # like PX4's, a text that fills its last piece has no other one that would end it
        pieces = [data[i : i + PIECE] for i in range(0, max(len(data), 1), PIECE)]
        return [
            mav.statustext_encode(severity, piece, max(self._number, 0), i)
            for i, piece in enumerate(pieces)
        ]

    def report_refusal(self, reason: str, boot_us: int, detail: str = "") -> None:
        """Count a refusal, and send it as a text, at most every 30 s for each reason."""
        if self.note(reason, boot_us):
            text = f"{reason}: {detail}" if detail else reason
            self.say(Severity.WARNING, text, boot_us)

    def note(self, reason: str, boot_us: int) -> bool:
        """Count a refusal; return whether a text may be sent about it now."""
        if reason not in self.counts and len(self.counts) >= _MOST_REASONS:
            reason = "other"
        self.counts[reason] = self.counts.get(reason, 0) + 1
        said_us = self._said_us.get(reason)
        if said_us is not None and boot_us - said_us < _AGAIN_US:
            return False
        self._said_us[reason] = boot_us
        return True
