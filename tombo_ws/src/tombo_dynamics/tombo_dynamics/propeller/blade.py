"""The blade's shape and its section coefficients, along the span."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.records import Blade, Section


def shape(blade: Blade, x: Array) -> tuple[Array, Array]:
    """Return depth [m] (leading minus trailing edge) and pitch [rad] of sections at `x` [m].

    Args:
        blade: the blade.
        x: distances from the hub's centre, any shape; where two pieces join, the outer one counts.
    """
    x = np.asarray(x, dtype=float)
    depth: Any = np.polyval(blade.pieces[0].depth_m, x)
    pitch: Any = np.polyval(blade.pieces[0].pitch_deg, x)
    for piece in blade.pieces[1:]:
        outer = x >= piece.start_m
        depth = np.where(outer, np.polyval(piece.depth_m, x), depth)
        pitch = np.where(outer, np.polyval(piece.pitch_deg, x), pitch)
    return depth, np.radians(pitch)


def lift_coefficient(section: Section, attack_rad: Array) -> Array:
    """Return C_L at angles of attack [rad]."""
    angle = section.lift_rate * attack_rad + np.radians(section.lift_phase_deg)
    return np.asarray(section.lift_mean + section.lift_swing * np.sin(angle))


def drag_coefficient(section: Section, attack_rad: Array) -> Array:
    """Return C_D at angles of attack [rad]."""
    angle = section.drag_rate * attack_rad + np.radians(section.drag_phase_deg)
    return np.asarray(section.drag_mean + section.drag_swing * np.cos(angle))


@lru_cache(maxsize=4)
def _gauss(order: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return nodes, weights


def span_quadrature(
    blade: Blade, start: ArrayLike, end: ArrayLike, order: int = 16
) -> tuple[Array, Array]:
    """Return Gauss-Legendre nodes [m] and weights [m] from `start` to `end`, piece by piece.

    16 points a piece integrate the blade's trigonometric functions to rounding.

    Args:
        blade: the blade.
        start: where the stretches begin [m], any shape; nodes and weights have it and one
            dimension more, the last.
        end: where they end [m], broadcast with `start`.
        order: points a piece; a piece that a stretch does not touch gets weights of zero.
    """
    nodes, weights = _gauss(order)
    xs: list[Array] = []
    ws: list[Array] = []
    for piece in blade.pieces:
        a = np.clip(np.asarray(start, dtype=float), piece.start_m, piece.end_m)[..., None]
        b = np.clip(np.asarray(end, dtype=float), piece.start_m, piece.end_m)[..., None]
        half = 0.5 * np.maximum(b - a, 0.0)
        xs.append(half * nodes + (a + half))
        ws.append(half * weights)
    return np.concatenate(xs, axis=-1), np.concatenate(ws, axis=-1)
