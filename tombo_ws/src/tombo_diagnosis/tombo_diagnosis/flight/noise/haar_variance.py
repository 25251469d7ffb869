"""How much of a residual lives at which time scale: variances of differences of block means."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import block_means

SCALES_S = (0.12, 0.24, 0.48, 0.96, 1.92, 3.84)
"""Lengths of the blocks."""


def block_variances(residual: Array, spacing: float) -> tuple[Array, Array]:
    """Return variances (scales, channels) of half differences of adjacent block means, and counts.

    Constants give nothing, a slow drift little: each scale sees what changes within it (Haar
    wavelet variance, as Allan's). `residual` is (rows, channels), a row each `spacing` seconds.
    """
    variances = np.full((len(SCALES_S), residual.shape[1]), np.nan)
    counts = np.zeros(len(SCALES_S))
    for k, scale in enumerate(SCALES_S):
        length = max(1, round(scale / spacing))
        blocks = residual.shape[0] // length
        if blocks < 4 or length * spacing > 1.5 * scale:
            continue
        half = 0.5 * np.diff(block_means(residual, length), axis=0)
        variances[k] = np.mean(half**2, axis=0)
        counts[k] = blocks / 1.5
    return variances, counts


def pooled(found: Sequence[tuple[Array, Array]]) -> tuple[Array, Array]:
    """Return variances and counts over flights, weighed by the counts."""
    counts = np.sum([c for _, c in found], axis=0)
    total = np.zeros_like(found[0][0])
    for variances, count in found:
        total += np.where(count[:, None] > 0, np.nan_to_num(variances) * count[:, None], 0.0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / counts[:, None]
    return mean, counts


def long_run_of_scales(variances: Sequence[float], per_second: float) -> float:
    """Return rows times the variance of their mean, at the time scale where this is most.

    `variances`: as `block_variances` returns them for one channel, with `per_second` rows; that of
    a block's mean is twice as much.
    """
    blocks = zip(variances, SCALES_S, strict=False)
    return max((2.0 * v * scale * per_second for v, scale in blocks), default=0.0)
