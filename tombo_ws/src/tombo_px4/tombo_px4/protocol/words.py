"""What the vehicle says: STATUSTEXT where a ground station is heard, events on all links.

Events say the same as the texts; their numbers are those of PX4 1.17, and no file explains them.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link.decoded_messages import Severity
from tombo_px4.link.extra_messages import EventMessage
from tombo_px4.protocol.channel import MavlinkChannel


class Px4Event(NamedTuple):
    """An event as PX4 sends it."""

    number: int
    kinds: str = ""
    """Of its arguments, as `struct` takes them."""
    modes: int = 0
    """Of a check: modes that it forbids, bits of PX4's `navigation_state_t`."""


_CHECK = "IB"
_ALL_MODES = 0xFFFFFFFF
_STICKS = 1 << 0 | 1 << 1 | 1 << 2 | 1 << 10 | 1 << 15
CHECKS_BEGIN, CHECKS_END = Px4Event(0x01A893E0, "BIIII"), Px4Event(0x011D3727, "BIII")
TEXTS = {
    "Arming denied: Resolve system health failures first": Px4Event(0x0102089D),
    "Disarming denied: not landed": Px4Event(0x018AB9B5),
    "Takeoff detected": Px4Event(0x01414569),
    "Landing detected": Px4Event(0x019638AC),
    "Landing at current position": Px4Event(0x0132B2DE),
    "Returning to launch": Px4Event(0x01352CE4),
    "Unsupported auto mode": Px4Event(0x012F2F05),
}
"""Text to the event that says the same. Numbers and kinds are those of `all_events.json`, which
the build of PX4 1.17 writes."""
BEGINNINGS = {
    "Armed by ": Px4Event(0x0190CAF3, "B"),
    "Disarmed by ": Px4Event(0x01F46777, "B"),
    "Switching to ": Px4Event(0x01A04397, "IB"),
    "Failsafe activated: ": Px4Event(0x0194CA8A, "IBB"),
}
"""The same by the beginning of a text."""
PROBLEMS = {
    "No valid attitude estimate": Px4Event(0x019F748F, _CHECK, _ALL_MODES),
    "Navigation error: No valid position estimate": Px4Event(0x01D31BB9, _CHECK, _ALL_MODES),
    "Navigation error: No valid global position estimate": Px4Event(
        0x0198C273, _CHECK, 1 << 4 | 1 << 5
    ),
    "No offboard signal": Px4Event(0x012F1DC7, _CHECK, 1 << 14),
    "No manual control input": Px4Event(0x0106ED29, _CHECK, _STICKS),
    "No valid mission available": Px4Event(0x0105C2D9, _CHECK, 1 << 3),
    "Mode not suitable for arming": Px4Event(0x011C8F61, _CHECK, _ALL_MODES),
    "Critical battery": Px4Event(0x0128180B, _CHECK, _ALL_MODES),
    "Emergency battery level": Px4Event(0x01AD1B07, _CHECK, _ALL_MODES),
    "Flight termination active": Px4Event(0x01C2A00A, _CHECK, _ALL_MODES),
}
"""The same of a failed check of arming."""
_PROTOCOL = 8
_REASONS = {
    "external command": 4,
    "landing": 6,
    "auto preflight disarming": 7,
    "failsafe": 14,
    "flight termination": 14,
}
"""Of arming and disarming, as PX4's `arm_disarm_reason_t`."""


PIECE = 50
"""Bytes of text that a message carries."""
_MOST_PIECES = 6
_MOST_UNREAD = 256


def event_of(text: str) -> tuple[Px4Event, int] | None:
    """Return the event that says the same, and its first argument; None: there is none."""
    for beginning, event in BEGINNINGS.items():
        if text.startswith(beginning):
            return event, _REASONS.get(text.removeprefix(beginning), 0)
    named = TEXTS.get(text)
    return None if named is None else (named, 0)


class Announcer:
    """Sends texts, and events that say the same, and counts refusals."""

    def __init__(self, channels: Sequence[MavlinkChannel]) -> None:
        self._channels = channels
        self._event_sequence = 0
        self._reported: tuple[str, ...] = ()
        """Failed checks of arming."""
        self._number = -1
        """Of the last text. PX4 counts from 0."""
        self.refused: Counter[str] = Counter()
        """How often something was refused, by reason."""
        self.sent_texts: list[tuple[int, str]] = []
        """Severity and text of what was sent; the reader empties the list."""

    def say(self, severity: int, text: str, boot_us: int) -> None:
        """Send a text now, in pieces if it is long; what is not ASCII becomes `?`."""
        if len(self.sent_texts) < _MOST_UNREAD:
            self.sent_texts.append((severity, text))
        event = event_of(text)
        if event is not None:
            text += "\t"
            self._send_event(event[0], severity, boot_us, event[1])
        self._number = (self._number + 1) % 65536
        data = text.encode("ascii", "replace")[: _MOST_PIECES * PIECE]
        # like PX4's, a text that fills its last piece has no other one that would end it
        for i, first in enumerate(range(0, max(len(data), 1), PIECE)):
            content = (severity, data[first : first + PIECE], self._number, i)
            for channel in self._channels:
                if channel.hears_station(boot_us):
                    channel.link.send(mavlink.MAVLink_statustext_message(*content))

    def report_checks(
        self, problems: tuple[str, ...], boot_us: int, *, asked: bool = False
    ) -> None:
        """Send what stands in the way of arming, if it has changed or was asked for."""
        if problems == self._reported and not asked:
            return
        self._reported = problems
        self._send_event(CHECKS_BEGIN, _PROTOCOL, boot_us)
        for event in (PROBLEMS[problem] for problem in problems if problem in PROBLEMS):
            self._send_event(event, Severity.ERROR, boot_us, event.modes)
        self._send_event(CHECKS_END, _PROTOCOL, boot_us)

    def _send_event(self, event: Px4Event, severity: int, boot_us: int, first: int = 0) -> None:
        values = [first, *([0] * 8)][: len(event.kinds)]
        arguments = list(struct.pack(f"<{event.kinds}", *values).ljust(40, b"\0"))
        self._event_sequence = (self._event_sequence + 1) % 65536
        content = (event.number, boot_us // 1000 % 2**32, self._event_sequence)
        for channel in self._channels:
            channel.link.send(EventMessage(*content, 0, 0, severity << 4 | severity, arguments))
