"""The wing's loads as closed forms of its twist, with their derivatives."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled


@compiled
def twisted(
    weights: Array, rate: float, gamma: float, sine: float, cosine: float
) -> tuple[float, float]:
    """Return f(gamma) and f'(gamma) of the closed form in `wing`.

    Args:
        weights: the six weights, in the unit of f.
        rate: n, 1.
        gamma: twist [rad].
        sine: of gamma.
        cosine: of gamma.
    """
    s, c = math.sin(rate * gamma), math.cos(rate * gamma)
    even = weights[0] + weights[1] * c + weights[2] * s
    odd = weights[3] + weights[4] * c + weights[5] * s
    even_slope = rate * (weights[2] * c - weights[1] * s)
    odd_slope = rate * (weights[5] * c - weights[4] * s)
    value = cosine * even + sine * odd
    slope = cosine * (odd + even_slope) + sine * (odd_slope - even)
    return value, slope
