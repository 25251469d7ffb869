"""The frame meets the obstacle: a stiff, damped contact with friction."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import point_velocity, push_point
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_map
from tombo_dynamics.vectors import ZERO, add, norm
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
    contact=True,
    healthy_spread=0.0,
)
def contact_force(plant: Plant, noise: Array, stiffness: float, damping: float) -> None:
    """Push the arms (cylinders from centre to motor) off the vertical cylinder.

    Kelvin-Voigt normal force that never pulls, Coulomb friction against the sliding velocity.
    Distances are taken horizontally, so it holds for moderate tilt. The obstacle has no top to
    land on: what sinks into it from above is pushed out sideways.
    """
    pole, v, contact = plant.obstacle, plant.vehicle, plant.contact
    position, turn = plant.state.position, plant.rotation
    if pole.radius <= 0.0:
        return
    px = pole.x - position[0]
    py = pole.y - position[1]
    clearance = pole.radius + v.arm_radius
    reach = v.arm_length + clearance + _FARTHEST_CENTRE
    if px * px + py * py > reach * reach:
        return
    cx, cy = -plant.centre_of_gravity[0], -plant.centre_of_gravity[1]
    ox, oy, oz = to_map(turn, (cx, cy, 0.0))
    px -= ox
    py -= oy
    pushed = ZERO
    for i in range(4):
        ax = v.arm_length * ARM_X[i]
        ay = v.arm_length * ARM_Y[i]
        wx, wy, wz = to_map(turn, (ax, ay, 0.0))
        share = (px * wx + py * wy) / max(wx * wx + wy * wy, 1e-9)
        share = min(max(share, 0.0), 1.0)
        nx = share * wx - px
        ny = share * wy - py
        distance = math.sqrt(nx * nx + ny * ny)
        depth = clearance - distance
        height = position[2] + oz + share * wz
        if depth <= 0.0 or height > pole.top or distance < 1e-9:
            continue
        nx /= distance
        ny /= distance
        touched = (cx + share * ax, cy + share * ay, 0.0)
        vx, vy, vz = point_velocity(plant, touched)
        approach = vx * nx + vy * ny
        normal = max(0.0, stiffness * depth - damping * approach)
        tx = vx - approach * nx
        ty = vy - approach * ny
        rub = v.friction * normal / (norm((tx, ty, vz)) + 0.02)
        push = (normal * nx - rub * tx, normal * ny - rub * ty, -rub * vz)
        push_point(plant, touched, push)
        pushed = add(pushed, push)
        contact.touching = True
        contact.rotor = -1
        contact.force = pushed
        contact.point = (position[0] + ox + share * wx, position[1] + oy + share * wy, height)
