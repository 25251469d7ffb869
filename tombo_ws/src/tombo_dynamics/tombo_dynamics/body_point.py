"""A point of the body: how fast it moves, and what a force at it does."""

from __future__ import annotations

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_body
from tombo_dynamics.vectors import AnyVector, Vector, add, cross
from tombo_dynamics.vehicle import ARM_X, ARM_Y


@compiled
def hub(plant: Plant, rotor: int) -> Vector:
    """Return the place of a rotor's hub from the centre of gravity, base_link [m]."""
    v, cog = plant.vehicle, plant.centre_of_gravity
    return (
        v.arm_length * ARM_X[rotor] - cog[0],
        v.arm_length * ARM_Y[rotor] - cog[1],
        v.rotor_height,
    )


@compiled
def point_velocity(plant: Plant, point: AnyVector) -> Vector:
    """Return the velocity in map [m/s] of a point of the body.

    The point is relative to the centre of gravity, base_link [m]. Reads `state` and `rotation`.
    """
    turn, velocity = plant.rotation, plant.state.velocity
    sx, sy, sz = cross(plant.state.rates, point)
    return (
        velocity[0] + turn[0, 0] * sx + turn[0, 1] * sy + turn[0, 2] * sz,
        velocity[1] + turn[1, 0] * sx + turn[1, 1] * sy + turn[1, 2] * sz,
        velocity[2] + turn[2, 0] * sx + turn[2, 1] * sy + turn[2, 2] * sz,
    )


@compiled
def push_point(plant: Plant, point: AnyVector, force: AnyVector) -> None:
    """Add a force [N] in map at a point of the body to `force` and `moment`."""
    push = to_body(plant.rotation, force)
    plant.force = add(plant.force, push)
    plant.moment = add(plant.moment, cross(point, push))
