"""Stamps and values as such: not finite, out of order, twice, held."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight import Finding, Series
from tombo_logs.checks.sensor_range import is_coarse
from tombo_logs.checks.spans import Mask, runs, sample_interval

_RESET_S = 0.5
"""Stamps that go back by more are a clock that was set, not messages out of order."""
_LARGEST = 1e7
"""Beyond it, no value of any channel is one."""
_HELD_SHARE = 0.3
"""Share of repeated values from which on a channel counts as held on a faster clock."""

_WRONG_POSE, _TIMES_NOISE = 0.01, 10.0
"""m, and noise deviations, beyond which a single pose is wrong; less does no harm."""
_SAMPLED = ("position", "attitude", "gyro", "accel", "rotor_speed")
"""Channels that measure something new each time; commands and supply may stay as they are."""


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
        series = _part(series, finite)
    share, repeats = _held_share(series)
    # rounded values repeat, too: they were measured
    if share > _HELD_SHARE and channel in _SAMPLED and not is_coarse(channel, series):
        text = (
            f"{100 * share:.0f} % of the samples repeat the one before: a slower channel held "
            f"on a faster clock ({1.0 / max(sample_interval(series.t), 1e-9):.0f} Hz); the "
            "repeats are left out, the stamps of the rest may be late by up to one step"
        )
        note("duplicate", "warning", text)
        series = _part(series, ~repeats)
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
    return _part(position, ~wrong), [finding]


def _part(series: Series, rows: NDArray[Any] | slice) -> Series:
    arrival = None if series.arrival is None else series.arrival[rows]
    return Series(series.t[rows], series.values[rows], arrival)


def _ordered(series: Series, note: Callable[[str, str, str], None]) -> Series:
    """Return a channel with finite, rising stamps; `note` is told check, severity and text."""
    size = min(series.t.size, len(series.values))
    usable = np.isfinite(series.t[:size])
    if not usable.all() or size < series.t.size:
        note("stamps", "warning", f"{int(size - usable.sum())} stamps are no numbers")
    series = _part(series, np.flatnonzero(usable))
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
        series = _part(series, slice(begin, end))
    late = int(np.count_nonzero(np.diff(series.t) < 0.0))
    if late:
        note("stamps", "warning", f"{late} stamps go backwards; expected: rising; sorted")
        series = _part(series, np.argsort(series.t, kind="stable"))
    twice = np.concatenate([[False], np.diff(series.t) <= 0.0])
    if twice.any():
        count = int(twice.sum())
        severity = "warning" if count > 0.01 * twice.size else "info"
        note("duplicate", severity, f"{count} stamps are there twice; the first one counts")
        series = _part(series, ~twice)
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
