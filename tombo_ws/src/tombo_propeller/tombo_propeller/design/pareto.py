"""Which of many designs are not beaten in everything by another one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array


def nondominated(costs: Array) -> NDArray[np.bool_]:
    """Return which rows no other row dominates.

    A row dominates another one if it is nowhere worse and somewhere better. Rows that are equal
    don't dominate each other; a row with a NaN is never in the set and dominates nothing.

    Args:
        costs: (n, k), less is better.
    """
    kept: NDArray[np.bool_] = np.asarray(np.isfinite(costs).all(axis=1))
    order = np.flatnonzero(kept)
    order = order[np.lexsort(costs[order].T[::-1])]
    front: Array = np.empty((0, costs.shape[1]))
    for row in order:  # whatever dominates a row comes before it in the order
        cost = costs[row]
        if ((front <= cost).all(axis=1) & (front < cost).any(axis=1)).any():
            kept[row] = False
        else:
            front = np.vstack([front, cost])
    return kept
