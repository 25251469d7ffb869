"""Law `repaired`: the published load model with its program's defects mended.

    beta  = K_b [T_w - W - F_c tan(beta - 0.1221)],   K_b = (r_N / x_c) L^2 / (2 E_N I_f)
    alpha = K_a [D_w + F_c tan(0.1418 - alpha)],      K_a = (x_c / r_N) L^2 / (2 E_N I_l)
    gamma = L / (G_N J) {[T_w - W - F_c tan(beta - 0.1221)] dy + [D_w + F_c tan(alpha)] dz}

In the twist, F_c pulls in plane with tan(alpha), as in the paper, where the equation of alpha has
tan(0.1418 - alpha). The thrust's maximum comes from this one term; see `consistent`.
"""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled


@compiled
def in_plane_pull(alpha: float, lag_offset: float) -> tuple[float, float]:
    """Return the in-plane pull over F_c that twists the nodus, and its slope over alpha."""
    tangent = math.tan(alpha)
    return tangent, 1.0 + tangent * tangent
