"""Data of the plots of a diagnosis: which channels, against which drivers, thinned."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import Residual
from tombo_dynamics.arrays import Array

BLOCK_S: Final = 1.0
"""Samples of one such block count as one: residuals are autocorrelated."""
SLICES: Final = 12
"""Number of slices of a driver, with equally many samples each."""


@dataclass(frozen=True)
class Pair:
    """A channel's residual with one quantity that could drive it, all flights together."""

    channel: str
    unit: str
    driver: str
    samples: pd.DataFrame
    """x: of the driver; before, after: of the residual; block: which second of which flight."""
    sigma: float
    share: float
    """Share (0 to 1) of what drives the residual that follows this driver."""


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


def best_pair(groups: Mapping[str, Sequence[Residual]]) -> Pair | None:
    """Return the channel and the driver that show the cause best; None: no driver is known.

    The driver that the correction of a channel (before minus after) follows, weighted by the gain
    of the channel. Without a correction the residual itself counts.
    """
    ranked: list[tuple[float, Pair]] = []
    for residuals in groups.values():
        names = dict.fromkeys(name for r in residuals for name in r.drivers)
        pairs = [pair for name in names if (pair := _pair(residuals, name)) is not None]
        ranked += [(_excess(residuals) * pair.share, pair) for pair in pairs]
    return max(ranked, key=lambda item: item[0])[1] if ranked else None


def _pair(residuals: Sequence[Residual], driver: str) -> Pair | None:
    parts = [
        pd.DataFrame({
            "x": np.asarray(r.drivers[driver], dtype=float), "before": r.before, "after": r.after,
            "flight": k, "second": np.floor((r.t - r.t[0]) / BLOCK_S),
        })
        for k, r in enumerate(residuals)
        if driver in r.drivers and len(r.t)
    ]  # fmt: skip
    every = pd.concat(parts).replace([np.inf, -np.inf], np.nan).dropna()
    x = every.x.to_numpy()
    if x.size < 8 or np.ptp(x) <= 1e-12 * max(1.0, float(np.abs(x).max())):
        return None
    every["block"] = every.groupby(["flight", "second"]).ngroup()
    drives = every.before - every.after if corrected(residuals) else every.before
    share = explained(x, drives.to_numpy())
    first = residuals[0]
    return Pair(first.channel, first.unit, driver, every, noise_of(residuals), share)


def explained(x: Array, y: Array) -> float:
    """Return the share of the mean square of `y` that its means in slices of `x` explain."""
    total = float(np.mean(y**2))
    means = pd.Series(y).groupby(_slices(x, SLICES)).transform("mean")
    return float(np.mean(means**2)) / total if total > 0.0 else 0.0


def binned(x: Array, y: Array, block: NDArray[np.int64], slices: int = SLICES) -> pd.DataFrame:
    """Return `x`, `mean` of `y` and `half` in slices of `x` that hold equally many samples.

    `half` is half of the 95 % interval, NaN with a single block. It comes from the spread of the
    means of blocks of time, not of samples.
    """
    samples = pd.DataFrame({"x": x, "mean": y, "slice": _slices(x, slices), "block": block})
    blocks = samples.groupby(["slice", "block"])["mean"].agg(["mean", "size"])
    bins = samples.groupby("slice")[["x", "mean"]].mean()
    bins["half"] = [_half(part) for _, part in blocks.groupby("slice")]
    return bins


def _half(blocks: pd.DataFrame) -> float:
    """Return half the 95 % interval of a mean from those of its blocks, weighted by size."""
    n = len(blocks)
    if n < 2:
        return math.nan
    weight = blocks["size"] / blocks["size"].sum()
    off = blocks["mean"] - (weight * blocks["mean"]).sum()
    spread = math.sqrt(float(np.sum(weight**2 * off**2)) * n / (n - 1))
    return (1.96 + 2.4 / (n - 1)) * spread  # close to Student's factor


def _slices(x: Array, count: int) -> NDArray[np.int64]:
    edges = np.quantile(x, np.linspace(0.0, 1.0, count + 1)[1:-1])
    return np.searchsorted(edges, x, side="right")


def broken_at_gaps(t: Array, y: Array) -> Array:
    """Return a line (N,) that ends before a gap: NaN where the next sample comes late."""
    steps = np.diff(t, append=t[-1:])
    usual = float(np.nanmedian(steps)) if t.size > 1 else math.inf
    return np.where(np.abs(steps) > 5.0 * usual, math.nan, y)


def reach(values: Sequence[Array], sigma: float) -> float:
    """Return a symmetric limit of an axis that holds the noise and all but the rarest values."""
    finite = [np.abs(v[np.isfinite(v)]) for v in values]
    peaks = [float(np.quantile(v, 0.998)) for v in finite if v.size]
    return 1.12 * max([*peaks, float(np.nan_to_num(2.5 * sigma)), 1e-9])


def clearest(residuals: Sequence[Residual]) -> Residual:
    """Return the flight with the largest correction of a channel, else the largest residual."""
    return max(residuals, key=lambda r: _excess([r]) if corrected([r]) else rms(r.before))


def spans(finding: Finding) -> bool:
    """Return whether a finding is a fault of a stretch of a flight, or a doubt about it."""
    known = math.isfinite(finding.start_s) and math.isfinite(finding.end_s)
    return known and finding.severity != "info"
