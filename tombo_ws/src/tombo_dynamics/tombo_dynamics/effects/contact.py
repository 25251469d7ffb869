"""The frame meets the obstacle: a stiff, damped contact with friction."""

from __future__ import annotations

import math

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P, V
from tombo_dynamics.vehicle import ARM_X, ARM_Y


@effect(
    "contact_force",
    Stage.WRENCH,
    [
        Param("stiffness", "N/m", 0.0, (0.0, 1e5), "of frame against obstacle", 6000.0),
        Param("damping", "N s/m", 0.0, (0.0, 1000.0), "of frame against obstacle", 25.0),
    ],
    signature="a short push away from the obstacle, at the arm that touches",
)
def contact_force(m: Array, noise: Array, stiffness: float, damping: float) -> None:
    """Push the arms (cylinders from centre to motor) off the vertical cylinder.

    Kelvin-Voigt normal force that never pulls, Coulomb friction against the sliding velocity.
    Distances are taken horizontally, so it holds for moderate tilt.
    """
    if m[P.obstacle + 2] <= 0.0:
        return
    px = m[P.obstacle] - m[P.body]
    py = m[P.obstacle + 1] - m[P.body + 1]
    clearance = m[P.obstacle + 2] + m[V.arm_radius]
    reach = m[V.arm_length] + clearance
    if px * px + py * py > reach * reach:
        return
    for i in range(4):
        ax = m[V.arm_length] * ARM_X[i]
        ay = m[V.arm_length] * ARM_Y[i]
        wx = m[P.rotation] * ax + m[P.rotation + 1] * ay
        wy = m[P.rotation + 3] * ax + m[P.rotation + 4] * ay
        wz = m[P.rotation + 6] * ax + m[P.rotation + 7] * ay
        share = (px * wx + py * wy) / max(wx * wx + wy * wy, 1e-9)
        share = min(max(share, 0.0), 1.0)
        nx = share * wx - px
        ny = share * wy - py
        distance = math.sqrt(nx * nx + ny * ny)
        depth = clearance - distance
        if depth <= 0.0 or m[P.body + 2] + share * wz > m[P.obstacle + 3] or distance < 1e-9:
            continue
        nx /= distance
        ny /= distance
        bx = share * ax
        by = share * ay
        sx = -m[P.body + 12] * by
        sy = m[P.body + 12] * bx
        sz = m[P.body + 10] * by - m[P.body + 11] * bx
        vx = m[P.body + 3] + m[P.rotation] * sx + m[P.rotation + 1] * sy + m[P.rotation + 2] * sz
        vy = (
            m[P.body + 4]
            + m[P.rotation + 3] * sx
            + m[P.rotation + 4] * sy
            + m[P.rotation + 5] * sz
        )
        vz = (
            m[P.body + 5]
            + m[P.rotation + 6] * sx
            + m[P.rotation + 7] * sy
            + m[P.rotation + 8] * sz
        )
        approach = vx * nx + vy * ny
        normal = max(0.0, stiffness * depth - damping * approach)
        tx = vx - approach * nx
        ty = vy - approach * ny
        slide = math.sqrt(tx * tx + ty * ty + vz * vz) + 0.02
        rub = m[V.friction] * normal / slide
        fx = normal * nx - rub * tx
        fy = normal * ny - rub * ty
        fz = -rub * vz
        ux = m[P.rotation] * fx + m[P.rotation + 3] * fy + m[P.rotation + 6] * fz
        uy = m[P.rotation + 1] * fx + m[P.rotation + 4] * fy + m[P.rotation + 7] * fz
        uz = m[P.rotation + 2] * fx + m[P.rotation + 5] * fy + m[P.rotation + 8] * fz
        m[P.wrench] += ux
        m[P.wrench + 1] += uy
        m[P.wrench + 2] += uz
        m[P.wrench + 3] += by * uz
        m[P.wrench + 4] -= bx * uz
        m[P.wrench + 5] += bx * uy - by * ux
        m[P.contact] = 1.0
        m[P.contact + 1] = -1.0
        m[P.contact + 2] = fx
        m[P.contact + 3] = fy
        m[P.contact + 4] = fz
        m[P.contact + 5] = m[P.body] + share * wx
        m[P.contact + 6] = m[P.body + 1] + share * wy
        m[P.contact + 7] = m[P.body + 2] + share * wz
