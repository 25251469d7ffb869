"""Least squares with an absolute penalty (lasso), by coordinate descent."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array

_CLOSE = 1e-7
_MOST_SWEEPS = 2000


def lasso(gram: Array, moment: Array, penalty: float, start: Array | None = None) -> Array:
    """Return c (K,) that minimises c' G c / 2 - b' c + penalty * sum of |c|.

    Args:
        gram: G = X' X (K, K); a column of zeros gets a coefficient of zero.
        moment: b = X' y (K,).
        penalty: in the unit of b; at the largest |b| or above all coefficients are zero.
        start: (K,) to begin with, as of a larger penalty.

    Friedman, Hastie and Tibshirani 2010, section 2.2.
    """
    c = np.zeros(moment.size) if start is None else start.copy()
    diagonal = np.diag(gram)
    slope = moment - gram @ c
    columns = np.flatnonzero(diagonal > 0.0)
    for sweep in range(_MOST_SWEEPS):
        largest = 0.0
        # Between full sweeps only what is not zero moves.
        for k in columns if sweep % 5 == 0 else np.flatnonzero(c):
            free = slope[k] + diagonal[k] * c[k]
            new = np.sign(free) * max(abs(free) - penalty, 0.0) / diagonal[k]
            step = new - c[k]
            if step:
                slope -= step * gram[:, k]
                c[k] = new
                largest = max(largest, abs(step) * np.sqrt(diagonal[k]))
        if largest < _CLOSE * (1.0 + float(np.abs(moment).max(initial=0.0))) and sweep % 5 == 0:
            break
    return c


def lasso_path(gram: Array, moment: Array, shares: Array, most: int) -> list[tuple[int, ...]]:
    """Return the supports at penalties that are these shares of the largest useful one.

    Columns are scaled to unit length first. Once a support has more than `most` terms, the last
    one that had not stands for the rest.
    """
    length = np.sqrt(np.maximum(np.diag(gram), 0.0))
    scale = np.where(length > 1e-9 * length.max(initial=0.0), length, np.inf)
    unit_gram, unit_moment = gram / np.outer(scale, scale), moment / scale
    largest = float(np.abs(unit_moment).max(initial=0.0))
    c: Array = np.zeros(moment.size)
    supports: list[tuple[int, ...]] = []
    full = False
    for share in shares:
        if not full:
            c = lasso(unit_gram, unit_moment, float(share) * largest, c)
            found = tuple(int(k) for k in np.flatnonzero(c))
            full = len(found) > most
        supports.append(supports[-1] if full and supports else () if full else found)
    return supports
