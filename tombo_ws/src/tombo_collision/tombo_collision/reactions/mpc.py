"""Model predictive control to x_r: a point mass under the limits of thrust and tilt."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import ClassVar

import daqp
import numpy as np

from tombo_collision.decision import Decision, Estimate, Guided
from tombo_collision.reactions import Reaction
from tombo_collision.reactions.reflex import off_surface
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import param
from tombo_dynamics.rotation import rotate_vector, yaw_of
from tombo_dynamics.vehicle import GRAVITY

_STEPS, _STEP = 10, 0.1
"""Ten steps of 0.1 s: the way to x_r takes one second."""
_SIDES = 8
"""Of the polygon that stands for the cone, inside it."""


@dataclass(frozen=True)
class Mpc(Reaction):
    """At 50 Hz the best accelerations of the next second for a point mass, the first one flown.

    Best: least square of distance to x_r, velocity, acceleration and its change; under the limits
    of thrust (a cone of the direction of gravity) and tilt. Known by the IMU, flown with the
    controller's gains of the recovery.
    """

    name: ClassVar[str] = "mpc"
    needs: ClassVar[tuple[str, ...]] = ("mocap", "imu")
    recovers: ClassVar[bool] = True

    distance: float = param(0.8, "m", (0.05, 20.0), "d_r, from x_c to x_r", "as bounce")
    height_min: float = param(
        0.7, "m", (0.0, 100.0), "x_r is not put below this height", "clear of ground effect"
    )
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
    timeout: float = param(
        4.0, "s", (0.5, 60.0), "after this time the mission holds x_r", "three times the recovery"
    )

    def begin(self, event: CollisionEvent, estimate: Estimate, last: Decision | None) -> Decision:
        """Return the way to x_r."""
        n_r = off_surface(event)
        x_r = event.contact_position + self.distance * n_r
        x_r[2] = max(x_r[2], self.height_min)
        yaw = yaw_of(estimate.attitude)
        return _Predicted(event.contact_position, n_r, x_r, self.timeout, yaw, self)


@dataclass
class _Predicted(Guided):
    params: Mpc

    def motion(self, time_s: float, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Return the point mass after the first step's share of 20 ms."""
        along = rotate_vector(estimate.attitude, np.array([0.0, 0.0, GRAVITY]))
        present = along - np.array([0.0, 0.0, along[2]])  # what tilt gives without loss of height
        off = estimate.position - self.x_r
        wanted = best_acceleration(self.params, off, estimate.velocity, present)
        ahead = 0.02
        velocity = estimate.velocity + ahead * wanted
        return estimate.position + ahead * velocity, velocity, wanted


@cache
def _problem(params: Mpc) -> tuple[Array, ...]:
    """Return what does not change of the quadratic programme.

    Returns:
        (3N, 3N) its matrix; (3N, 3), (3N, 3), (3N, 3) its gradient for an offset, a velocity and
        the acceleration before; (M, 3N) the constraints' matrix.
    """
    later, unit = np.arange(1, _STEPS + 1), np.eye(3)
    reach = np.zeros((_STEPS, _STEPS))
    speed = np.zeros((_STEPS, _STEPS))
    for i in range(_STEPS):
        for j in range(i + 1):
            reach[i, j] = _STEP**2 * (i - j + 0.5)
            speed[i, j] = _STEP
    change: Array = np.eye(_STEPS) - np.eye(_STEPS, k=-1)
    square: Array = (
        reach.T @ reach
        + params.velocity_weight * speed.T @ speed
        + params.acceleration_weight * np.eye(_STEPS)
        + params.change_weight * change.T @ change
    )
    from_offset = reach.T @ np.ones(_STEPS)
    from_velocity = reach.T @ (_STEP * later) + params.velocity_weight * speed.T @ np.ones(_STEPS)
    from_before = -params.change_weight * change.T @ np.eye(_STEPS)[:, 0]
    parts: tuple[Array, ...] = (from_offset, from_velocity, from_before)
    gradients: list[Array] = [np.kron(one[:, None], unit) for one in parts]
    whole: list[Array] = [np.kron(square, unit), *gradients]
    rows: Array = np.kron(np.eye(_STEPS), _limits(params)[0])
    return (*whole, rows)


@cache
def _limits(params: Mpc) -> tuple[Array, Array]:
    """Return A (M, 3) and b (M): A a <= b holds an acceleration inside of tilt and thrust."""
    slope, inside = math.tan(params.tilt_max), math.cos(math.pi / _SIDES)
    most = params.thrust_max * GRAVITY
    rows, bounds = [], []
    for k in range(_SIDES):
        x, y = math.cos(2.0 * math.pi * k / _SIDES), math.sin(2.0 * math.pi * k / _SIDES)
        rows.append((x, y, -slope * inside))
        bounds.append(slope * inside * GRAVITY)
        for lean in (0.25 * math.pi / 2.0, 0.5 * math.pi / 2.0):
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
    square, by_offset, by_velocity, by_before, rows = _problem(params)
    gradient = by_offset @ offset + by_velocity @ velocity + by_before @ before
    upper = np.tile(_limits(params)[1], _STEPS)
    lower = np.full(upper.size, -1e30)
    found, _, flag, _ = daqp.solve(square, gradient, rows, upper, lower)
    if flag < 1:  # a feasible problem: only numbers beyond reason come here
        return np.zeros(3)
    first: Array = np.array(found[:3])
    return first
