"""The frame meets the obstacle: a stiff, damped contact with friction."""

from __future__ import annotations

import math

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P, V
from tombo_dynamics.vehicle import ARM_X, ARM_Y

_FARTHEST_CENTRE = 0.15
"""m: the centre of gravity is not further from the centre than that (bounds of cog_offset)."""


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
    Distances are taken horizontally, so it holds for moderate tilt. The obstacle has no top to
    land on: what sinks into it from above is pushed out sideways.
    """
    if m[P.obstacle + 2] <= 0.0:
        return
    px = m[P.obstacle] - m[P.body]
    py = m[P.obstacle + 1] - m[P.body + 1]
    clearance = m[P.obstacle + 2] + m[V.arm_radius]
    reach = m[V.arm_length] + clearance + _FARTHEST_CENTRE
    if px * px + py * py > reach * reach:
        return
    r = P.rotation
    cx, cy = -m[P.inertial + 5], -m[P.inertial + 6]
    ox = m[r] * cx + m[r + 1] * cy
    oy = m[r + 3] * cx + m[r + 4] * cy
    oz = m[r + 6] * cx + m[r + 7] * cy
    px -= ox
    py -= oy
    pushed_x, pushed_y, pushed_z = 0.0, 0.0, 0.0
    for i in range(4):
        ax = m[V.arm_length] * ARM_X[i]
        ay = m[V.arm_length] * ARM_Y[i]
        wx = m[r] * ax + m[r + 1] * ay
        wy = m[r + 3] * ax + m[r + 4] * ay
        wz = m[r + 6] * ax + m[r + 7] * ay
        share = (px * wx + py * wy) / max(wx * wx + wy * wy, 1e-9)
        share = min(max(share, 0.0), 1.0)
        nx = share * wx - px
        ny = share * wy - py
        distance = math.sqrt(nx * nx + ny * ny)
        depth = clearance - distance
        height = m[P.body + 2] + oz + share * wz
        if depth <= 0.0 or height > m[P.obstacle + 3] or distance < 1e-9:
            continue
        nx /= distance
        ny /= distance
        bx = cx + share * ax
        by = cy + share * ay
        sx = -m[P.body + 12] * by
        sy = m[P.body + 12] * bx
        sz = m[P.body + 10] * by - m[P.body + 11] * bx
        vx = m[P.body + 3] + m[r] * sx + m[r + 1] * sy + m[r + 2] * sz
        vy = m[P.body + 4] + m[r + 3] * sx + m[r + 4] * sy + m[r + 5] * sz
        vz = m[P.body + 5] + m[r + 6] * sx + m[r + 7] * sy + m[r + 8] * sz
        approach = vx * nx + vy * ny
        normal = max(0.0, stiffness * depth - damping * approach)
        tx = vx - approach * nx
        ty = vy - approach * ny
        rub = m[V.friction] * normal / (math.sqrt(tx * tx + ty * ty + vz * vz) + 0.02)
        fx = normal * nx - rub * tx
        fy = normal * ny - rub * ty
        fz = -rub * vz
        ux = m[r] * fx + m[r + 3] * fy + m[r + 6] * fz
        uy = m[r + 1] * fx + m[r + 4] * fy + m[r + 7] * fz
        uz = m[r + 2] * fx + m[r + 5] * fy + m[r + 8] * fz
        m[P.wrench] += ux
        m[P.wrench + 1] += uy
        m[P.wrench + 2] += uz
        m[P.wrench + 3] += by * uz
        m[P.wrench + 4] -= bx * uz
        m[P.wrench + 5] += bx * uy - by * ux
        pushed_x += fx
        pushed_y += fy
        pushed_z += fz
        m[P.contact] = 1.0
        m[P.contact + 1] = -1.0
        m[P.contact + 2] = pushed_x
        m[P.contact + 3] = pushed_y
        m[P.contact + 4] = pushed_z
        m[P.contact + 5] = m[P.body] + ox + share * wx
        m[P.contact + 6] = m[P.body + 1] + oy + share * wy
        m[P.contact + 7] = height
