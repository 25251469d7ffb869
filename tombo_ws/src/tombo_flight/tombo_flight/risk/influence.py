"""What decides: Sobol indices by SALib, on a polynomial that is fitted to the flights."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement
from typing import Any

import numpy as np
from scipy.special import ndtri

from tombo_dynamics.arrays import Array
from tombo_flight.risk.estimate import Sample

_DEGREES = (1, 2, 3)
_FOLDS = 10
_BASE = 1024
"""Points of the Sobol sequence; SALib evaluates (inputs + 2) times as many."""


def influence(keys: Sequence[str], sample: Sample) -> dict[str, Any] | None:
    """Return first-order and total indices of the margin, for inputs as given; None: no inputs.

    The degree of the polynomial is the one that predicts flights best that it was not fitted to;
    `r2` is the share of the margin's variance that it predicts of these. The rest comes from the
    flights' own draws (sensor noise, gusts, scatter) and from what no such polynomial shows.
    """
    if not keys:
        return None
    y, weights = sample.margins, np.sqrt(sample.weights)
    fits = []
    for degree in _DEGREES:
        x = _terms(sample.points, degree)
        if degree == 1 or x.shape[1] * _FOLDS <= y.size:
            fits.append((_r2(x, y, weights), degree))
    r2, degree = max(fits)
    found = {
        "of": "margin of a flight, inputs as given",
        "by": f"SALib, on a polynomial of degree {degree} in the normalised inputs",
        "r2": r2,
    }
    if r2 <= 0.0:
        return {**found, "indices": []}
    solution = _fit(_terms(sample.points, degree), y, weights)
    first, total = _indices(keys, lambda points: _terms(points, degree) @ solution)
    rows = [
        {"key": key, "first": float(a), "total": float(b)}
        for key, a, b in zip(keys, first, total, strict=True)
    ]
    return {**found, "indices": sorted(rows, key=lambda row: -row["total"])}


def _terms(points: Array, degree: int) -> Array:
    """Return all products of inputs up to a degree (N, terms)."""
    columns: list[Array] = [np.ones(len(points))]
    for order in range(1, degree + 1):
        for chosen in combinations_with_replacement(range(points.shape[1]), order):
            columns.append(points[:, chosen].prod(axis=1))
    return np.column_stack(columns)


def _fit(x: Array, y: Array, weights: Array) -> Array:
    solution: Any = np.linalg.lstsq(x * weights[:, None], y * weights, rcond=None)[0]
    return np.asarray(solution, dtype=np.float64)


def _r2(x: Array, y: Array, weights: Array) -> float:
    """Return the share of the variance that is predicted, by cross-validation."""
    fold = np.arange(y.size) % _FOLDS
    error = np.zeros(y.size)
    for one in range(_FOLDS):
        out = fold == one
        error[out] = y[out] - x[out] @ _fit(x[~out], y[~out], weights[~out])
    share = weights**2 / (weights**2).sum()
    variance = share @ (y - share @ y) ** 2
    return float(1.0 - share @ error**2 / variance) if variance > 0.0 else 0.0


def _indices(keys: Sequence[str], model: Any) -> tuple[Array, Array]:
    from SALib.analyze import sobol as analysis
    from SALib.sample import sobol as sampling

    problem = {"num_vars": len(keys), "names": list(keys), "bounds": [[0.0, 1.0]] * len(keys)}
    shares = sampling.sample(problem, _BASE, calc_second_order=False, seed=0)
    values = model(ndtri(np.clip(shares, 1e-9, 1.0 - 1e-9)))
    found = analysis.analyze(problem, values, calc_second_order=False, seed=0)
    return found["S1"], found["ST"]
