"""Tables of local cubics: monotone where the data are, and their inverse over a square root."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array

_ROOT_CELLS = 96


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


def inverse_table(knots: Array, coeffs: Array, top: float) -> tuple[float, Array]:
    """Return the step and local cubics of x over the square root of a rising table's value.

    Thrust grows with the square of speed, so speed is nearly linear in its root.

    Args:
        knots: (n + 1,) the table's knots, from 0.
        coeffs: (n, 4) the table, value 0 at 0 and rising.
        top: value at the last knot.
    """
    root = np.linspace(0.0, np.sqrt(top), _ROOT_CELLS + 1)
    step = float(knots[1])
    at_knots = np.sqrt(np.append(coeffs[:, 0], top))
    x = np.interp(root, at_knots, knots)
    for _ in range(6):
        i = np.minimum((x / step).astype(np.int64), coeffs.shape[0] - 1)
        y, c = x - i * step, coeffs[i]
        value = c[:, 0] + y * (c[:, 1] + y * (c[:, 2] + y * c[:, 3]))
        rise = c[:, 1] + y * (2.0 * c[:, 2] + 3.0 * y * c[:, 3])
        shift = np.divide(value - root**2, rise, out=np.zeros_like(x), where=rise > 0.0)
        x = np.clip(x - shift, 0.0, knots[-1])
    x[0], x[-1] = 0.0, knots[-1]
    slope = np.gradient(x, root, edge_order=2)
    inner = rise > 0.0
    slope[inner] = 2.0 * root[inner] / rise[inner]
    if slope[0] == 0.0 or not inner[0]:
        slope[0] = slope[1]
    return float(root[1]), cubic_table(float(root[1]), x, slope)
