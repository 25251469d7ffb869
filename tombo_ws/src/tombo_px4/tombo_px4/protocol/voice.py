"""What the vehicle says to people: STATUSTEXT on all links, never more than they can read."""

from __future__ import annotations

from collections.abc import Sequence

from tombo_px4.protocol.port import Port
from tombo_px4.protocol.results import Severity
from tombo_px4.protocol.status_text import Complaints, StatusTexts

_BURST, _PER_SECOND = 40.0, 10.0
_KEPT = 256


class Voice:
    """Speaks on all links, and counts what was refused."""

    def __init__(self, ports: Sequence[Port]) -> None:
        self._ports = ports
        self._texts = StatusTexts()
        self._complaints = Complaints()
        self._breath = _BURST
        self._then_us = 0
        self.said: list[tuple[int, str]] = []
        """Severity and text of what was said; whoever shows it empties the list."""
        self.unsaid = 0
        """Texts left out, as there were too many."""

    @property
    def counts(self) -> dict[str, int]:
        """How often something was refused, by reason."""
        return self._complaints.counts

    def say(self, severity: int, text: str, boot_us: int) -> None:
        """Say something now."""
        self._breath += (boot_us - self._then_us) * 1e-6 * _PER_SECOND
        self._breath = min(self._breath, _BURST)
        self._then_us = boot_us
        if self._breath < 1.0:
            self.unsaid += 1
            return
        self._breath -= 1.0
        if len(self.said) < _KEPT:
            self.said.append((severity, text))
        for port in self._ports:
            for message in self._texts.messages(port.mav, severity, text):
                port.send(message)

    def complain(self, reason: str, boot_us: int, detail: str = "") -> None:
        """Count a refusal, and say it now and then."""
        if self._complaints.note(reason, boot_us):
            text = f"{reason}: {detail}" if detail else reason
            self.say(Severity.WARNING, text, boot_us)

    def note(self, reason: str, boot_us: int) -> None:
        """Count something that nobody need be told."""
        self._complaints.note(reason, boot_us)
