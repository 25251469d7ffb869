"""STATUSTEXT on all links, limited in rate."""

from __future__ import annotations

from collections.abc import Sequence

from tombo_px4.protocol.mavlink_channel import MavlinkChannel
from tombo_px4.protocol.results import Severity
from tombo_px4.protocol.statustext_encoder import RefusalLog, StatusTextEncoder

_BURST, _PER_SECOND = 40.0, 10.0
_KEPT = 256


class StatusTextSender:
    """Sends texts on all links and counts refusals."""

    def __init__(self, channels: Sequence[MavlinkChannel]) -> None:
        self._channels = channels
        self._texts = StatusTextEncoder()
        self._refusal_log = RefusalLog()
        self._rate_tokens = _BURST
        self._refilled_us = 0
        self.said: list[tuple[int, str]] = []
        """Severity and text of what was sent; the reader empties the list."""

    @property
    def counts(self) -> dict[str, int]:
        """How often something was refused, by reason."""
        return self._refusal_log.counts

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
        for port in self._channels:
            for message in self._texts.messages(port.mav, severity, text):
                port.send(message)

    def report_refusal(self, reason: str, boot_us: int, detail: str = "") -> None:
        """Count a refusal, and send it as a text, at most every 30 s for each reason."""
        if self._refusal_log.note(reason, boot_us):
            text = f"{reason}: {detail}" if detail else reason
            self.say(Severity.WARNING, text, boot_us)

    def note(self, reason: str, boot_us: int) -> None:
        """Count a refusal without sending a text."""
        self._refusal_log.note(reason, boot_us)
