"""Single passes of a blade through a ring around the disc's rim.

How much of the time a blade covers a point at radius x is its chord's angle there over 2 pi:
motion blur spreads the blade along the circle and leaves that share as it is. So what a pass
changes, summed along its arc, has the same profile over the radius at every speed and exposure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_propeller.flap_video.disc import Frames, remove_flicker

Plane = NDArray[np.float32]
Mask = NDArray[np.bool_]

_STEP = 0.5
"""Pixels between samples along a radius."""
_DIRECTIONS = 1440
_PHI: Any = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
_INNER, _OUTER = 0.90, 1.07
"""The ring, in radii of the disc."""
_BLADE = (0.55, 0.88)
"""The ring in which blades are distinguished from the background."""
_GROUND_FRAMES = 2
"""Frames that must show what is behind a blade."""
_FALSE_SWING = 5.0
"""Swing of a blade in standard deviations of noise."""


@dataclass(frozen=True)
class Passes:
    """What passes of a blade change, summed along their arcs: one row a pass."""

    sums: Array
    """(pass, radius), grey levels."""
    weights: Array
    """Inverse variance, in units of a pixel's own."""
    waves: Array
    """(pass, 5): means of 1, cos phi, sin phi, cos 2 phi, sin 2 phi over the arc."""
    ground: Array
    """What is behind the blade (pass, radius), grey levels."""
    radii: Array
    """Pixels."""
    arc: float
    """Share of the directions."""
    rotation_per_frame: float
    """rad per frame, of a two-bladed propeller; NaN for one frame."""
    behind: Plane
    """What is behind the blades (direction, radius); NaN where it was never free."""


def passes_of(frames: Frames, x: float, y: float, radius: float) -> Passes:
    """Take the blades' passes through the ring around a circle [pixels].

    Raises:
        InputError: no blade stands out.
    """
    even = remove_flicker(frames)
    swept, rotation_per_frame = _swept(even, x, y, radius)
    radii: Any = np.arange(_INNER * radius, _OUTER * radius, _STEP)
    stack, inside = _unrolled(even, x, y, radii, _PHI)
    free = (~swept).astype(np.float32)
    n_free = free.sum(axis=0)
    behind = np.einsum("kp,kpr->pr", free, stack) / np.maximum(n_free, 1.0)[:, None]
    behind[(n_free < _GROUND_FRAMES) | ~inside.all(axis=1)] = np.nan
    arcs = [(shot, arc) for shot, row in zip(stack, swept, strict=True) for arc in _arcs(row)]
    return _summed(arcs, n_free, behind, radii, rotation_per_frame)


def resting_passes(frame: Plane, x: float, y: float, spinning: Passes) -> Passes:
    """Take blades at rest for passes; what is behind them is known from when they spun.

    Raises:
        InputError: it isn't.
    """
    radii, behind = spinning.radii, spinning.behind
    stack, inside = _unrolled([frame], x, y, radii, _PHI)
    known: Any = np.isfinite(behind).all(axis=1) & inside.all(axis=1)
    if not known.any():
        raise InputError("what is behind the blades was never seen; accepted: more frames")
    shot = stack[0] / np.float32(np.median(stack[0][known] / np.maximum(behind[known], 1.0)))
    change = np.where(known[:, None], shot - behind, 0.0)
    within = np.abs(change[:, radii < 0.97 * radii[-1] / _OUTER].mean(axis=1))
    noise = 1.4826 * float(np.median(within[known])) + 0.3
    there = _widened(known & (within > _FALSE_SWING * noise), 10)
    arcs = [(shot, arc) for arc in _arcs(there)]
    return _summed(arcs, np.full(_DIRECTIONS, 10.0), behind, radii, math.nan)


