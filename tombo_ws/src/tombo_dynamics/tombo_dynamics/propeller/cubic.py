"""Tables of local cubics: monotone where the data are."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array


def cubic_table(step: float, value: Array, slope: Array) -> Array:
    """Return local cubics (n, 4), lowest power first, through n + 1 equidistant knots.

    Slopes that would let a cubic turn back between rising knots are lowered to Fritsch and
    Carlson's limit, three times the secants' slope; elsewhere they are kept as they are.

    Args:
        step: distance of the knots.
        value: (n + 1,) values at the knots.
        slope: (n + 1,) slopes at the knots.
    """
    secant = np.diff(value) / step
    steepest = 3.0 * np.minimum(np.append(secant, np.inf), np.insert(secant, 0, np.inf))
    bounded = np.where(steepest > 0.0, np.clip(slope, 0.0, np.maximum(steepest, 0.0)), slope)
    left, right = bounded[:-1], bounded[1:]
    second = (3.0 * secant - 2.0 * left - right) / step
    third = (left + right - 2.0 * secant) / step**2
    return np.ascontiguousarray(np.stack([value[:-1], left, second, third], axis=1))


def cubic_values(coeffs: Array, step: float, x: Array) -> Array:
    """Return the table's values at `x`, any shape, from 0 to n step."""
    i = np.minimum((x / step).astype(np.int64), coeffs.shape[0] - 1)
    y = x - i * step
    c = coeffs[i]
    return np.asarray(c[..., 0] + y * (c[..., 1] + y * (c[..., 2] + y * c[..., 3])))
