"""Cubic pieces through knots, monotone where the values are (PCHIP, Fritsch and Butland 1984).

As `scipy.interpolate.PchipInterpolator`, to the last bit, without the sixth of a second that scipy
takes to import.
"""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array


class MonotoneCubic:
    """A curve; the first and the last piece go on beyond the knots."""

    def __init__(self, knots: Array, values: Array) -> None:
        """Fit a curve.

        Args:
            knots: (N) rising, at least two.
            values: (N) at the knots.
        """
        steps, slopes = np.diff(knots), np.diff(values) / np.diff(knots)
        tangents = _tangents(steps, slopes)
        bend = (tangents[:-1] + tangents[1:] - 2.0 * slopes) / steps
        self.knots = knots
        self.coefficients: Array = np.array(
            [values[:-1], tangents[:-1], (slopes - tangents[:-1]) / steps - bend, bend / steps]
        )
        """(4, N - 1) of each piece over the distance from its knot, the constant first."""

    def __call__(self, x: Array | float) -> Array:
        """Return the values at `x`, of any shape."""
        piece = np.searchsorted(self.knots, x, "right") - 1
        piece = np.clip(piece, 0, self.knots.size - 2)
        constant, linear, square, cube = self.coefficients[:, piece]
        d = x - self.knots[piece]
        return np.asarray(constant + linear * d + square * (d * d) + cube * (d * d * d))


def _tangents(steps: Array, slopes: Array) -> Array:
    """Return the derivatives (N) at the knots: weighted harmonic means of the slopes (N - 1)."""
    if slopes.size == 1:
        return np.repeat(slopes, 2)
    before, after = slopes[:-1], slopes[1:]
    turns = (np.sign(after) != np.sign(before)) | (after == 0.0) | (before == 0.0)
    first, second = 2.0 * steps[1:] + steps[:-1], steps[1:] + 2.0 * steps[:-1]
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = (first / before + second / after) / (first + second)
        inner = np.where(turns, 0.0, 1.0 / mean)
    begin = _end_tangent(steps[0], steps[1], slopes[0], slopes[1])
    end = _end_tangent(steps[-1], steps[-2], slopes[-1], slopes[-2])
    return np.array([begin, *inner, end])


def _end_tangent(step: float, next_step: float, slope: float, next_slope: float) -> float:
    """Return the derivative at the first knot, or the last, from the two nearest pieces."""
    tangent = ((2.0 * step + next_step) * slope - step * next_slope) / (step + next_step)
    if np.sign(tangent) != np.sign(slope):
        return 0.0
    if np.sign(slope) != np.sign(next_slope) and abs(tangent) > 3.0 * abs(slope):
        return float(3.0 * slope)
    return float(tangent)
