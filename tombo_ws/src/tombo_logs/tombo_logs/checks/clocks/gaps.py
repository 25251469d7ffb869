"""Where samples are missing."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Span, sample_interval

_LEAST_S = 0.05
LONG_S = 0.3
"""From this gap on the detector no longer coasts, and a warning says so."""
_SHARE = 0.05
_MULTIPLE, _MOSTLY = 0.2, 0.8
"""Part of a step by which a gap may differ from a whole number of steps, and share of the gaps
that do not: else stamps jitter, and no sample is lost."""


def gap_spans(t: Array) -> list[Span]:
    """Return where stamps are further apart than three usual steps, and 50 ms."""
    limit = max(_LEAST_S, 3.5 * sample_interval(t))
    rows = np.flatnonzero(np.diff(t) > limit)
    return [(float(t[i]), float(t[i + 1])) for i in rows]


def gaps(flight: str, channel: str, t: Array) -> list[Finding]:
    """Report gaps of a channel."""
    if t.size < 2:
        return []
    findings = []
    spans = gap_spans(t)
    if spans:
        lengths = np.array([e - b for b, e in spans])
        share = float(lengths.sum() / max(t[-1] - t[0], 1e-9))
        longest = spans[int(np.argmax(lengths))]
        severity = "warning" if lengths.max() > LONG_S or share > _SHARE else "info"
        message = (
            f"{channel}: {len(spans)} gaps, {100 * share:.1f} % of the time, the longest "
            f"{lengths.max():.2f} s at {longest[0]:.2f} s"
        )
        findings.append(Finding("gap", severity, flight, message, *longest, channel))
    lost = lost_share(t)
    if lost > _SHARE:
        text = f"{channel}: {100 * lost:.0f} % of the samples are lost, one or a few at a time"
        findings.append(Finding("gap", "warning", flight, text, channel=channel))
    return findings


def lost_share(t: Array) -> float:
    """Return the share of samples that are lost one by one, of an even clock; else 0."""
    step = sample_interval(t)
    if step <= 0.0:
        return 0.0
    steps = np.diff(t) / step
    long = steps[(steps > 1.5) & (steps < 20.0)]
    even = np.abs(steps - np.round(steps)) < _MULTIPLE
    if not long.size or np.mean(even) < _MOSTLY:
        return 0.0
    lost = float(np.sum(np.round(long) - 1.0))
    return lost / (lost + t.size)
