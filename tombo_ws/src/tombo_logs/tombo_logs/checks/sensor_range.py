"""Sensors at the end of their range, and values that are rounded coarsely."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Mask, Span, merged, runs

_CLIPPED = 20
"""Samples that must read exactly the same extreme: a largest value is not a limit."""
_PART = 0.1
"""Share of the flight at its limit up to which the rest of a channel is used."""
_AROUND_S = 0.1
"""s set apart on both sides of a limit: what kernels reach."""
_COARSE = {"position": 0.003, "gyro": 0.03, "accel": 0.3}
"""Steps of values [unit of the channel] that make equal neighbours usual."""


def clipped(flight: str, name: str, series: Series, flying: Mask) -> tuple[Mask, list[Finding]]:
    """Return the samples at a limit of the sensor's range, and a finding if there are some."""
    values = series.values
    at = np.zeros(len(values), np.bool_)
    limits = []
    for column in values.T:
        for sign in (1.0, -1.0):
            top = float((sign * column).max())
            there = sign * column >= top - 1e-9 * max(abs(top), 1e-9)
            # at a limit, readings stay: pairs of samples, not single ones
            paired = sum(e - b for b, e in runs(there) if e - b > 1)
            below = float((sign * column)[~there].max(initial=-np.inf))
            next_level = int(np.count_nonzero(sign * column >= below)) - int(there.sum())
            # rounded values come again at every level, not only at the last one
            if top > 0.0 and paired >= max(_CLIPPED, 3 * next_level):
                at |= there
                limits.append(top)
    share = float(at[flying].mean()) if flying.any() else 0.0
    if not limits or share == 0.0:
        return np.zeros_like(at), []
    rest = "those spans are set apart" if share < _PART else "left out"
    text = (
        f"{name}: reads exactly its limit of {min(limits):.3g} in {100 * share:.1f} % of the "
        f"flight: saturated; {rest}"
    )
    return at, [Finding("saturation", "fault", flight, text, channel=name)]


def spans_at_limit(t: Array, at: Mask) -> list[Span]:
    """Return the spans around samples at a limit."""
    spans = [(float(t[b]) - _AROUND_S, float(t[e - 1]) + _AROUND_S) for b, e in runs(at)]
    return merged(spans, apart=_AROUND_S)


def is_mostly_clipped(at: Mask, flying: Mask) -> bool:
    """Return whether a channel is at its limit for too much of the flight to be used."""
    return bool(flying.any()) and float(at[flying].mean()) >= _PART


def value_step(values: Array) -> float:
    """Return the step on which all values lie, 0 where there is none."""
    steps = []
    for column in values.T:
        levels = np.unique(column)
        if levels.size < 2:
            continue
        if levels.size > 0.8 * column.size:
            return 0.0
        gaps = np.diff(levels)
        step = float(np.percentile(gaps, 10.0))
        ratio = gaps / step
        if np.abs(ratio - np.round(ratio)).max() > 0.05 * np.maximum(ratio, 1.0).max():
            return 0.0
        steps.append(step)
    return max(steps, default=0.0)


def is_coarse(name: str, series: Series) -> bool:
    """Return whether values are rounded so coarsely that neighbours are often equal."""
    known = name in _COARSE and series.t.size >= 100
    return known and value_step(series.values) >= _COARSE[name]
