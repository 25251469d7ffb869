"""The floor: it pushes on landing gear and motors, with damping and friction."""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Array, P, V
from tombo_dynamics.vehicle import ARM_X, ARM_Y

_DIAGONAL = math.sqrt(2.0)


@compiled
def ground_clearance(m: Array) -> float:
    """Return a height of the centre of gravity [m] above which nothing touches the floor."""
    legs = math.hypot(m[V.leg_spread] * _DIAGONAL, m[V.leg_height])
    motors = math.hypot(m[V.arm_length], m[V.rotor_height])
    return max(legs, motors) + math.hypot(m[P.inertial + 5], m[P.inertial + 6])


@compiled
def ground_contact(m: Array) -> None:
    """Add the floor's push (z = 0 in map) on four legs and four motors to the wrench.

    Kelvin-Voigt normal force that never pulls, Coulomb friction against the sliding velocity.
    """
    r = P.rotation
    for i in range(8):
        j = i % 4
        if i < 4:
            bx = m[V.leg_spread] * ARM_X[j] * _DIAGONAL
            by = m[V.leg_spread] * ARM_Y[j] * _DIAGONAL
            bz = -m[V.leg_height]
        else:
            bx = m[V.arm_length] * ARM_X[j]
            by = m[V.arm_length] * ARM_Y[j]
            bz = m[V.rotor_height]
        bx -= m[P.inertial + 5]
        by -= m[P.inertial + 6]
        z = m[P.body + 2] + m[r + 6] * bx + m[r + 7] * by + m[r + 8] * bz
        if z >= 0.0:
            continue
        wx, wy, wz = m[P.body + 10], m[P.body + 11], m[P.body + 12]
        sx = wy * bz - wz * by
        sy = wz * bx - wx * bz
        sz = wx * by - wy * bx
        vx = m[P.body + 3] + m[r] * sx + m[r + 1] * sy + m[r + 2] * sz
        vy = m[P.body + 4] + m[r + 3] * sx + m[r + 4] * sy + m[r + 5] * sz
        vz = m[P.body + 5] + m[r + 6] * sx + m[r + 7] * sy + m[r + 8] * sz
        fz = max(0.0, -m[V.ground_stiffness] * z - m[V.ground_damping] * vz)
        rub = m[V.friction] * fz / (math.sqrt(vx * vx + vy * vy) + 0.02)
        fx = -rub * vx
        fy = -rub * vy
        ux = m[r] * fx + m[r + 3] * fy + m[r + 6] * fz
        uy = m[r + 1] * fx + m[r + 4] * fy + m[r + 7] * fz
        uz = m[r + 2] * fx + m[r + 5] * fy + m[r + 8] * fz
        m[P.wrench] += ux
        m[P.wrench + 1] += uy
        m[P.wrench + 2] += uz
        m[P.wrench + 3] += by * uz - bz * uy
        m[P.wrench + 4] += bz * ux - bx * uz
        m[P.wrench + 5] += bx * uy - by * ux
