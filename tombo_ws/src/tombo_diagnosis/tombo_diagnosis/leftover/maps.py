"""Means of a leftover in cells of two quantities, and in slices of one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array

_FEWEST = 3
"""Blocks of time that a cell needs."""


@dataclass(frozen=True)
class Cells:
    """Means in the cells that have enough samples."""

    at: Array
    """(C, 2) mean place of the samples of each cell."""
    mean: Array
    """(C, 3)"""
    count: Array
    """(C)"""


@dataclass(frozen=True)
class Slices:
    """Means in slices that hold equally many samples."""

    at: Array
    """(B)"""
    mean: Array
    """(B, 3)"""
    half: Array
    """(B, 3) half width of the 95 % interval, samples taken as independent."""


def cells(place: Array, values: Array, across: int = 7) -> Cells:
    """Return means of values (N, 3) in squares of places (N, 2), `across` on the longer side."""
    low, high = place.min(axis=0), place.max(axis=0)
    side = max(float((high - low).max()) / across, 1e-9)
    index = np.floor((place - low) / side).astype(np.int64)
    _, which = np.unique(index, axis=0, return_inverse=True)
    which = which.reshape(-1)
    count = np.bincount(which)
    at = np.column_stack([np.bincount(which, p) for p in place.T]) / count[:, None]
    mean = np.column_stack([np.bincount(which, v) for v in values.T]) / count[:, None]
    kept = count >= _FEWEST
    return Cells(at[kept], mean[kept], count[kept].astype(np.float64))


def slices(x: Array, values: Array, number: int = 10) -> Slices:
    """Return the means of values (N, 3) in slices of x (N); NaN is left out of a mean."""
    order = np.array_split(np.argsort(x, kind="stable"), max(min(number, x.size // _FEWEST), 1))
    at = np.array([x[own].mean() for own in order])
    mean = np.array([_mean(values[own]) for own in order])
    spread = np.array([values[own].std(axis=0) / np.sqrt(max(own.size, 1)) for own in order])
    return Slices(at, mean, 1.96 * spread)


def _mean(values: Array) -> Array:
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
