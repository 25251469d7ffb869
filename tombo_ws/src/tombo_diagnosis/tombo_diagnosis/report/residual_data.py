"""Data of the plots of a diagnosis: which channels, against which drivers, thinned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import Diagnosis, Residual
from tombo_dynamics.arrays import Array
from tombo_flight.report.panels import envelope

BLOCK_S: Final = 1.0
"""Samples of one such block count as one: residuals are autocorrelated."""
_MIN_SHARE: Final = 0.15
"""A driver that explains less of the residual than this is not shown."""
SLICES: Final = 12
"""Of a driver, with equally many samples each."""
FAR_S: Final = 1e5
"""Times beyond this are not counted from the start of a flight; they are shown from its start."""


@dataclass(frozen=True)
class Bins:
    """Mean of a residual in slices of a driver, with its 95 % interval."""

    x: Array
    mean: Array
    half: Array
    """(B,) half width of the interval; NaN with a single block."""


@dataclass(frozen=True)
class Pair:
    """A channel's residual with one quantity that could drive it, all flights together."""

    channel: str
    unit: str
    driver: str
    x: Array
    before: Array
    after: Array
    block: NDArray[np.int64]
    """(N,) which second of which flight a sample is from."""
    sigma: float
    share: float
    """Share (0 to 1) of what drives the residual that follows this driver."""

    @property
    def series(self) -> list[tuple[str, Array]]:
        """The residual before and, where it differs, after, by these names."""
        same = np.array_equal(self.before, self.after)
        return [("before", self.before)] + ([] if same else [("after", self.after)])

    @property
    def span(self) -> tuple[float, float]:
        """Ends of an axis that holds all but the rarest values of the driver."""
        low, high = (float(v) for v in np.quantile(self.x, (0.002, 0.998)))
        margin = 0.03 * (high - low) or 1.0
        return low - margin, high + margin

    @property
    def limit(self) -> float:
        """Symmetric limit of an axis for the residuals."""
        return reach([self.before, self.after], 2.5 * self.sigma)


def rms(values: Array) -> float:
    """Return the root of the mean square of finite values; NaN of none."""
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else math.nan


def noise_of(residuals: Sequence[Residual]) -> float:
    """Return the noise that is usual in these residuals; NaN if none is known."""
    known = [r.sigma for r in residuals if math.isfinite(r.sigma)]
    return float(np.median(known)) if known else math.nan


def corrected(residuals: Sequence[Residual]) -> bool:
    """Return whether the model was extended at all: after differs from before."""
    return any(not np.array_equal(r.before, r.after, equal_nan=True) for r in residuals)


def by_channel(residuals: Sequence[Residual]) -> dict[str, list[Residual]]:
    """Return the residuals of each channel, in the order of the gain.

    Without an extension: in the order of the residual over the noise.
    """
    groups: dict[str, list[Residual]] = {}
    for residual in residuals:
        if np.isfinite(residual.before).any():
            groups.setdefault(residual.channel, []).append(residual)
    return dict(sorted(groups.items(), key=lambda item: -_excess(item[1])))


def _excess(residuals: Sequence[Residual]) -> float:
    """Return removed (or, without extension, present) power over the noise's."""
    extended = corrected(residuals)
    total = 0.0
    for r in residuals:
        sigma = r.sigma if r.sigma > 0.0 and math.isfinite(r.sigma) else rms(r.after)
        left = rms(r.after) if extended else 0.0
        power = (rms(r.before) ** 2 - left**2) / sigma**2 if sigma else 0.0
        total += power if math.isfinite(power) else 0.0
    return total


def pairs(diagnosis: Diagnosis, most: int = 4) -> list[Pair]:
    """Return the pictures that show the cause best: channels and what drives them.

    For each channel the driver that its correction (before minus after) follows, the channels
    with the largest gain first. Without a correction the residual itself counts.
    """
    groups = by_channel(diagnosis.residuals)
    extended = corrected(diagnosis.residuals)
    ranked: list[tuple[float, Pair]] = []
    for residuals in groups.values():
        weight = _excess(residuals)
        names = dict.fromkeys(name for r in residuals for name in r.drivers)
        candidates = [p for name in names if (p := _pair(residuals, name, extended)) is not None]
        candidates.sort(key=lambda p: -p.share)
        ranked += [(weight * p.share / (3.0**i), p) for i, p in enumerate(candidates[:2])]
    ranked.sort(key=lambda item: -item[0])
    least = 0.01 * ranked[0][0] if ranked else 0.0
    clear = [p for value, p in ranked if value > least and p.share >= _MIN_SHARE]
    return (clear or [p for _, p in ranked[:1]])[:most]


