"""Model predictive control to x_r: a point mass under the limits of thrust and tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import daqp
import numpy as np

from tombo_collision.decision import Estimate, Guided
from tombo_collision.reactions import OffSurface
from tombo_dynamics.arrays import Array
from tombo_dynamics.params import param
from tombo_dynamics.rotation import rotate_vector
from tombo_dynamics.vehicle import GRAVITY

_STEPS, _STEP = 10, 0.1
"""Ten steps of 0.1 s: the way to x_r takes one second."""
_SIDES = 8
"""Of the polygon inside the cone."""


@dataclass(frozen=True)
class Mpc(OffSurface):
    """At 50 Hz the best accelerations of the next second for a point mass, the first one flown.

    Best: least square of distance to x_r, velocity, acceleration and its change; under the limits
    of thrust (a cone of the direction of gravity) and tilt. Known by the IMU, flown with the
    controller's gains of the recovery.
    """

    name: ClassVar[str] = "mpc"
    recovers: ClassVar[bool] = True

    velocity_weight: float = param(
        0.15, "s^2", (0.0, 10.0), "weight of velocity squared against distance squared", "tuned"
    )
    acceleration_weight: float = param(
        0.01, "s^4", (1e-6, 1.0), "weight of acceleration squared", "tuned: 1.4 s to x_r"
    )
    change_weight: float = param(
        0.02, "s^4", (0.0, 1.0), "weight of the change of acceleration from step to step", "tuned"
    )
    tilt_max: float = param(0.5, "rad", (0.05, 1.2), "limit of tilt", "as the recovery's")
    thrust_max: float = param(
        1.6, "1", (1.05, 10.0), "highest thrust over the weight", "three rotors of four: 2.1 * 3/4"
    )

    def way(self, decision: Guided, estimate: Estimate) -> Guided:
        """Return the predicted way to x_r."""
        return _Predicted(**vars(decision), params=self)


@dataclass
class _Predicted(Guided):
    params: Mpc

    def motion(self, time_s: float, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Return the point mass after the first step's share of 20 ms."""
        along = rotate_vector(estimate.attitude, np.array([0.0, 0.0, GRAVITY]))
        present = along - np.array([0.0, 0.0, along[2]])  # what tilt gives without loss of height
        off = estimate.position - self.x_r
        acceleration = best_acceleration(self.params, off, estimate.velocity, present)
        ahead = 0.02
        velocity = estimate.velocity + ahead * acceleration
        return estimate.position + ahead * velocity, velocity, acceleration


@cache
def _problem(params: Mpc) -> tuple[Array, ...]:
    """Return what does not change of the quadratic programme.

    Returns:
        (3N, 3N) its matrix; (3N, 3), (3N, 3), (3N, 3) its gradient for an offset, a velocity and
        the acceleration before; (M, 3N) the constraints' matrix; (M), (M) their bounds.
    """
    steps, unit = np.arange(_STEPS), np.eye(3)
    speed = _STEP * np.tri(_STEPS)
    reach = _STEP * speed * (steps[:, None] - steps + 0.5)
    change = np.eye(_STEPS) - np.eye(_STEPS, k=-1)
    square = (
        reach.T @ reach
        + params.velocity_weight * speed.T @ speed
        + params.acceleration_weight * np.eye(_STEPS)
        + params.change_weight * change.T @ change
    )
    from_offset = reach.T @ np.ones(_STEPS)
    from_velocity = _STEP * reach.T @ (steps + 1) + params.velocity_weight * speed.sum(axis=0)
    from_before = -params.change_weight * change[0]
    gradients = (from_offset, from_velocity, from_before)
    rows, bounds = _limits(params)
    upper = np.tile(bounds, _STEPS)
    parts = (
        np.kron(square, unit),
        *(np.kron(gradient[:, None], unit) for gradient in gradients),
        np.kron(np.eye(_STEPS), rows),
        *(upper, np.full(upper.size, -1e30)),
    )
    return tuple(part.astype(np.float64) for part in parts)


def _limits(params: Mpc) -> tuple[Array, Array]:
    """Return A (M, 3) and b (M): A a <= b holds an acceleration inside of tilt and thrust."""
    slope, inside = math.tan(params.tilt_max), math.cos(math.pi / _SIDES)
    most = params.thrust_max * GRAVITY
    rows, bounds = [], []
    for k in range(_SIDES):
        x, y = math.cos(2.0 * math.pi * k / _SIDES), math.sin(2.0 * math.pi * k / _SIDES)
        rows.append((x, y, -slope * inside))
        bounds.append(slope * inside * GRAVITY)
        for lean in (math.pi / 8.0, math.pi / 4.0):
            c, s = math.cos(lean), math.sin(lean)
            rows.append((s * x, s * y, c))
            bounds.append(most * inside - c * GRAVITY)
    rows += [(0.0, 0.0, 1.0), (0.0, 0.0, -1.0)]
    bounds += [most - GRAVITY, 0.7 * GRAVITY]
    return np.array(rows), np.array(bounds)


def best_acceleration(params: Mpc, offset: Array, velocity: Array, before: Array) -> Array:
    """Return the first acceleration (3) [m/s^2] of the best course to the origin.

    Args:
        params: weights and limits.
        offset: (3) from the goal [m].
        velocity: (3) [m/s].
        before: (3) present acceleration [m/s^2].
    """
    square, by_offset, by_velocity, by_before, rows, upper, lower = _problem(params)
    gradient = by_offset @ offset + by_velocity @ velocity + by_before @ before
    solution, _, flag, _ = daqp.solve(square, gradient, rows, upper, lower)
    if flag < 1:  # a feasible problem: only numbers beyond reason come here
        return np.zeros(3)
    first: Array = np.array(solution[:3])
    return first
