"""STATUSTEXT where a ground station is heard, events on all links; refusals are counted.

Texts come in pieces if they are long, and are limited in rate. Events say the same as the texts;
no file explains them.
"""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from tombo_px4.link.decoded_messages import Severity
from tombo_px4.link.event_definitions import (
    ARMING_DENIED,
    CHECKS_BEGIN,
    CHECKS_END,
    KNOWN_EVENTS,
    event_number,
)
from tombo_px4.link.framing import ARGUMENTS, EventMessage
from tombo_px4.protocol.mavlink_channel import MavlinkChannel

_ALL_MODES = 0xFFFFFFFF
_MODES = {
    "check_modes_global_pos": 1 << 4 | 1 << 5,  # hold and return
    "check_modes_manual_control": 1 << 0 | 1 << 1 | 1 << 2 | 1 << 10 | 1 << 15,  # with sticks
    "check_modes_offboard_signal": 1 << 14,
    "check_modes_mission": 1 << 3,
    "check_modes_home_position": 1 << 5,
}
"""Checks that stand in the way of some modes alone, bits of PX4's `navigation_state_t`."""
_PROTOCOL = 8
_REASONS = {
    "external command": 4,
    "landing": 6,
    "auto preflight disarming": 7,
    "lockdown": 9,
    "failsafe": 14,
    "flight termination": 14,
}
"""Of arming and disarming, as PX4's `arm_disarm_reason_t`."""
_TEXTS = {
    "Arming denied: Resolve system health failures first": ARMING_DENIED,
    "Disarming denied: not landed": "commander_disarm_denied_not_landed",
    "Takeoff detected": "commander_takeoff_detected",
    "Landing detected": "commander_landing_detected",
    "Landing at current position": "commander_landing_current_pos",
    "Returning to launch": "commander_rtl",
    "Unsupported auto mode": "commander_unsupported_auto_mode",
}
_BEGINNINGS = {
    "Switching to ": "commander_modeswitch_not_avail",
    "Failsafe activated: ": "commander_failsafe_enter",
}
_PROBLEMS = {
    "No valid attitude estimate": "check_modes_attitude",
    "Navigation error: No valid position estimate": "check_modes_local_pos",
    "Navigation error: No valid global position estimate": "check_modes_global_pos",
    "No offboard signal": "check_modes_offboard_signal",
    "No manual control input": "check_modes_manual_control",
    "No valid mission available": "check_modes_mission",
    "Home position not set": "check_modes_home_position",
    "Mode not suitable for arming": "check_modes_cannot_takeoff",
    "Critical battery": "check_battery_critical",
    "Emergency battery level": "check_battery_emergency",
    "Flight termination active": "check_system_flight_term_active",
}


def event_of(text: str) -> tuple[str, int] | None:
    """Return name and first argument of the event that says the same; None: there is none."""
    for verb, name in (
        ("Armed by ", "commander_armed_by"),
        ("Disarmed by ", "commander_disarmed_by"),
    ):
        if text.startswith(verb):
            return name, _REASONS.get(text.removeprefix(verb), 0)
    for beginning, name in _BEGINNINGS.items():
        if text.startswith(beginning):
            return name, 0
    named = _TEXTS.get(text)
    return None if named is None else (named, 0)


PIECE = 50
"""Bytes of text that a message carries."""
_MOST_PIECES = 6
_BURST, _PER_SECOND = 40.0, 10.0
_MOST_UNREAD = 256
_AGAIN_US = 30_000_000
"""A refusal for the same reason is sent again after this time."""
_MOST_REASONS = 256


class StatusTextSender:
    """Sends texts, and events that say the same, and counts refusals."""

    def __init__(self, channels: Sequence[MavlinkChannel]) -> None:
        self._channels = channels
        self._event_sequence = 0
        self._reported: tuple[str, ...] = ()
        """Failed checks of arming."""
        self._number = -1
        """Of the last text. PX4 counts from 0."""
        self.counts: dict[str, int] = {}
        """How often something was refused, by reason."""
        self._refusal_sent_us: dict[str, int] = {}
        self._rate_tokens = _BURST
        self._refilled_us = 0
        self.sent_texts: list[tuple[int, str]] = []
        """Severity and text of what was sent; the reader empties the list."""

    def say(self, severity: int, text: str, boot_us: int) -> None:
        """Send a text now, unless there were too many."""
        self._rate_tokens += (boot_us - self._refilled_us) * 1e-6 * _PER_SECOND
        self._rate_tokens = min(self._rate_tokens, _BURST)
        self._refilled_us = boot_us
        if self._rate_tokens < 1.0:
            return
        self._rate_tokens -= 1.0
        if len(self.sent_texts) < _MOST_UNREAD:
            self.sent_texts.append((severity, text))
        event, mark = event_of(text), ""
        if event is not None:
            mark = "\t"
            self._send_event(event[0], severity, boot_us, event[1])
        self._number = (self._number + 1) % 65536
        for port in self._channels:
            if port.hears_station(boot_us):
                for message in self.messages(port.mav, severity, text + mark):
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

    def report_checks(
        self, problems: tuple[str, ...], boot_us: int, *, asked: bool = False
    ) -> None:
        """Send what stands in the way of arming, if it has changed or was asked for."""
        if problems == self._reported and not asked:
            return
        self._reported = problems
        self._send_event(CHECKS_BEGIN, _PROTOCOL, boot_us)
        for problem in problems:
            if problem in _PROBLEMS:
                name = _PROBLEMS[problem]
                self._send_event(name, Severity.ERROR, boot_us, _MODES.get(name, _ALL_MODES))
        self._send_event(CHECKS_END, _PROTOCOL, boot_us)

    def _send_event(self, name: str, severity: int, boot_us: int, first: int = 0) -> None:
        kinds = KNOWN_EVENTS[name].format if name in KNOWN_EVENTS else "<"
        values = [first, *([0] * 8)][: len(kinds) - 1]
        arguments = list(struct.pack(kinds, *values).ljust(ARGUMENTS, b"\0"))
        self._event_sequence = (self._event_sequence + 1) % 65536
        content = (event_number(name), boot_us // 1000 % 2**32, self._event_sequence)
        for port in self._channels:
            port.send(EventMessage(*content, 0, 0, severity << 4 | severity, arguments))

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
        last_us = self._refusal_sent_us.get(reason)
        if last_us is not None and boot_us - last_us < _AGAIN_US:
            return False
        self._refusal_sent_us[reason] = boot_us
        return True