def _summed(
    arcs: list[tuple[Plane, NDArray[np.intp]]],
    n_free: NDArray[Any],
    behind: Plane,
    radii: Array,
    rotation_per_frame: float,
) -> Passes:
    known: Any = np.isfinite(behind).all(axis=1)
    blade = radii < radii[0] + 0.5 * (radii[-1] / _OUTER - radii[0])
    sums, weights, waves, grounds = [], [], [], []
    seen = np.zeros(_DIRECTIONS, bool)
    for shot, arc in arcs:
        if not known[arc].all():
            continue
        change = shot[arc] - behind[arc]
        strength = np.abs(change[:, blade].mean(axis=1)).astype(float) + 1e-3
        strength /= strength.sum()
        phi = _PHI[arc]
        sums.append(change.sum(axis=0))
        weights.append(1.0 / (len(arc) + float((1.0 / n_free[arc]).sum())))
        waves.append(
            [1.0, *(float(strength @ f(n * phi)) for n in (1, 2) for f in (np.cos, np.sin))]
        )
        grounds.append(strength @ behind[arc])
        seen[arc] = True
    shape = (len(sums), len(radii))
    return Passes(
        np.array(sums, dtype=float).reshape(shape), np.array(weights, dtype=float),
        np.array(waves, dtype=float).reshape(len(sums), 5),
        np.array(grounds, dtype=float).reshape(shape), radii, float(seen.mean()),
        rotation_per_frame, behind,
    )  # fmt: skip


def _arcs(there: Mask) -> list[NDArray[np.intp]]:
    """Return the runs of directions that are True, around the circle."""
    if there.all() or not there.any():
        return []
    order = (int(np.flatnonzero(~there)[0]) + np.arange(_DIRECTIONS)) % _DIRECTIONS
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there[order].astype(int), [0]])))
    return [order[a:b] for a, b in edges.reshape(-1, 2)]


def _unrolled(
    frames: list[Plane], x: float, y: float, radii: Array, phi: Array
) -> tuple[Plane, Mask]:
    """Return frames over (direction, radius), and which of these points are in the picture."""
    at_x = (x + np.cos(phi)[:, None] * radii).astype(np.float32)
    at_y = (y + np.sin(phi)[:, None] * radii).astype(np.float32)
    height, width = frames[0].shape
    inside = (at_x >= 0) & (at_x <= width - 1) & (at_y >= 0) & (at_y <= height - 1)
    rolled: Any = [cv2.remap(f, at_x, at_y, cv2.INTER_LINEAR) for f in frames]
    return np.stack(rolled), inside


def _swept(frames: list[Plane], x: float, y: float, radius: float) -> tuple[Mask, float]:
    """Return which directions a blade sweeps in each frame (k, direction), and rad per frame."""
    coarse = _DIRECTIONS // 4
    phi: Any = np.arange(coarse) * (2.0 * math.pi / coarse)
    radii: Any = np.linspace(_BLADE[0] * radius, _BLADE[1] * radius, 32)
    stack, inside = _unrolled(frames, x, y, radii, phi)
    stack = np.where(inside, stack, 0.0)
    swing = np.abs(stack - np.median(stack, axis=0)).mean(axis=2)
    swing = np.maximum(swing, np.roll(swing, coarse // 2, axis=1))  # two blades
    usual = np.median(swing)
    noise = 1.4826 * np.median(np.abs(swing - usual))
    floor = max(usual + _FALSE_SWING * noise, 0.08 * float(np.percentile(swing, 98)))
    swept = np.array([_widened(row > floor, 5) for row in swing])
    if swept.mean() > 0.9 or not swept.any():
        raise InputError("no blade stands out in single frames; accepted: more light or contrast")
    wave = (swing * np.exp(-2j * phi)).sum(axis=1)
    turns = wave[1:] * wave[:-1].conj()
    rotation_per_frame = abs(float(np.angle(turns.sum()))) / 2.0 if len(turns) else math.nan
    return np.repeat(swept, 4, axis=1), rotation_per_frame


def _widened(row: Mask, by: int) -> Mask:
    around = np.concatenate([row[-by:], row, row[:by]]).astype(float)
    return np.asarray(np.convolve(around, np.ones(2 * by + 1), "valid") > 0.0)
