"""Arithmetic of vectors with three components, for compiled code.

A vector is a tuple, or an array (3) such as the field of a record; a result is a tuple. A field of
a record takes it as a whole, a row of an array by `store`:

    slope.velocity = subtract(to_map(turn, scale(1.0 / mass, force)), (0.0, 0.0, GRAVITY))
    store(log.position[tick], state.position)
"""

from __future__ import annotations

import math
from typing import Any

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled

Vector = tuple[float, float, float]
AnyVector = Array | Vector
ZERO: Vector = (0.0, 0.0, 0.0)
UNKNOWN: Vector = (math.nan, math.nan, math.nan)


@compiled
def vector(a: AnyVector) -> Vector:
    """Return a copy of `a`."""
    return a[0], a[1], a[2]


@compiled
def store(out: Any, a: Any) -> None:
    """Write the components of an array of any length, or of a vector, to the array `out`."""
    for i in range(len(a)):
        out[i] = a[i]


@compiled
def add(a: AnyVector, b: AnyVector) -> Vector:
    """Return a + b."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@compiled
def subtract(a: AnyVector, b: AnyVector) -> Vector:
    """Return a - b."""
    return a[0] - b[0], a[1] - b[1], a[2] - b[2]


@compiled
def scale(factor: float, a: AnyVector) -> Vector:
    """Return factor * a."""
    return factor * a[0], factor * a[1], factor * a[2]


@compiled
def add_scaled(a: AnyVector, factor: float, b: AnyVector) -> Vector:
    """Return a + factor * b."""
    return a[0] + factor * b[0], a[1] + factor * b[1], a[2] + factor * b[2]


@compiled
def multiply(a: AnyVector, b: AnyVector) -> Vector:
    """Return the products of the components."""
    return a[0] * b[0], a[1] * b[1], a[2] * b[2]


@compiled
def dot(a: AnyVector, b: AnyVector) -> float:
    """Return the scalar product."""
    return float(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


@compiled
def cross(a: AnyVector, b: AnyVector) -> Vector:
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@compiled
def norm(a: AnyVector) -> float:
    """Return the length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


@compiled
def clamp(a: AnyVector, limit: float) -> Vector:
    """Return `a` with each component limited to -limit to limit."""
    return (
        min(max(a[0], -limit), limit),
        min(max(a[1], -limit), limit),
        min(max(a[2], -limit), limit),
    )


@compiled
def all_finite(a: AnyVector) -> bool:
    """Return whether no component is infinite or NaN, nor their sum too large for a float."""
    return math.isfinite(a[0] + a[1] + a[2])
