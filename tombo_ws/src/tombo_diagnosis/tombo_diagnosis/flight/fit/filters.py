"""One zero-phase filter for both sides of an equation: a Gaussian, its slope and its curvature.

What is measured and what is predicted pass through the same kernel, so smoothing costs resolution
but adds no error: filtering a position with the kernel's curvature gives exactly the acceleration
filtered with the kernel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy import sparse
from scipy.ndimage import gaussian_filter1d

from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import Mask

_REACH = 4.0
"""Half length of the kernel, in widths."""


@dataclass(frozen=True)
class Kernel:
    """Sparse operators from the ticks of a flight to its rows, a row each `spacing` seconds."""

    t: Array
    """(R,) times of the rows [s]."""
    reach: float
    """Half length of the kernel [s]."""
    smooth: Any
    """(R, N) mean."""
    slope: Any
    """(R, N) first derivative [1/s]."""
    curvature: Any
    """(R, N) second derivative [1/s^2]."""


def gaussian(t: Array, width: float, spacing: float) -> Kernel:
    """Build the kernel over evenly spaced ticks t (N,) [s].

    `width` is the standard deviation of the Gaussian [s], `spacing` the distance of the rows [s],
    rounded to ticks.
    """
    tick = float(t[1] - t[0])
    half = max(2, int(np.ceil(_REACH * width / tick)))
    offsets = np.arange(-half, half + 1)
    tau = offsets * tick
    bell = np.exp(-0.5 * (tau / width) ** 2)
    smooth = bell / bell.sum()
    # Exact on polynomials: the slope of t is 1, the curvature of t^2/2 is 1 and that of 1 is 0.
    slope = bell * tau
    slope /= slope @ tau
    curvature = bell * (tau**2 - width**2)
    curvature -= curvature.sum() / bell.sum() * bell
    curvature /= 0.5 * curvature @ tau**2
    centres = np.arange(half, t.size - half, max(1, round(spacing / tick)))
    columns = (centres[:, None] + offsets[None, :]).ravel()
    starts = np.arange(centres.size + 1) * offsets.size

    def operator(weights: Array) -> Any:
        data = np.tile(weights, centres.size)
        return sparse.csr_matrix((data, columns, starts), shape=(centres.size, t.size))

    return Kernel(t[centres], half * tick, operator(smooth), operator(slope), operator(curvature))


def smoothed(values: Array, width: float) -> Array:
    """Return rows (N, k) smoothed by a Gaussian of `width` rows, a second time what it took away.

    So curved motion keeps its height: polynomials up to the third degree pass unchanged. At the
    ends the rows go on as if turned about the last one.
    """
    reach = min(2 * math.ceil(_REACH * width), values.shape[0] - 1)
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    once = gaussian_filter1d(padded, width, axis=0)
    twice = once + gaussian_filter1d(padded - once, width, axis=0)
    return np.asarray(twice[reach : reach + values.shape[0]])


def clear_rows(kernel: Kernel, invalid: Mask) -> Mask:
    """Return (R,): rows whose kernel touches none of the invalid ticks (N,)."""
    return np.asarray(abs(kernel.smooth) @ invalid.astype(np.float64) == 0.0)


def rows_of(kernel: Kernel, chosen: Mask) -> Kernel:
    """Return the kernel with some of its rows (R,) only."""
    parts = (kernel.smooth[chosen], kernel.slope[chosen], kernel.curvature[chosen])
    return Kernel(kernel.t[chosen], kernel.reach, *parts)


def interpolated(at: Array, t: Array, values: Array) -> Array:
    """Return (N, k): values (M, k) at rising times t (M,), on straight lines at times (N,)."""
    return np.column_stack([np.interp(at, t, column) for column in values.T])


def tick_means(t: Array, values: Array, ticks: Array) -> Array:
    """Return (N, k): means of a densely sampled series over a tick around each tick.

    A series sampled more slowly than the ticks is interpolated linearly. `t` (M,) rises, `values`
    are (M, k), `ticks` (N,) are even [s].
    """
    tick = float(ticks[1] - ticks[0])
    if np.median(np.diff(t)) >= tick:
        return interpolated(ticks, t, values)
    edges = np.concatenate([ticks - 0.5 * tick, [ticks[-1] + 0.5 * tick]])
    result = []
    for column in values.T:
        steps = 0.5 * (column[1:] + column[:-1]) * np.diff(t)
        area = np.concatenate([[0.0], np.cumsum(steps)])
        at = np.interp(edges, t, area)
        span = np.maximum(np.clip(edges[1:], t[0], t[-1]) - np.clip(edges[:-1], t[0], t[-1]), 1e-9)
        outside = (ticks < t[0]) | (ticks > t[-1])
        result.append(np.where(outside, np.interp(ticks, t, column), np.diff(at) / span))
    return np.column_stack(result)


def held_means(t: Array, values: Array, ticks: Array) -> Array:
    """Return (N, k): means over [tick, next tick) of values that hold until the next one."""
    tick = float(ticks[1] - ticks[0])
    edges = np.concatenate([ticks, [ticks[-1] + tick]])
    steps = np.vstack([np.zeros(values.shape[1]), np.cumsum(values[:-1] * np.diff(t)[:, None], 0)])
    row = np.clip(np.searchsorted(t, edges, side="right") - 1, 0, t.size - 1)
    area = steps[row] + values[row] * (edges - t[row])[:, None]
    return np.asarray(np.diff(area, axis=0) / tick)
