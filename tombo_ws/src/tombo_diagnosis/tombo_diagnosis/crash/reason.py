"""From signs to the most probable cause: the first that no earlier one explains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Flight
from tombo_diagnosis.control.oscillation import oscillation
from tombo_diagnosis.control.signals import control_signals
from tombo_diagnosis.crash.motion import CrashMotion, crash_motion
from tombo_diagnosis.crash.signs import Sign, signs
from tombo_diagnosis.engine.verdict import succession

CAUSES: Final = {
    "motor": "motor_or_propeller_lost",
    "rotor": "motor_or_propeller_lost",
    "contact": "contact",
    "oscillation": "oscillation",
    "position": "loss_of_position",
    "battery": "battery",
    "command": "command",
    "kill": "kill",
}
"""Kind of sign → cause."""
_BAD: Final = ("upset", "fall", "impact")
"""What shows that a flight went wrong, and is no cause."""
_BEFORE: Final = ("turns", "bump")
"""What comes before those, and says nothing of the cause."""
_TUMBLES_S: Final = 1.0
_TOGETHER_S: Final = 0.25
"""Signs this close began together: the more specific one counts."""
_RANK: Final = (
    "kill", "off", "motor", "position", "oscillation", "contact", "rotor", "battery", "command",
)  # fmt: skip
_ALONE: Final = ("motor", "kill", "contact", "oscillation", "rotor")
"""Wrong in themselves; others only if the flight ends badly soon."""
_SOON_S: Final = 2.5
_LONG_S: Final = 1.0
"""From which on lost poses are wrong in themselves."""
_EMPTY: Final = 0.3
"""Share of the voltage that is lost only by what is wrong."""


@dataclass(frozen=True)
class Why:
    """What went wrong in a flight."""

    cause: str
    """One of CAUSES' values, none, set or unknown."""
    time_s: float | None
    """Of the first deviation, on the log's clock; None: nothing is wrong."""
    confidence: float
    """0 to 1: share of simulated crashes with such signs in which this was right."""
    members: tuple[str, ...]
    """Of a set."""
    timeline: tuple[Sign, ...]
    """What was seen, in order of time."""
    flight: Flight
    motion: CrashMotion


_STATED: Final = {
    "kill": 0.97, "motor": 0.97, "rotor": 0.9, "position": 0.93, "battery": 0.9, "contact": 0.9,
    "oscillation": 0.9, "command": 0.85,
}  # fmt: skip
_MISHAPS: Final = {"poses alone": (10, 4), "more": (9, 0)}
"""What a log has → real flights with a known mishap, and how many of these leave no sign: 10 of
air_garage (2024), 9 of crazyswarm2 (up to flight 149). Later flights of both were not looked at
for these figures."""


def _sound(motion: CrashMotion) -> float:
    """Return the confidence that a log without a sign is of a sound flight; even odds before.

    What a mishap would have left in it depends on what the log has.
    """
    more = {"gyro", "accel", *DRIVES} & set(motion.series)
    seen = succession(*_MISHAPS["more" if more else "poses alone"])
    return 1.0 / (2.0 - seen)


def why(log: Flight) -> Why:
    """Say why a flight went wrong.

    Raises:
        InputError: it has no position, or is too short.
    """
    motion = crash_motion(log)
    line = signs(motion)
    swing = swing_of(log)
    cause, time, stated, members = judged(line, motion)
    if cause == "none" and swing is not None:
        line = sorted([*line, swing], key=lambda s: s.time)
        cause, time, stated = CAUSES["oscillation"], swing.time, _STATED["oscillation"]
    return Why(cause, time, stated, members, tuple(line), log, motion)


def swing_of(log: Flight) -> Sign | None:
    """Return the loop that swings through the flight, if one does."""
    seen = control_signals(log, None)
    swing = None if seen is None else oscillation(seen)
    return None if swing is None else Sign(swing.begin_s, "oscillation", swing.text)


def judged(
    line: list[Sign], motion: CrashMotion
) -> tuple[str, float | None, float, tuple[str, ...]]:
    """Return cause, time [s], confidence and the members of a set."""
    bad = [s for s in line if s.kind in _BAD]
    ends = min((s.time for s in bad), default=float("inf"))
    causes = [s for s in line if s.kind in _RANK and s.time < ends + 0.05 and _counts(s, bad)]
    if not causes:
        if not bad:
            return "none", None, _sound(motion), ()
        before = [s.time for s in line if s.kind in _BEFORE and bad[0].time - s.time < _TUMBLES_S]
        return "unknown", min([bad[0].time, *before]), 0.5, ()
    first = causes[0].time
    near = [s for s in causes if s.time < first + _TOGETHER_S]
    chosen = min(near, key=lambda s: (_RANK.index(s.kind), s.time))
    if chosen.kind == "off":
        return "set", chosen.time, 0.9, ("kill", "battery")
    return CAUSES[chosen.kind], chosen.time, _STATED[chosen.kind], ()


def _counts(sign: Sign, bad: list[Sign]) -> bool:
    if sign.kind in (*_ALONE, "off"):
        return True
    least = {"position": _LONG_S, "battery": _EMPTY}.get(sign.kind, float("inf"))
    return sign.size > least or any(-0.05 <= b.time - sign.time < _SOON_S for b in bad)


def why_mapping(found: Why) -> dict[str, Any]:
    """Return the answer as plain values."""
    return {
        "flight": found.flight.name,
        "cause": found.cause,
        "time_s": found.time_s,
        "confidence": found.confidence,
        "set": list(found.members),
        "timeline": [
            {"time_s": s.time, "kind": CAUSES.get(s.kind, s.kind), "text": s.text}
            for s in found.timeline
        ],
    }
