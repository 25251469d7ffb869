"""How noisy a channel's rows are, correlation included, and how far they can be trusted at all."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_dynamics.arrays import Array

BLOCK_S = 1.0
"""Residuals are taken to be independent from one such block to the next."""
_SETTLES_S = 10.0
_FLOORS = {
    "force": (0.004, 0.012),
    "mocap against accel": (0.004, 0.006),
    "acceleration": (0.004, 0.012),
    "turning": (0.02, 0.04),
    "gyro against mocap": (0.0005, 0.0012),
    "rotor speed": (0.3, 0.4),
    "voltage": (0.005, 0.01),
    "latency": (1e-4, 2e-4),
}
"""By the beginning of a channel's name, in its unit: no average over ten seconds is trusted to be
closer than the first, however still the data look; the second is the least error of the model."""


def floors_of(channel: str) -> tuple[float, float]:
    """Return how close an average of a channel can be trusted to be, and the model's error."""
    return next(floors for start, floors in _FLOORS.items() if channel.startswith(start))


def long_run_variance(residual: Sequence[Array], per_second: float, floor: float) -> float:
    """Return what correlated noise amounts to: rows times the variance of their mean.

    `residual` (rows,) is what no candidate explains of each flight; `floor`: see `floors_of`.
    """
    per_block = max(1, round(BLOCK_S * per_second))
    sums = []
    for rows in residual:
        count = rows.size // per_block
        centred = rows - rows.mean() if rows.size > 2 * per_block else rows
        sums.append(centred[: count * per_block].reshape(count, per_block).sum(axis=1))
    blocks = np.concatenate(sums)
    white = float(np.mean(np.concatenate(residual) ** 2))
    coloured = float(np.mean(blocks**2)) / per_block if blocks.size >= 3 else white
    return max(coloured, white, floor**2 * per_second * _SETTLES_S)
