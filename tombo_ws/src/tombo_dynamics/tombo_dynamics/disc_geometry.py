"""Where a rotor disc and the obstacle, a vertical cylinder, meet."""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_body
from tombo_dynamics.vectors import AnyVector, Vector, vector

FAR = 1e9
"""m: distance of what cannot meet."""
_STEEP = 0.2


@compiled
def disc_to_obstacle(plant: Plant, hub: AnyVector) -> Vector:
    """Return the distance from hub to the cylinder's axis in the disc plane, and its direction.

    Args:
        plant: `state`, `rotation` and `obstacle` are read.
        hub: its position in base_link [m].

    Returns:
        distance [m] (1e9 when the disc plane meets the axis above the cylinder's top or below the
        floor, or stands steeper than 78 deg), and the unit direction from the hub in the disc
        plane, base_link x and y.
    """
    turn, position, pole = plant.rotation, plant.state.position, plant.obstacle
    hx, hy, hz = vector(hub)
    if abs(turn[2, 2]) < _STEEP:
        return FAR, 1.0, 0.0
    ax = pole.x - (position[0] + turn[0, 0] * hx + turn[0, 1] * hy + turn[0, 2] * hz)
    ay = pole.y - (position[1] + turn[1, 0] * hx + turn[1, 1] * hy + turn[1, 2] * hz)
    az = -(turn[0, 2] * ax + turn[1, 2] * ay) / turn[2, 2]
    z = position[2] + turn[2, 0] * hx + turn[2, 1] * hy + turn[2, 2] * hz + az
    if z > pole.top or z < 0.0:
        return FAR, 1.0, 0.0
    ex, ey, _ = to_body(turn, (ax, ay, az))
    distance = math.sqrt(ex * ex + ey * ey)
    if distance < 1e-9:
        return 0.0, 1.0, 0.0
    return distance, ex / distance, ey / distance
