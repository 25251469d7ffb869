"""Texts of the vehicle (STATUSTEXT), sent where a ground station is heard, and its refusals."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.protocol.channel import MavlinkChannel

PIECE = 50
"""Bytes of text that a message carries."""
_MOST_PIECES = 6
_MOST_UNREAD = 256


class Announcer:
    """Sends texts, and counts refusals."""

    def __init__(self, channels: Sequence[MavlinkChannel]) -> None:
        self._channels = channels
        self._number = -1
        """Of the last text. PX4 counts from 0."""
        self.refused: Counter[str] = Counter()
        """How often something was refused, by reason."""
        self.sent_texts: list[tuple[int, str]] = []
        """Severity and text of all sent messages; the reader empties the list."""

    def say(self, severity: int, text: str, boot_us: int) -> None:
        """Send a text now, in pieces if it is long; what is not ASCII becomes `?`."""
        if len(self.sent_texts) < _MOST_UNREAD:
            self.sent_texts.append((severity, text))
        self._number = (self._number + 1) % 65536
        data = text.encode("ascii", "replace")[: _MOST_PIECES * PIECE]
        # like PX4's, a text that fills its last piece has no other one that would end it
        for i, first in enumerate(range(0, max(len(data), 1), PIECE)):
            content = (severity, data[first : first + PIECE], self._number, i)
            for channel in self._channels:
                if channel.hears_station(boot_us):
                    channel.link.send(mavlink.MAVLink_statustext_message(*content))
