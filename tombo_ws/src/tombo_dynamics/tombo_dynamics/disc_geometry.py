"""Where a rotor disc and the obstacle, a vertical cylinder, meet."""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Array, P

FAR = 1e9
"""m: distance of what cannot meet."""
_STEEP = 0.2


@compiled
def disc_to_obstacle(m: Array, hx: float, hy: float, hz: float) -> tuple[float, float, float]:
    """Return the distance from hub to the cylinder's axis in the disc plane, and its direction.

    Args:
        m: the plant's memory; `body`, `rotation` and `obstacle` are read.
        hx: hub position in base_link, x [m].
        hy: hub position in base_link, y [m].
        hz: hub position in base_link, z [m].

    Returns:
        distance [m] (1e9 when the disc plane meets the axis above the cylinder's top or below the
        floor, or stands steeper than 78 deg), and the unit direction from the hub in the disc
        plane, base_link x and y.
    """
    r = P.rotation
    if abs(m[r + 8]) < _STEEP:
        return FAR, 1.0, 0.0
    ax = m[P.obstacle] - (m[P.body] + m[r] * hx + m[r + 1] * hy + m[r + 2] * hz)
    ay = m[P.obstacle + 1] - (m[P.body + 1] + m[r + 3] * hx + m[r + 4] * hy + m[r + 5] * hz)
    az = -(m[r + 2] * ax + m[r + 5] * ay) / m[r + 8]
    z = m[P.body + 2] + m[r + 6] * hx + m[r + 7] * hy + m[r + 8] * hz + az
    if z > m[P.obstacle + 3] or z < 0.0:
        return FAR, 1.0, 0.0
    ex = m[r] * ax + m[r + 3] * ay + m[r + 6] * az
    ey = m[r + 1] * ax + m[r + 4] * ay + m[r + 7] * az
    distance = math.sqrt(ex * ex + ey * ey)
    if distance < 1e-9:
        return 0.0, 1.0, 0.0
    return distance, ex / distance, ey / distance
