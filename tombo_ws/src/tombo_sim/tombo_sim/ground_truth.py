"""What is true, from the plant's memory: pose and twist, and the force of a touch."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import P


@compiled
def contact_force(m: Array) -> tuple[float, float, float]:
    """Return the force on the vehicle in map [N]: of blade strikes, and of the frame's contact."""
    r, s, c = P.rotation, P.strike, P.contact
    x = m[r] * m[s] + m[r + 1] * m[s + 1] + m[r + 2] * m[s + 2]
    y = m[r + 3] * m[s] + m[r + 4] * m[s + 1] + m[r + 5] * m[s + 2]
    z = m[r + 6] * m[s] + m[r + 7] * m[s + 1] + m[r + 8] * m[s + 2]
    if m[c] > 0.0 and m[c + 1] < 0.0:
        return x + m[c + 2], y + m[c + 3], z + m[c + 4]
    return x, y, z


@compiled
def true_state(m: Array, out: Array) -> None:
    """Write position (3) and attitude (4) in map, velocity (3) and rates (3) in base_link."""
    r, b = P.rotation, P.body
    for i in range(3):
        out[i] = m[b + i]
        out[7 + i] = m[r + i] * m[b + 3] + m[r + 3 + i] * m[b + 4] + m[r + 6 + i] * m[b + 5]
        out[10 + i] = m[b + 10 + i]
    for i in range(4):
        out[3 + i] = m[b + 6 + i]
