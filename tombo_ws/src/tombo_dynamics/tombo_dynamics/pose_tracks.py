"""Whether positions are those of one body: two publishers on one topic make two tracks of it."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array

_BACK: Final = 5
"""Positions before the last one among which another of the same body is looked for: up to four
bodies that take turns."""
_STEP_M: Final = 0.02
"""m between bodies at least."""
_RETURNS: Final = 0.2
"""Distance to such a position over the step from the last one, at most: a body that goes on in
one direction is twice as far from the last but one."""
_FARTHEST_M: Final = 1e6
"""m: larger numbers are not positions."""
_SHARE: Final = 0.2
"""Share of the positions that return so, from which on they are of several bodies: a single wrong
pose, or a jump of the tracking, is one."""


def returning(position: Array) -> NDArray[np.bool_]:
    """Return which positions (N, 3), as they came in, leap back to where an earlier one was."""
    back = np.zeros(len(position), np.bool_)
    step = np.full(len(position), np.inf)
    step[1:] = np.linalg.norm(np.diff(position, axis=0), axis=1)
    for k in range(2, min(_BACK, len(position) - 1) + 1):
        near = np.linalg.norm(position[k:] - position[:-k], axis=1)
        back[k:] |= (near < _RETURNS * step[k:]) & (step[k:] > _STEP_M)
    return back


def bodies_apart(position: Array) -> float:
    """Return the usual distance of bodies that take turns in positions (N, 3) [m]; 0: one body."""
    with np.errstate(invalid="ignore"):
        position = position[(np.abs(position) < _FARTHEST_M).all(axis=1)]
    back = returning(position)
    if len(position) < 4 * _BACK or np.mean(back) < _SHARE:
        return 0.0
    rows = np.flatnonzero(back)
    return float(np.median(np.linalg.norm(position[rows] - position[rows - 1], axis=1)))