def _pair(residuals: Sequence[Residual], driver: str, extended: bool) -> Pair | None:
    xs, befores, afters, blocks = [], [], [], []
    first = 0
    for r in residuals:
        if driver not in r.drivers or not len(r.t):
            continue
        x = np.asarray(r.drivers[driver], dtype=float)
        good = np.isfinite(x) & np.isfinite(r.before) & np.isfinite(r.after) & np.isfinite(r.t)
        block = np.floor((r.t[good] - r.t[0]) / BLOCK_S).astype(np.int64) + first
        first = int(block.max(initial=first)) + 1
        xs.append(x[good])
        befores.append(r.before[good])
        afters.append(r.after[good])
        blocks.append(block)
    x = np.concatenate(xs) if xs else np.zeros(0)
    if x.size < 8 or np.ptp(x) <= 1e-12 * max(1.0, float(np.abs(x).max())):
        return None
    before, after = np.concatenate(befores), np.concatenate(afters)
    share = explained(x, before - after if extended else before)
    block, sigma = np.concatenate(blocks), noise_of(residuals)
    channel, unit = residuals[0].channel, residuals[0].unit
    return Pair(channel, unit, driver, x, before, after, block, sigma, share)


def explained(x: Array, y: Array) -> float:
    """Return the share of the mean square of `y` that its means in slices of `x` explain."""
    total = float(np.mean(y**2))
    if total <= 0.0:
        return 0.0
    which = _slices(x, SLICES)
    count = np.bincount(which)
    sums = np.bincount(which, weights=y)
    filled = count > 0
    return float(np.sum(sums[filled] ** 2 / count[filled]) / y.size / total)


def binned(x: Array, y: Array, block: NDArray[np.int64], slices: int = SLICES) -> Bins:
    """Return the mean of `y` in slices of `x` that hold equally many samples.

    The interval comes from the spread of the means of blocks of time, not of samples.
    """
    which = _slices(x, slices)
    centre, mean, half = [], [], []
    for k in range(slices):
        here = which == k
        if not here.any():
            continue
        _, inverse = np.unique(block[here], return_inverse=True)
        size = np.bincount(inverse)
        blocks = np.bincount(inverse, weights=y[here]) / size
        value = float(y[here].mean())
        centre.append(float(x[here].mean()))
        mean.append(value)
        half.append(_half(blocks, size, value))
    return Bins(np.array(centre), np.array(mean), np.array(half))


def _half(blocks: Array, size: NDArray[np.int64], mean: float) -> float:
    """Return half the 95 % interval of a mean from those of its blocks, weighted by size."""
    n = len(blocks)
    if n < 2:
        return math.nan
    weight = size / size.sum()
    spread = math.sqrt(float(np.sum(weight**2 * (blocks - mean) ** 2)) * n / (n - 1))
    return (1.96 + 2.4 / (n - 1)) * spread  # close to Student's factor


def _slices(x: Array, count: int) -> NDArray[np.int64]:
    edges = np.quantile(x, np.linspace(0.0, 1.0, count + 1)[1:-1])
    return np.searchsorted(edges, x, side="right")


def thinned(x: Array, y: Array, most: int) -> tuple[Array, Array]:
    """Return at most `most` points, spread evenly over the samples."""
    index = np.unique(np.linspace(0, len(x) - 1, min(most, len(x))).astype(int))
    return x[index], y[index]


def runs(t: Array, y: Array, buckets: int) -> list[tuple[Array, Array]]:
    """Return the line in pieces, broken at gaps, thinned so that the extremes stay."""
    finite = np.flatnonzero(np.isfinite(t) & np.isfinite(y))
    if not finite.size:
        return []
    t, y = t[finite], y[finite]
    steps = np.diff(t)
    gap = 5.0 * float(np.median(steps)) if steps.size else math.inf
    cuts = np.flatnonzero((steps > gap) | (steps <= 0.0)) + 1
    total = len(t)
    pieces = zip(np.split(t, cuts), np.split(y, cuts), strict=True)
    return [envelope(a, b, max(2, buckets * len(a) // total)) for a, b in pieces]


def reach(values: Sequence[Array], least: float = 0.0) -> float:
    """Return a symmetric limit of an axis that holds all but the rarest of the values."""
    finite = [np.abs(v[np.isfinite(v)]) for v in values]
    peaks = [float(np.quantile(v, 0.998)) for v in finite if v.size]
    floor = least if math.isfinite(least) else 0.0
    return 1.12 * max([*peaks, floor, 1e-9])


def zero_s(diagnosis: Diagnosis, flight: str) -> float:
    """Return what instant of the flight's clock is shown as 0 s; its own zero if that is near."""
    starts = [float(r.t[0]) for r in diagnosis.residuals if r.flight == flight and len(r.t)]
    starts += [f.start_s for f in diagnosis.prechecks if f.flight == flight]
    finite = [s for s in starts if math.isfinite(s)]
    return math.floor(min(finite)) if finite and min(finite) > FAR_S else 0.0


def clearest(residuals: Sequence[Residual]) -> Residual:
    """Return the flight with the largest correction of a channel, else the largest residual."""
    return max(residuals, key=lambda r: _excess([r]) if corrected([r]) else rms(r.before))


def spans(finding: Finding) -> bool:
    """Return whether a finding is a fault of a stretch of a flight, or a doubt about it."""
    known = math.isfinite(finding.start_s) and math.isfinite(finding.end_s)
    return known and finding.severity != "info"
