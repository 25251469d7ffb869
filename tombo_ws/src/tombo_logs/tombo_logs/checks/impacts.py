"""Crashes, contacts, and jumps that are errors of the motion capture.

A contact is excluded with the recovery from it; the rest after a crash, to the end.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from tombo_bag.flight import Finding
from tombo_logs.checks.events import Event
from tombo_logs.checks.spans import Span, inside, merged

_BEFORE_S = 0.25
"""s excluded before an event."""
_RECOVERY_S = 2.0
"""s after a contact that are the vehicle's recovery."""
_FALL_S = 3.0
"""An event is a crash if the vehicle is on the ground within this time [s]."""
_CONFIRMED_S = 0.15
"""s within which the gyro confirms a turn."""
_TURN_ALONE = 5.0
"""rad/s from which on a jump of the rate is an error where no gyro could deny it."""
_JUMP_S = 0.3
"""s around a jump of the poses alone that are excluded."""


def impacts(
    flight: str, events: list[Event], ground: list[Span], flown: Span, channels: Collection[str]
) -> list[Finding]:
    """Distinguish crashes, contacts and jumps of the motion capture; exclude the affected spans.

    Args:
        flight: name.
        events: sudden changes, in any order.
        ground: spans on the ground; what happens there is take-off and landing.
        flown: begin and end of the flight [s].
        channels: those of the flight: what only poses show though an acceleration or a gyro are
            there is an error of the poses, and what only turns is a manoeuvre.
    """
    begin, end = flown
    times = np.array([e.t for e in events])
    inflight = [e for e, down in zip(events, inside(times, ground), strict=True) if not down]
    findings = []
    for first, last in merged([(e.t, e.t) for e in inflight], apart=_RECOVERY_S):
        members = sorted((e for e in inflight if first <= e.t <= last), key=lambda e: e.t)
        kinds = {e.kind for e in members}
        # positions without an attitude are an estimator's: they jump where it is corrected
        by_track = "attitude" in channels and not {"accel", "acceleration"} & set(channels)
        hit = "lean" in kinds or ("track" if by_track else "accel") in kinds
        if not hit:
            findings += _pose_jumps(flight, members, "gyro" in channels)
            continue
        downed = any(b > begin and first < b <= last + _FALL_S and e >= end for b, e in ground)
        downed |= end - last < (_FALL_S if "lean" in kinds else 0.5)
        if downed:
            check, text, until = "crash", "a crash; set apart to the end", end
        else:
            check, text = "contact", "a contact, set apart with the recovery from it"
            until = min(last + _RECOVERY_S, end)
        message = f"at {first:.2f} s {_described(members)}: {text}"
        span = max(first - _BEFORE_S, begin), until
        findings.append(Finding(check, "fault", flight, message, *span, members[0].channel))
    return findings


def _pose_jumps(flight: str, members: list[Event], has_gyro: bool) -> list[Finding]:
    """Report where poses jump, but for turns that the gyro confirms."""
    turns = [e.t for e in members if e.kind == "gyro"]
    least = 0.0 if has_gyro else _TURN_ALONE
    jumps = [
        e
        for e in members
        if e.kind in ("track", "leap")
        or (
            e.kind == "turn"
            and e.size > least
            and not any(abs(e.t - t) < _CONFIRMED_S for t in turns)
        )
    ]
    findings = []
    for first, last in merged([(e.t, e.t) for e in jumps], apart=2.0 * _JUMP_S):
        there = [e for e in jumps if first <= e.t <= last]
        why = "the IMU does not" if has_gyro else "the track goes on"
        text = f"at {first:.2f} s {_described(there)}, {why}: markers swapped? Set apart"
        span = first - _JUMP_S, last + _JUMP_S
        findings.append(Finding("jump", "warning", flight, text, *span, there[0].channel))
    return findings


def _described(members: list[Event]) -> str:
    texts = list(dict.fromkeys(e.text for e in members))
    return ", ".join(texts[:3]) + (f" and {len(texts) - 3} more" if len(texts) > 3 else "")


def unmeasured(flight: str, events: list[Event], lines: list[Finding]) -> list[Finding]:
    """Report when readings look like a crash on a line that was drawn, not measured.

    `lines` are straight lines of gyro or accelerometer, already excluded; `events` lie on them.
    """
    findings = []
    for line in lines:
        on = [e for e in events if e.channel == line.channel and line.start_s <= e.t <= line.end_s]
        if on:
            first = min(on, key=lambda e: e.t)
            text = (
                f"at {first.t:.2f} s {first.text}, as in a crash; but from {line.start_s:.2f} s "
                f"on {line.channel} is a straight line and no measurement: what crashed is the "
                "log, the poses go on; set apart"
            )
            span = max(line.start_s - _BEFORE_S, 0.0), line.end_s
            findings.append(Finding("crash", "fault", flight, text, *span, first.channel))
    return findings
