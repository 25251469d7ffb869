"""Points of the body: velocity, effect of a force, distance to the obstacle."""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_body
from tombo_dynamics.vectors import AnyVector, Vector, add, cross, vector
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


NO_INTERSECTION = 1e9
"""[m]: distance where disc and obstacle cannot meet."""
_STEEP = 0.2


@compiled
def disc_to_obstacle(plant: Plant, hub: AnyVector) -> Vector:
    """Return the distance from hub to the cylinder's axis in the disc plane, and its direction.

    Args:
        plant: `state`, `rotation` and `obstacle` are read.
        hub: its position in base_link [m].

    Returns:
        distance [m], and the unit direction from the hub in the disc plane, base_link x and y.
        The distance is NO_INTERSECTION if the disc plane meets the axis above the cylinder's top
        or below the floor, or is tilted by more than 78 deg.
    """
    turn, position, pole = plant.rotation, plant.state.position, plant.obstacle
    hx, hy, hz = vector(hub)
    if abs(turn[2, 2]) < _STEEP:
        return NO_INTERSECTION, 1.0, 0.0
    ax = pole.x - (position[0] + turn[0, 0] * hx + turn[0, 1] * hy + turn[0, 2] * hz)
    ay = pole.y - (position[1] + turn[1, 0] * hx + turn[1, 1] * hy + turn[1, 2] * hz)
    az = -(turn[0, 2] * ax + turn[1, 2] * ay) / turn[2, 2]
    z = position[2] + turn[2, 0] * hx + turn[2, 1] * hy + turn[2, 2] * hz + az
    if z > pole.top or z < 0.0:
        return NO_INTERSECTION, 1.0, 0.0
    ex, ey, _ = to_body(turn, (ax, ay, az))
    distance = math.sqrt(ex * ex + ey * ey)
    if distance < 1e-9:
        return 0.0, 1.0, 0.0
    return distance, ex / distance, ey / distance


_DIAGONAL = math.sqrt(2.0)


@compiled
def ground_clearance(plant: Plant) -> float:
    """Return a height of the centre of gravity [m] above which nothing touches the floor."""
    v, cog = plant.vehicle, plant.centre_of_gravity
    legs = math.hypot(v.leg_spread * _DIAGONAL, v.leg_height)
    motors = math.hypot(v.arm_length, v.rotor_height)
    return max(legs, motors) + math.hypot(cog[0], cog[1])


@compiled(inline=False)
def ground_contact(plant: Plant) -> None:
    """Add the floor's push (z = 0 in map) on four legs and four motors to `force` and `moment`.

    Kelvin-Voigt normal force that never pulls, Coulomb friction against the sliding velocity.
    """
    v, turn, state = plant.vehicle, plant.rotation, plant.state
    for i in range(8):
        j = i % 4
        if i < 4:
            bx = v.leg_spread * ARM_X[j] * _DIAGONAL
            by = v.leg_spread * ARM_Y[j] * _DIAGONAL
            bz = -v.leg_height
        else:
            bx = v.arm_length * ARM_X[j]
            by = v.arm_length * ARM_Y[j]
            bz = v.rotor_height
        bx -= plant.centre_of_gravity[0]
        by -= plant.centre_of_gravity[1]
        z = state.position[2] + turn[2, 0] * bx + turn[2, 1] * by + turn[2, 2] * bz
        if z >= 0.0:
            continue
        vx, vy, vz = point_velocity(plant, (bx, by, bz))
        fz = max(0.0, -v.ground_stiffness * z - v.ground_damping * vz)
        rub = v.friction * fz / (math.sqrt(vx * vx + vy * vy) + 0.02)
        push_point(plant, (bx, by, bz), (-rub * vx, -rub * vy, fz))
