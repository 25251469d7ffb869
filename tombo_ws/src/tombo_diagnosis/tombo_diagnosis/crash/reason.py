"""From signs to the most probable cause: the first that no earlier one explains."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Flight, finding_mapping
from tombo_diagnosis.control.oscillation import oscillation
from tombo_diagnosis.crash.motion import CrashMotion, crash_motion
from tombo_diagnosis.crash.signs import Sign, signs
from tombo_diagnosis.engine.verdict import succession
from tombo_logs.checks import findings_of

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
"""Signs that a flight failed. They are not causes."""
_BEFORE: Final = ("turns", "bump")
"""Signs that come before those, without evidence of the cause."""
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
    """The cause of a crash or fault in a flight."""

    cause: str
    """One of CAUSES' values, none, set or unknown."""
    time_s: float | None
    """Of the first deviation, on the log's clock; None: nothing is wrong."""
    confidence: float
    """0 to 1: share of measured answers like it that were right."""
    members: tuple[str, ...]
    """Members of a set."""
    timeline: tuple[Sign, ...]
    """The signs, in order of time."""
    findings: tuple[Finding, ...]
    """Findings of the checks of the log."""
    flight: Flight


_TRIED: Final = {
    "kill": (10, 0), "motor_or_propeller_lost": (21, 1), "loss_of_position": (22, 1),
    "battery": (11, 1), "contact": (32, 1), "oscillation": (18, 0), "command": (9, 0),
    "set": (0, 0), "unknown": (0, 0),
}  # fmt: skip
"""Cause → answers, and how many were wrong: 100 crashes of rotorpy (`tombo benchmark why --seed
300`) and the real flights with a known mishap (`tombo benchmark real`)."""
_DOUBTED: Final = (17, 1)
"""The same of logs that the checks doubt, among 100 crashes of an earlier simulator."""
_DONE_BY_CRASHES: Final = {
    "crash", "contact", "jump", "frozen", "saturation", "gap", "rpm", "change", "ground", "wind",
}  # fmt: skip
"""Checks whose faults a crash brings about in a sound log."""
_MISHAPS: Final = {"poses alone": (10, 4), "more": (9, 0)}
"""Channels of a log → number of real flights with a known mishap, and how many of these leave no
sign: 10 of air_garage (2024), 9 of crazyswarm2 (up to flight 149). Later flights of both were not
looked at for these figures."""


def _sound(motion: CrashMotion) -> float:
    """Return the confidence that a log without a sign is of a sound flight; even odds before.

    The trace of a mishap depends on the channels of the log.
    """
    more = {"gyro", "accel", *DRIVES} & set(motion.series)
    seen = succession(*_MISHAPS["more" if more else "poses alone"])
    return 1.0 / (2.0 - seen)


def why(log: Flight) -> Why:
    """Say why a flight went wrong: findings of the checks, then the signs in the log.

    Raises:
        InputError: it has no position, is too short, or its poses are of several bodies.
    """
    findings = findings_of(log)
    motion = crash_motion(log)
    line = signs(motion)
    swing = None if motion.controlled is None else oscillation(motion.controlled)
    cause, time, members = name_cause(line)
    if cause == "none" and swing is not None:
        cause, time = CAUSES["oscillation"], swing.begin_s
        line = sorted([*line, Sign(time, "oscillation", swing.text)], key=lambda s: s.time)
    stated = _sound(motion) if cause == "none" else succession(*_TRIED[cause])
    if any(is_doubt(f) for f in findings):
        stated = min(stated, succession(*_DOUBTED))
    return Why(cause, time, stated, members, tuple(line), findings, log)


def is_doubt(finding: Finding) -> bool:
    """Return whether a finding doubts the log itself: a crash does not do that to it."""
    by_stamps = finding.check == "stamps" and finding.key not in ("", "unknown clock")
    return by_stamps or (finding.severity == "fault" and finding.check not in _DONE_BY_CRASHES)


def name_cause(line: list[Sign]) -> tuple[str, float | None, tuple[str, ...]]:
    """Return cause, time [s] and the members of a set."""
    bad = [s for s in line if s.kind in _BAD]
    # a sign at the time of an upset may be its cause; a sign after an impact is not
    ends = min((s.time + 0.05 * (s.kind != "impact") for s in bad), default=float("inf"))
    causes = [s for s in line if s.kind in _RANK and s.time < ends and _counts(s, bad)]
    if not causes:
        if not bad:
            return "none", None, ()
        before = [s.time for s in line if s.kind in _BEFORE and bad[0].time - s.time < _TUMBLES_S]
        return "unknown", min([bad[0].time, *before]), ()
    first = causes[0].time
    near = [s for s in causes if s.time < first + _TOGETHER_S]
    chosen = min(near, key=lambda s: (_RANK.index(s.kind), s.time))
    if chosen.kind == "off":
        return "set", chosen.time, ("kill", "battery")
    return CAUSES[chosen.kind], chosen.time, ()


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
        "findings": [finding_mapping(f) for f in found.findings],
        "timeline": [
            {"time_s": s.time, "kind": CAUSES.get(s.kind, s.kind), "text": s.text}
            for s in found.timeline
        ],
    }
