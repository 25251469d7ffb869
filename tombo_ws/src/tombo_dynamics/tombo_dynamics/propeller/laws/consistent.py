"""Law `consistent`: as `repaired`, but both equations have the same in-plane force.

The twist takes F_c tan(0.1418 - alpha), the force in the equation of alpha. The pull then fades as
the wing lags, the twist saturates, and there is no maximum of thrust below 18 000 rpm.
"""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled


@compiled
def in_plane_pull(alpha: float, lag_offset: float) -> tuple[float, float]:
    """Return the in-plane pull over F_c that twists the nodus, and its slope over alpha."""
    tangent = math.tan(lag_offset - alpha)
    return tangent, -1.0 - tangent * tangent
