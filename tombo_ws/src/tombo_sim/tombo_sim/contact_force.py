"""The force of a touch, from the plant's memory."""

from __future__ import annotations

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Array, P


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
