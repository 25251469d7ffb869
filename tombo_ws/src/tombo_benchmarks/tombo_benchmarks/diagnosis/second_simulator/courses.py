"""Courses: Lissajous figures, smooth paths through random points, and steps in hover."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline

from tombo_benchmarks.diagnosis.second_simulator.vehicles import Array

KINDS = ("lissajous", "polynomial", "steps")
_LOW, _HIGH = 0.4, 2.0
"""m: heights that are flown."""


@dataclass(frozen=True)
class Course:
    """A reference on a grid of times: position, velocity, acceleration (N, 3), and yaw (N,)."""

    position: Array
    velocity: Array
    acceleration: Array
    yaw: Array


def course(kind: str, times: Array, rng: np.random.Generator) -> Course:
    """Return a random course of this kind."""
    path, yaw = _MAKERS[kind](times, rng)
    step = float(times[1] - times[0])
    velocity = np.gradient(path, step, axis=0)
    return Course(path, velocity, np.gradient(velocity, step, axis=0), yaw)


def _lissajous(t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Three sines whose pace rises, so that one flight has slow and fast parts."""
    base = float(rng.uniform(0.5, 0.7))
    phase = base * (t + float(rng.uniform(0.008, 0.018)) * t**2)
    ramp = np.clip(t / 3.0, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t / 3.0, 0.0, 1.0))
    ways = rng.permutation([1.0, 2.0])
    x = rng.uniform(1.2, 1.7) * np.sin(ways[0] * phase)
    y = rng.uniform(1.0, 1.5) * np.sin(ways[1] * phase + 0.5)
    z = 1.2 + rng.uniform(0.5, 0.75) * np.sin(rng.uniform(0.6, 0.9) * phase)
    path = np.column_stack([ramp * x, ramp * y, 1.2 + ramp * (z - 1.2)])
    return path, rng.uniform(-0.6, 0.6) * t * ramp


def _polynomial(t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """A quintic spline through random points at random times: snap is bounded."""
    gaps = rng.uniform(1.0, 2.2, int(t[-1]) + 2)
    knots = np.concatenate([[0.0, 0.7], 0.7 + np.cumsum(gaps)])
    knots = knots[: int(np.searchsorted(knots, t[-1])) + 2]
    points = [np.array([0.0, 0.0, 1.2])] * 2
    for gap in np.diff(knots)[1:]:
        way = rng.standard_normal(3) * (0.9, 0.9, 0.45) * gap
        new = points[-1] + way
        points.append(np.clip(new, (-1.7, -1.7, _LOW + 0.15), (1.7, 1.7, _HIGH)))
    path = make_interp_spline(knots, np.array(points), k=5)(t)
    turns = np.concatenate([[0.0, 0.0], np.cumsum(rng.uniform(-1.2, 1.2, knots.size - 2))])
    yaw = make_interp_spline(knots, turns, k=3)(t)
    path[:, 2] = np.clip(path[:, 2], _LOW, 2.5)
    return path, yaw


def _steps(t: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Hover, turns by a quarter to a half, quick shuttles, a low hover: smoothed steps."""
    path = np.tile([0.0, 0.0, 1.2], (t.size, 1))
    yaw = np.zeros(t.size)
    at = 1.0
    here = np.array([0.0, 0.0, 1.2])
    while at < t[-1] - 1.0:
        kind = rng.choice(["turn", "shuttle", "far", "height"])
        if kind == "turn":
            yaw += float(rng.choice([-1, 1]) * rng.uniform(1.2, 3.1)) * _smooth((t - at) / 1.6)
            at += 2.2
            continue
        goal = here.copy()
        pace = 1.6
        if kind == "shuttle":
            goal[int(rng.integers(2))] += float(rng.choice([-0.45, 0.45]))
            pace = 1.3
        elif kind == "far":
            goal[:2] = rng.uniform(-1.6, 1.6, 2)
        else:
            goal[2] = float(rng.choice([_LOW, 0.6, 1.2, _HIGH]))
            pace = 2.8
        goal[:2] = np.clip(goal[:2], -1.7, 1.7)
        way = goal - here
        duration = max(pace * float(np.linalg.norm(way)) ** 0.5, 0.6)
        path += _smooth((t - at) / duration)[:, None] * way
        here, at = goal, at + duration + float(rng.uniform(0.1, 0.8))
    return path, yaw


def _smooth(s: Array) -> Array:
    """Return a step from 0 to 1 with four derivatives that vanish at both ends."""
    s = np.clip(s, 0.0, 1.0)
    return np.asarray(s**5 * (126 + s * (-420 + s * (540 + s * (-315 + s * 70)))))


_MAKERS: dict[str, Callable[[Array, np.random.Generator], tuple[Array, Array]]] = {
    "lissajous": _lissajous, "polynomial": _polynomial, "steps": _steps,
}  # fmt: skip
