"""Channels missing in a log: channels that are absent, or cover a part of the flight only."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.channels import DRIVES
from tombo_bag.flight import Finding, Series
from tombo_logs.checks.clocks.stamps import gap_spans
from tombo_logs.checks.spans import Span, inside, merged

IMU = ("gyro", "accel")
_HOLD_VALUE = ("rotor_command", "motor_command")
"""Channels that count as held between samples: not over long gaps."""
_LATE_S = 0.3
"""s that a channel may begin late, end early or not be there."""
_PART = 0.5
"""Share of the flight that a channel must cover to be used: below, the flight is worth more."""
_LOST = 0.2
"""Share of the time in the air that may be set apart without a warning."""
_AIRBORNE = 0.12
"""m above the lowest place of a flight from which on the vehicle is in the air."""


def absent(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report missing kinds of channels, and the effects that can't be seen without them."""
    findings = []
    missing = [name for name in IMU if name not in series]
    if missing:
        text = (
            f"{' and '.join(missing)}: absent or not usable; at the rate of the "
            "poses alone, fast causes (motor lag, delays, vibration) and faults of the IMU can't "
            "be seen: none does not exclude them"
        )
        findings.append(Finding("missing", "warning", flight, text, channel=missing[0]))
    if not set(DRIVES) & set(series):
        text = (
            "rotor_speed, rotor_command and motor_command: absent or not usable; thrust is "
            "taken from the motion, so causes in mass, thrust, propellers, motors and battery "
            "can't be seen: none does not exclude them"
        )
        findings.append(Finding("missing", "warning", flight, text, channel="rotor_speed"))
    return findings


def parts(
    flight: str, series: Mapping[str, Series], flown: Span, down: list[Span]
) -> tuple[list[str], list[Finding], list[Span]]:
    """Report channels that cover a part of the flight only; `flown`: its begin and end [s].

    Returns the channels to leave out, findings, and the spans that those kept do not cover.
    """
    out: list[str] = []
    findings: list[Finding] = []
    apart: list[Span] = []
    begin, end = flown
    air = _length([flown], down)
    for name in (*IMU, *DRIVES):
        if name not in series or air <= 0.0:
            continue
        t = series[name].t
        lost = [(begin, float(t[0])), (float(t[-1]), end)]
        if name in _HOLD_VALUE:
            lost += gap_spans(t)
        lost = [(b, e) for b, e in lost if e - b > _LATE_S and _length([(b, e)], down) > _LATE_S]
        missing = sum(_length([span], down) for span in lost)
        if not lost:
            continue
        share = 1.0 - missing / air
        text = (
            f"{name}: covers {t[0]:.1f} to {t[-1]:.1f} s, {100 * share:.0f} % of the "
            f"{air:.1f} s in the air; expected: the whole flight; "
        )
        if share < _PART:
            out.append(name)
            text += "left out"
        else:
            apart += lost
            text += "the rest is set apart"
        span = max(lost, key=lambda s: s[1] - s[0])
        findings.append(Finding("gap", "fault", flight, text, *span, name))
    return out, findings, apart


def share_set_apart(flight: str, position: Series, apart: list[Span]) -> list[Finding]:
    """Warn when much of the time in the air is not diagnosed."""
    t, z = position.t, position.values[:, 2]
    step = np.minimum(np.diff(t, append=t[-1]), _LATE_S)
    step[z <= np.percentile(z, 1.0) + _AIRBORNE] = 0.0
    air, lost = float(step.sum()), float(step[inside(t, apart)].sum())
    if lost <= _LOST * air:
        return []
    text = (
        f"{lost:.1f} of {air:.1f} s in the air are set apart: the verdict is about the rest alone"
    )
    return [Finding("set apart", "warning", flight, text)]


def _length(spans: list[Span], without: list[Span]) -> float:
    """Return the length of spans outside of others [s]."""
    total = 0.0
    for begin, end in merged(spans):
        total += end - begin
        total -= sum(max(0.0, min(e, end) - max(b, begin)) for b, e in merged(without))
    return total
