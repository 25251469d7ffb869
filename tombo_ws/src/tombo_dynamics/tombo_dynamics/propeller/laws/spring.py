"""One angle against a linear spring and a centrifugal pull: y + m tan(y) = r."""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled

_EDGE = 0.5 * math.pi
_CLOSE = 1e-14


@compiled
def spring_angle(m: float, r: float) -> float:
    """Return y in (-pi/2, pi/2) with y + m tan(y) = r, for m >= 0.

    The left side rises steadily, so there is one root; Newton's method, kept inside of a bracket
    that every step narrows. Without pull (m = 0) it is r itself.
    """
    if m <= 0.0:
        return r
    low, high = -_EDGE, _EDGE
    y = math.atan(r / (1.0 + m))
    for _ in range(200):
        tangent = math.tan(y)
        excess = y + m * tangent - r
        if excess > 0.0:
            high = y
        else:
            low = y
        step = excess / (1.0 + m * (1.0 + tangent * tangent))
        if abs(step) < _CLOSE:
            return y - step
        y -= step
        if not low < y < high:
            y = 0.5 * (low + high)
    return y
