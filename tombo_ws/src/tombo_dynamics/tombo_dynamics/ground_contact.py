"""The floor: it pushes on landing gear and motors, with damping and friction."""

from __future__ import annotations

import math

from tombo_dynamics.body_point import point_velocity, push_point
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.vehicle import ARM_X, ARM_Y

_DIAGONAL = math.sqrt(2.0)


@compiled
def ground_clearance(plant: Plant) -> float:
    """Return a height of the centre of gravity [m] above which nothing touches the floor."""
    v, cog = plant.vehicle, plant.centre_of_gravity
    legs = math.hypot(v.leg_spread * _DIAGONAL, v.leg_height)
    motors = math.hypot(v.arm_length, v.rotor_height)
    return max(legs, motors) + math.hypot(cog[0], cog[1])


@compiled
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
