"""Runs of samples and spans of time."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError

Mask = NDArray[np.bool_]
Span = tuple[float, float]
_MOST_ROWS = 1_000_000
"""Largest number of rows of an even clock: 5 h at 50 Hz."""


def check_extent(begin: float, end: float, rate: float) -> None:
    """Refuse stamps [s] of more than one flight, before they are resampled to an even clock [Hz].

    Raises:
        InputError: they reach over too long a time.
    """
    if not (end - begin) * rate <= _MOST_ROWS:
        raise InputError(
            f"the log's stamps reach over {end - begin:.4g} s; accepted: those of one flight, up "
            f"to {_MOST_ROWS / rate:.0f} s"
        )


def runs(mask: Mask) -> list[tuple[int, int]]:
    """Return [begin, end) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(int(b), int(e)) for b, e in zip(edges[::2], edges[1::2], strict=True)]


def merged(spans: Iterable[Span], apart: float = 0.0) -> list[Span]:
    """Return the spans sorted; spans that overlap or are closer than `apart` are merged."""
    result: list[Span] = []
    for begin, end in sorted(s for s in spans if s[1] >= s[0]):
        if result and begin <= result[-1][1] + apart:
            result[-1] = result[-1][0], max(end, result[-1][1])
        else:
            result.append((begin, end))
    return result


def inside(t: Array, spans: Iterable[Span]) -> Mask:
    """Return which times are in one of the spans."""
    mask = np.zeros(t.shape, np.bool_)
    for begin, end in spans:
        mask |= (t >= begin) & (t <= end)
    return mask


def interpolated(at: Array, t: Array, values: Array) -> Array:
    """Return (N, k): values (M, k) at rising times t (M,), on straight lines at times (N,)."""
    return np.column_stack([np.interp(at, t, column) for column in values.T])


def block_means(values: Array, length: int) -> Array:
    """Return the means of blocks of `length` rows of (N,) or (N, k); a rest is left out."""
    count = len(values) // length
    blocks = values[: count * length].reshape(count, length, *values.shape[1:])
    return np.asarray(blocks.mean(axis=1))


def thinned(t: Array, values: Array, step: float) -> tuple[Array, Array]:
    """Return times and values of samples: means over `step` [s] where they are faster."""
    every = max(round(step / max(sample_interval(t), 1e-6)), 1)
    return block_means(t, every), block_means(values, every)


def peak_offset(values: Array, at: int) -> float:
    """Return how far the top of a parabola through a largest value and its neighbours is off."""
    left, top, right = values[at - 1 : at + 2]
    return float(0.5 * (left - right) / min(left - 2.0 * top + right, -1e-12))


def white_noise(values: Array) -> Array:
    """Return the standard deviation of white noise on each column of (N, k)."""
    second = np.abs(np.diff(values, 2, axis=0))
    return np.asarray(1.4826 * np.median(second, axis=0) / np.sqrt(6.0))


def sample_interval(t: Array) -> float:
    """Return the usual distance of stamps [s]; 0 with fewer than two."""
    steps = np.diff(t)
    steps = steps[steps > 0.0]
    return float(np.median(steps)) if steps.size else 0.0
