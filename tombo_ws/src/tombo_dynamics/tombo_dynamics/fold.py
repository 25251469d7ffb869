"""The course of a folded propeller: how it straightens, and what thrust it gives meanwhile."""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled

_REACH = 0.9
"""The recovery time of Table III is read as the time until 90 % of the thrust is back."""
_RECOVERY_CONSTANTS = -math.log(1.0 - _REACH ** (1.0 / 3.0))
"""Recovery time in time constants of the fold: thrust goes with (1 - fold)^3."""


@compiled
def straightened(fold: float, recovery_time: float, step: float) -> float:
    """Return the folded share after `step` [s] of straightening; below 1e-4 it is none.

    Args:
        fold: folded share, 0 to 1.
        recovery_time: from folded until 90 % of the thrust is back [s].
        step: time passed [s].
    """
    left = max(0.0, 1.0 - _RECOVERY_CONSTANTS * step / max(recovery_time, 1e-3))
    return fold * left if fold > 1e-4 else 0.0


@compiled
def thrust_share(fold: float) -> float:
    """Return the thrust of a folded rotor over that of a straight one with the same command.

    Speed reaches 1 - f of the command, and thrust at that speed is 1 - f: (1 - f)^3.
    """
    straight = 1.0 - fold
    return straight * straight * straight
