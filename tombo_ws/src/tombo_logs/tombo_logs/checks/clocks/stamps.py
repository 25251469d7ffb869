"""The stamps of a channel: their unit, their gaps, and whether they are times of capture."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Span, sample_interval

_FASTEST_S, _SLOWEST_S = 2e-4, 0.5
"""s between poses: no motion capture is faster than 5 kHz, and below 2 Hz nothing is diagnosed."""
_ALIKE = 100.0
"""Channels of one flight last equally long up to this factor; another unit makes it 1000."""
_UNIT = "is it ms, us or ns, declared as s?"
_LEAST = 10
_JITTER_S = 0.0015
_BLOCK = 60
"""Samples over which a clock's drift is negligible."""
_LEAST_GAP_S = 0.05
LONG_S = 0.3
"""From this gap on the detector no longer coasts, and a warning says so."""
_SHARE = 0.05
_MULTIPLE, _MOSTLY = 0.2, 0.8
"""Part of a step by which a gap may differ from a whole number of steps, and share of the gaps
that do not: else stamps jitter, and no sample is lost."""


def check_pose_rate(flight: str, series: Mapping[str, Series]) -> None:
    """Refuse poses whose stamps can't be seconds.

    Raises:
        RefusedLog: one pose comes too soon or too late after the other.
    """
    for name in sorted({"attitude", "position"} & series.keys(), reverse=True):
        t = series[name].t
        step = sample_interval(t)
        if t.size >= _LEAST and not _FASTEST_S <= step <= _SLOWEST_S:
            text = (
                f"{name}: its stamps are {step:.3g} s apart; expected: {_FASTEST_S:g} to "
                f"{_SLOWEST_S:g} s; {_UNIT}"
            )
            raise RefusedLog(flight, name, text)


def other_units(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels whose stamps are in another unit than the poses'; to be left out."""
    length = max(float(np.ptp(series["position"].t)), 1e-9)
    ratios = {name: float(np.ptp(s.t)) / length for name, s in series.items()}
    wrong = [name for name, ratio in ratios.items() if not 1.0 / _ALIKE < ratio < _ALIKE]
    return [_left_out("unit", flight, name, series, _UNIT) for name in wrong]


def no_common_time(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels of which nothing is from the time of the poses; to be left out."""
    begin, end = series["position"].t[[0, -1]]
    apart = [n for n, s in series.items() if s.t[-1] <= begin or end <= s.t[0]]
    return [_left_out("stamps", flight, n, series, "no common time.") for n in apart]


def _left_out(
    check: str, flight: str, name: str, series: Mapping[str, Series], why: str
) -> Finding:
    (first, last), (begin, end) = (series[n].t[[0, -1]] for n in (name, "position"))
    text = (
        f"{name}: its stamps run from {first:.6g} to {last:.6g} s, those of the poses "
        f"from {begin:.6g} to {end:.6g} s; {why} Left out"
    )
    return Finding(check, "fault", flight, text, channel=name)


def jitter(t: Array) -> float:
    """Return how far stamps lie off an even grid, as standard deviation [s]."""
    step = sample_interval(t)
    if t.size < 12 or step == 0.0:
        return 0.0
    off = []
    for begin in range(0, t.size - 11, _BLOCK):
        block = t[begin : begin + _BLOCK]
        if block.size < 12:
            continue
        index = np.concatenate([[0.0], np.cumsum(np.maximum(np.round(np.diff(block) / step), 1))])
        line = np.polyfit(index, block - block[0], 1)
        off.append(block - block[0] - np.polyval(line, index))
    if not off:
        return 0.0
    spread = np.concatenate(off)
    # twice the inner half: a few samples that came late count for little
    return float(np.subtract(*np.percentile(spread, [84.0, 16.0])) / 2.0)


def arrival_stamps(flight: str, t: Array, arrival: Array | None) -> list[Finding]:
    """Return whether the motion capture's stamps look like times of arrival."""
    spread, step = jitter(t), sample_interval(t)
    if arrival is not None and arrival.size == t.size >= 12:
        late = arrival - t
        late = late[np.isfinite(late)]
        if late.size and np.abs(late).max() < 2e-4:
            text = (
                f"position: stamps are the times of recording to within "
                f"{1e3 * np.abs(late).max():.2g} ms; expected: times of capture, which are "
                "earlier by the latency of the motion capture"
            )
            return [Finding("stamps", "info", flight, text, channel="position")]
    if spread <= max(_JITTER_S, 0.03 * step):
        return []
    text = (
        f"position: stamps jitter by {1e3 * spread:.1f} ms about {1.0 / step:.0f} Hz, as times of "
        "arrival do; expected: times of capture, evenly spaced"
    )
    return [Finding("stamps", "warning", flight, text, channel="position")]


def gap_spans(t: Array) -> list[Span]:
    """Return where stamps are further apart than three usual steps, and 50 ms."""
    limit = max(_LEAST_GAP_S, 3.5 * sample_interval(t))
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
