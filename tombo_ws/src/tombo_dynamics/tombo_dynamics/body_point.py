"""A point of the body: how fast it moves, and what a force at it does."""

from __future__ import annotations

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_body


@compiled
def point_velocity(plant: Plant, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Return the velocity in map [m/s] of the point (x, y, z) [m] of the body.

    The point is relative to the centre of gravity. Reads `state` and `rotation`.
    """
    turn, velocity, rates = plant.rotation, plant.state.velocity, plant.state.rates
    sx = rates[1] * z - rates[2] * y
    sy = rates[2] * x - rates[0] * z
    sz = rates[0] * y - rates[1] * x
    return (
        velocity[0] + turn[0, 0] * sx + turn[0, 1] * sy + turn[0, 2] * sz,
        velocity[1] + turn[1, 0] * sx + turn[1, 1] * sy + turn[1, 2] * sz,
        velocity[2] + turn[2, 0] * sx + turn[2, 1] * sy + turn[2, 2] * sz,
    )


@compiled
def push_point(
    plant: Plant, x: float, y: float, z: float, fx: float, fy: float, fz: float
) -> None:
    """Add a force (fx, fy, fz) [N] in map at the point (x, y, z) to `force` and `moment`."""
    ux, uy, uz = to_body(plant.rotation, fx, fy, fz)
    plant.force[0] += ux
    plant.force[1] += uy
    plant.force[2] += uz
    plant.moment[0] += y * uz - z * uy
    plant.moment[1] += z * ux - x * uz
    plant.moment[2] += x * uy - y * ux
