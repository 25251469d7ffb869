"""A command to PX4 (mode, arm, disarm): sent, confirmed by HEARTBEAT, repeated, given up."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.decoded_messages import CommandAck, Heartbeat, Result, Severity, StatusText
from tombo_px4.modes import Mode, mode_name

SET_MODE_COMMAND, ARM_COMMAND = 176, 400
"""MAV_CMD_DO_SET_MODE, MAV_CMD_COMPONENT_ARM_DISARM."""
CONFIRM_NS = 2 * SECOND_NS
"""Longest wait for the heartbeat (1 Hz) that confirms a command."""
PAUSE_NS = SECOND_NS
"""Pause between a refusal and the next attempt; PX4 sends its explanation meanwhile."""


@dataclass(frozen=True)
class VehicleCommand:
    """A mode, or armed or not: one of the two is set."""

    mode: Mode | None = None
    armed: bool | None = None
    force: bool = False
    """Disarms in the air, too."""

    @property
    def command(self) -> int:
        """Number of the MAVLink command."""
        return SET_MODE_COMMAND if self.mode is not None else ARM_COMMAND

    def confirmed_by(self, heartbeat: Heartbeat) -> bool:
        """Return whether the heartbeat shows the commanded state."""
        if self.mode is not None:
            return heartbeat.mode == self.mode
        return heartbeat.armed == self.armed

    def __str__(self) -> str:
        if self.mode is not None:
            return f"mode {mode_name(self.mode)}"
        return "arming" if self.armed else "disarming" + (" by force" if self.force else "")


class RecentStatusTexts:
    """The last warnings of PX4, to explain a refusal."""

    def __init__(self) -> None:
        self._texts: deque[StatusText] = deque(maxlen=8)

    def take(self, text: StatusText) -> None:
        """Keep a text if it is a warning or worse."""
        if text.severity <= Severity.WARNING:
            self._texts.append(text)

    def since(self, time_ns: int) -> str:
        """Return the texts since a time, each once."""
        texts = dict.fromkeys(t.text for t in self._texts if t.arrival_ns >= time_ns)
        return ", ".join(f"'{text}'" for text in texts)


class CommandTransaction:
    """A command in progress. `tick` tells when to send it; `done` or `failed` ends it."""

    def __init__(self, order: VehicleCommand, tries: int) -> None:
        self.order = order
        self.done = False
        self.failed = False
        self.refusal = ""
        """Why PX4 refused it the last time, or did not answer."""
        self._tries = tries
        self._begun_ns = 0
        self._sent_ns: int | None = None
        self._refused_ns: int | None = None
        self._result = int(Result.ACCEPTED)

    def handle_ack(self, ack: CommandAck) -> None:
        """Take an answer. A refusal is final for this attempt; only HEARTBEAT confirms."""
        if ack.command != self.order.command or self._sent_ns is None or self.done:
            return
        if ack.result not in (Result.ACCEPTED, Result.IN_PROGRESS) and self._refused_ns is None:
            self._refused_ns, self._result = ack.arrival_ns, ack.result

    def tick(self, heartbeat: Heartbeat, recent_texts: RecentStatusTexts, now_ns: int) -> bool:
        """Advance; return whether the command is to be sent now."""
        if self._sent_ns is None:  # even if it looks met: the last heartbeat may be a second old
            return self._send(now_ns)
        if self.order.confirmed_by(heartbeat) and heartbeat.arrival_ns > self._begun_ns:
            self.done = True
            return False
        if self._refused_ns is not None:
            if now_ns - self._refused_ns < PAUSE_NS:
                return False
            why = _result_name(self._result)
        elif now_ns - self._sent_ns < CONFIRM_NS:
            return False
        else:
            why = f"not confirmed by HEARTBEAT within {CONFIRM_NS * 1e-9:.0f} s"
        said = recent_texts.since(self._sent_ns)
        self.refusal = f"{self.order} {why}" + (f": {said}" if said else "")
        if self._tries <= 0:
            self.failed = True
            return False
        return self._send(now_ns)

    def _send(self, now_ns: int) -> bool:
        self._tries -= 1
        self._begun_ns = self._begun_ns or now_ns
        self._sent_ns, self._refused_ns = now_ns, None
        return True


def _result_name(result: int) -> str:
    if result in range(Result.CANCELLED + 1):
        return Result(result).name.lower().replace("_", " ")
    return f"result {result}"
