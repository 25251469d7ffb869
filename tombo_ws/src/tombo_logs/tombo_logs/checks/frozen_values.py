"""Values that were not measured: frozen, or drawn as a straight line through a gap."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Span, runs, sample_interval

_LINE = 3e-4
"""How far off a straight line, against its rise, values are that still lie on it."""
_NOISY = 0.05
"""Usual distance of a measured value from the mean of its neighbours, over their difference."""
_SHORT_S, _MIN_LENGTH_S = 0.08, 0.4
"""Straight lines count from the first length on, and are reported from the second."""
_FROZEN_S = 0.1


def frozen_spans(t: Array, values: Array) -> list[Span]:
    """Return where all components stand still though the channel moves before and after."""
    if t.size < 8:
        return []
    same = (np.diff(values, axis=0) == 0.0).all(axis=1)
    steps = np.linalg.norm(np.diff(values, axis=0), axis=1)
    moving = steps[steps > 0.0]
    if not moving.size:
        return []
    usual, least = float(np.median(moving)), max(_FROZEN_S, 4.0 * sample_interval(t))
    spans = []
    for begin, end in runs(same):
        jump = steps[end] if end < steps.size else 0.0
        # a vehicle at rest in made-up data stands still, too, but starts softly
        if t[end] - t[begin] >= least and jump > 3.0 * usual:
            spans.append((float(t[begin]), float(t[end])))
    return spans


def interpolated_spans(t: Array, values: Array) -> list[Span]:
    """Return where all components lie on one straight line that rises: interpolated."""
    if t.size < 8:
        return []
    before, after = np.diff(t)[:-1, None], np.diff(t)[1:, None]
    rise = values[2:] - values[:-2]
    middle = values[:-2] + rise * (before / (before + after))
    scale = np.maximum(np.abs(values).max(axis=0), 1e-12)
    limit = _LINE * np.abs(rise) + 1e-8 * scale
    straight = (np.abs(values[1:-1] - middle) <= limit).all(axis=1)
    rising = (np.abs(rise) > 1e-6 * scale).any(axis=1)
    with np.errstate(invalid="ignore"):
        off = np.abs(values[1:-1] - middle).sum(axis=1)
        off /= np.maximum(np.abs(rise).sum(axis=1), 1e-300)
    curved = off[~straight]
    if not curved.size or np.median(curved) < _NOISY:
        return []  # made without noise, not measured
    least = max(_SHORT_S, 4.0 * sample_interval(t))
    lines = []
    for begin, end in runs(straight):
        # sample i of `straight` is the middle one of i, i + 1, i + 2
        if t[end + 1] - t[begin] >= least and rising[begin:end].any():
            lines.append((float(t[begin]), float(t[end + 1])))
    return lines


def unmeasured(flight: str, channel: str, series: Series) -> list[Finding]:
    """Report where a channel was not measured: it is frozen, or a straight line for long."""
    t = series.t
    texts = {
        (begin, end): f"the same value for {end - begin:.2f} s, then a jump; expected: a channel "
        "that moves"
        for begin, end in frozen_spans(t, series.values)
    }
    for begin, end in interpolated_spans(t, series.values):
        if end - begin >= _MIN_LENGTH_S:
            last = end >= t[-1] - 2.0 * sample_interval(t)
            why = " to the end: extrapolated" if last else ": interpolated"
            texts[begin, end] = f"a straight line over {end - begin:.2f} s{why}, not measured"
    return [
        Finding("frozen", "fault", flight, f"{channel}: {text}; set apart", *span, channel)
        for span, text in texts.items()
    ]
