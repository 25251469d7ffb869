"""The samples of one channel as such: not finite, out of order, held, frozen, at a limit."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Mask, Span, merged, runs, sample_interval

_RESET_S = 0.5
"""Stamps that go back by more are a clock that was set, not messages out of order."""
_LARGEST = 1e7
"""Larger numbers are not values of any channel."""
_HELD_SHARE = 0.3
"""Share of repeated values from which on a channel counts as held on a faster clock."""
_WRONG_POSE, _TIMES_NOISE = 0.01, 10.0
"""m, and noise deviations, beyond which a single pose is wrong; less does no harm."""
_SAMPLED = ("position", "attitude", "gyro", "accel", "rotor_speed")
"""Channels that measure something new each time; commands and supply may stay as they are."""
_LINE = 3e-4
"""How far off a straight line, against its rise, values are that still lie on it."""
_NOISY = 0.05
"""Usual distance of a measured value from the mean of its neighbours, over their difference."""
_SHORT_S, _MIN_LENGTH_S = 0.08, 0.4
"""Straight lines count from the first length on, and are reported from the second."""
_FROZEN_S = 0.1
_CLIPPED = 20
"""Samples that must read exactly the same extreme: a largest value is not a limit."""
_PART = 0.1
"""Share of the flight at its limit up to which the rest of a channel is used."""
_AROUND_S = 0.1
"""s set apart on both sides of a limit: what kernels reach."""
_COARSE = {"position": 0.003, "gyro": 0.03, "accel": 0.3}
"""Steps of values [unit of the channel] that make equal neighbours usual."""


def clean_series(flight: str, channel: str, series: Series) -> tuple[Series, list[Finding]]:
    """Return a channel with finite, rising stamps and no repeats, and its findings."""
    findings: list[Finding] = []

    def note(check: str, severity: str, text: str) -> None:
        findings.append(Finding(check, severity, flight, f"{channel}: {text}", channel=channel))

    series = _ordered(series, note)
    with np.errstate(invalid="ignore"):
        finite = np.asarray((np.abs(series.values) < _LARGEST).all(axis=1))
    lost = int(finite.size - np.count_nonzero(finite))
    if lost:
        text = f"{lost} of {finite.size} samples are no numbers, or no possible ones"
        severity = (
            "fault" if lost == finite.size else "warning" if lost > 0.01 * finite.size else "info"
        )
        note("missing", severity, text)
        series = series.at(finite)
    share, repeats = _held_share(series)
    # rounded values repeat, too: they were measured
    if share > _HELD_SHARE and channel in _SAMPLED and not _is_coarse(channel, series):
        text = (
            f"{100 * share:.0f} % of the samples repeat the one before: a slower channel held "
            f"on a faster clock ({1.0 / max(sample_interval(series.t), 1e-9):.0f} Hz); the "
            "repeats are left out, the stamps of the rest may be late by up to one step"
        )
        note("duplicate", "warning", text)
        series = series.at(~repeats)
    return series, findings


def without_wrong_poses(flight: str, position: Series) -> tuple[Series, list[Finding]]:
    """Return positions without single wrong ones, and how many there were.

    A single one is wrong if the two before and the two after it lie on one smooth path, far from
    it. What hits the vehicle bends its path instead.
    """
    p, t = position.values, position.t
    if len(p) < 20:
        return position, []
    path = (4.0 * (p[1:-3] + p[3:-1]) - p[:-4] - p[4:]) / 6.0  # a cubic through the four
    off = np.linalg.norm(p[2:-2] - path, axis=1)
    before, across, after = p[1:-3] - p[:-4], p[3:-1] - p[1:-3], p[4:] - p[3:-1]
    rough = [np.linalg.norm(x, axis=1) for x in (after - before, across - before - after)]
    limit = max(_WRONG_POSE, _TIMES_NOISE * float(np.median(off)))
    even = t[4:] - t[:-4] < 4.6 * sample_interval(t)
    wrong = np.zeros(len(p), np.bool_)
    wrong[2:-2] = (off > limit) & (off > np.maximum(*rough)) & even
    if not wrong.any():
        return position, []
    count, farthest = int(wrong.sum()), float(off[wrong[2:-2]].max())
    text = (
        f"position: single poses up to {100 * farthest:.0f} cm beside the path before and after "
        f"them: {count}, left out"
    )
    severity = "warning" if count > 0.01 * wrong.size else "info"
    finding = Finding("jump", severity, flight, text, channel="position")
    return position.at(~wrong), [finding]


def _ordered(series: Series, note: Callable[[str, str, str], None]) -> Series:
    """Return a channel with finite, rising stamps; `note` is told check, severity and text."""
    size = min(series.t.size, len(series.values))
    usable = np.isfinite(series.t[:size])
    if not usable.all() or size < series.t.size:
        note("stamps", "warning", f"{int(size - usable.sum())} stamps are no numbers")
    series = series.at(np.flatnonzero(usable))
    steps = -np.diff(series.t)
    set_back = np.flatnonzero(steps > _RESET_S) + 1
    if set_back.size:
        edges = np.array([0, *set_back, series.t.size])
        longest = int(np.argmax(np.diff(edges)))
        begin, end = int(edges[longest]), int(edges[longest + 1])
        text = (
            f"stamps jump back by {steps.max():.3g} s ({set_back.size} times): the clock was set, "
            f"or logs were joined; only the longest part is used, {end - begin} of "
            f"{series.t.size} samples"
        )
        note("stamps", "fault", text)
        series = series.at(slice(begin, end))
    late = int(np.count_nonzero(np.diff(series.t) < 0.0))
    if late:
        note("stamps", "warning", f"{late} stamps go backwards; expected: rising; sorted")
        series = series.at(np.argsort(series.t, kind="stable"))
    twice = np.concatenate([[False], np.diff(series.t) <= 0.0])
    if twice.any():
        count = int(twice.sum())
        severity = "warning" if count > 0.01 * twice.size else "info"
        note("duplicate", severity, f"{count} stamps are there twice; the first one counts")
        series = series.at(~twice)
    return series


def _held_share(series: Series) -> tuple[float, Mask]:
    if len(series.values) < 10:
        return 0.0, np.zeros(len(series.values), np.bool_)
    same = np.zeros(len(series.values), np.bool_)
    same[1:] = (np.diff(series.values, axis=0) == 0.0).all(axis=1)
    # held values come again and again; a vehicle at rest, or one that was lost, in long runs
    lengths = np.array([end - begin for begin, end in runs(same)])
    short = lengths[lengths <= 20]
    moved = np.count_nonzero(~same)
    if short.size < 0.2 * moved:
        return 0.0, same
    return float(short.sum() / max(same.size, 1)), same


def nothing_left(series: Series) -> bool:
    """Return whether a channel is too short to be used."""
    return series.t.size < 2 or not math.isfinite(float(series.t[-1] - series.t[0]))


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


def limit_spans(
    flight: str, name: str, series: Series, flying: Mask
) -> tuple[list[Span] | None, list[Finding]]:
    """Return the spans around samples at a limit of the sensor's range, and a finding of them.

    None instead of spans: the channel is there for too much of the flight to be used.
    """
    at = np.zeros(len(series.values), np.bool_)
    limits = []
    for column in series.values.T:
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
        return [], []
    rest = "those spans are set apart" if share < _PART else "left out"
    text = (
        f"{name}: reads exactly its limit of {min(limits):.3g} in {100 * share:.1f} % of the "
        f"flight: saturated; {rest}"
    )
    findings = [Finding("saturation", "fault", flight, text, channel=name)]
    if share >= _PART:
        return None, findings
    t = series.t
    spans = [(float(t[b]) - _AROUND_S, float(t[e - 1]) + _AROUND_S) for b, e in runs(at)]
    return merged(spans, apart=_AROUND_S), findings


def _is_coarse(name: str, series: Series) -> bool:
    """Return whether all values lie on steps so wide that neighbours are often equal."""
    if name not in _COARSE or series.t.size < 100:
        return False
    steps = []
    for column in series.values.T:
        levels = np.unique(column)
        if levels.size < 2:
            continue
        gaps = np.diff(levels)
        step = float(np.percentile(gaps, 10.0))
        ratio = gaps / step
        off = np.abs(ratio - np.round(ratio)).max()
        if levels.size > 0.8 * column.size or off > 0.05 * np.maximum(ratio, 1.0).max():
            return False
        steps.append(step)
    return max(steps, default=0.0) >= _COARSE[name]
