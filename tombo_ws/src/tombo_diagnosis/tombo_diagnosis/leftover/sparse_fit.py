"""A sparse fit of terms to a leftover: chosen on flights held out, with intervals.

The lasso's path proposes; cross-validation over flights picks the sparsest support within one
standard error of the best; each of its terms gives way to one that fits better in its place; a
term stays if its interval and its share of the leftover call for it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
            support = tuple(int(k) for k in np.flatnonzero(c))
            full = len(support) > most
        supports.append(supports[-1] if full and supports else () if full else support)
    return supports


_SHARES = np.concatenate([[1.0], np.geomspace(0.9, 0.02, 24)])
"""Penalties of the path, of the largest useful one; the first chooses nothing."""
_MOST_TERMS = 8
_LEAST_SIGMAS = 4.0
"""Standard errors that a coefficient is from zero: no term of sixty is there by chance."""
_LEAST_SHARE = 0.02
"""Share of the leftover that a term removes, beside the others."""
_MOST_EXCHANGES, _LEAST_EXCHANGE = 10, 1e-3
_RIDGE = 1e-9
_TWO_SIDED = 1.96


@dataclass(frozen=True)
class Rows:
    """The equations of one flight, each row weighed to unit noise."""

    design: Array
    """(N, K) of the terms."""
    target: Array
    """(N,)"""
    block: NDArray[np.int64]
    """(N,) rows of one block of time are correlated."""

    @property
    def gram(self) -> Array:
        """X' X."""
        return np.asarray(self.design.T @ self.design)

    @property
    def moment(self) -> Array:
        """X' y."""
        return np.asarray(self.design.T @ self.target)


@dataclass(frozen=True)
class SparseFit:
    """What the terms chosen come to."""

    chosen: tuple[int, ...]
    """Places in the dictionary; empty: nothing that other flights confirm."""
    value: Array
    deviation: Array
    """Standard errors, rows of a block correlated."""
    r2: float
    """Cross-validated: share of the leftover that fits of the other flights predict."""


def without_tolerances(design: Array, target: Array, nuisance: Array) -> tuple[Array, Array]:
    """Return design (N, K) and target (N,) with tolerances made as unlikely as noise.

    `nuisance` (N, U): what one deviation of each tolerance changes, in deviations of noise. The
    result has unit noise again: both are multiplied by (1 + T T')^(-1/2).
    """
    u, s, _ = np.linalg.svd(nuisance, full_matrices=False)
    less = 1.0 - 1.0 / np.sqrt(1.0 + s**2)
    both = np.column_stack([design, target])
    both = both - u @ (less[:, None] * (u.T @ both))
    return both[:, :-1], both[:, -1]


def sparse_fit(flights: Sequence[Rows], partners: Sequence[tuple[int, ...]]) -> SparseFit:
    """Choose terms and fit them.

    Args:
        flights: two or more; each is held out in turn.
        partners: of each term the terms that are fitted with it.
    """
    grams = [rows.gram for rows in flights]
    moments = [rows.moment for rows in flights]
    squares = np.array([float(rows.target @ rows.target) for rows in flights])
    gram, moment = _sums(flights)
    nothing = SparseFit((), np.zeros(0), np.zeros(0), 0.0)
    if len(flights) < 2 or not squares.sum() > 0.0:
        return nothing
    errors = np.empty((len(flights), len(_SHARES)))
    for f, rows in enumerate(flights):
        others = gram - grams[f], moment - moments[f]
        for j, support in enumerate(lasso_path(*others, _SHARES, _MOST_TERMS)):
            c = _solved(*others, with_partners(support, partners))
            errors[f, j] = _error(rows, c)
    step = _one_standard_error(errors)
    if step == 0:
        return nothing
    support = _kept(_best_support(gram, moment, step, partners), flights, partners)
    left = 0.0
    for f, rows in enumerate(flights):
        others = gram - grams[f], moment - moments[f]
        of_others = _best_support(*others, step, partners)
        left += _error(rows, _solved(*others, with_partners(of_others, partners)))
    r2 = 1.0 - left / float(squares.sum())
    if not support or r2 <= 0.0:
        return nothing
    chosen = with_partners(support, partners)
    return SparseFit(chosen, *_with_errors(flights, chosen), r2)


def _best_support(
    gram: Array, moment: Array, step: int, partners: Sequence[tuple[int, ...]]
) -> tuple[int, ...]:
    """Return the path's support at a step, each term exchanged while another fits better.

    Of terms that resemble each other the lasso takes the one that alone fits best.
    """
    support = lasso_path(gram, moment, _SHARES, _MOST_TERMS)[step]

    def removed(terms: tuple[int, ...]) -> float:
        return float(moment @ _solved(gram, moment, with_partners(terms, partners)))

    best = removed(support)
    for _ in range(_MOST_EXCHANGES):
        tried = [
            (removed(other), other)
            for i in range(len(support))
            for k in range(moment.size)
            if k not in support
            for other in ((*support[:i], k, *support[i + 1 :]),)
        ]
        error, other = max(tried, default=(best, support))
        if error <= best * (1.0 + _LEAST_EXCHANGE):
            break
        best, support = error, other
    return support


def _sums(flights: Sequence[Rows]) -> tuple[Array, Array]:
    """Return X' X and X' y of all flights."""
    return (
        np.sum([rows.gram for rows in flights], axis=0),
        np.sum([rows.moment for rows in flights], axis=0),
    )


def with_partners(support: Sequence[int], partners: Sequence[tuple[int, ...]]) -> tuple[int, ...]:
    """Return terms and what is fitted with them, in the order of the dictionary."""
    return tuple(sorted({*support, *(p for k in support for p in partners[k])}))


def _solved(gram: Array, moment: Array, support: Sequence[int]) -> Array:
    """Return the coefficients (K,) of least squares on a support."""
    c = np.zeros(moment.size)
    if support:
        places = list(support)
        part = gram[np.ix_(places, places)]
        ridge = _RIDGE * np.diag(np.maximum(np.diag(part), 1e-12))
        c[places] = np.linalg.solve(part + ridge, moment[places])
    return c


def _error(rows: Rows, c: Array) -> float:
    return float(np.sum((rows.target - rows.design @ c) ** 2))


def _one_standard_error(errors: Array) -> int:
    """Return the largest penalty whose error exceeds the best by no more than chance may."""
    best = int(np.argmin(errors.sum(axis=0)))
    over = errors - errors[:, best : best + 1]
    chance = over.std(axis=0, ddof=1) / np.sqrt(len(errors))
    return int(np.flatnonzero(over.mean(axis=0) <= chance)[0])


def _kept(
    support: tuple[int, ...], flights: Sequence[Rows], partners: Sequence[tuple[int, ...]]
) -> tuple[int, ...]:
    """Return the terms that are needed beside the others, the least needed dropped first."""
    gram, moment = _sums(flights)
    square = sum(float(r.target @ r.target) for r in flights)

    def removed(terms: tuple[int, ...]) -> float:
        return float(moment @ _solved(gram, moment, with_partners(terms, partners))) / square

    while support:
        chosen = with_partners(support, partners)
        value, deviation = _with_errors(flights, chosen)
        sigmas = dict(zip(chosen, np.abs(value) / deviation, strict=True))
        whole = removed(support)
        needed = {
            k: min(
                sigmas[k] / _LEAST_SIGMAS,
                (whole - removed(tuple(i for i in support if i != k))) / _LEAST_SHARE,
            )
            for k in support
        }
        least = min(needed, key=lambda k: needed[k])
        if needed[least] >= 1.0:
            break
        support = tuple(k for k in support if k != least)
    return support


def _with_errors(flights: Sequence[Rows], chosen: tuple[int, ...]) -> tuple[Array, Array]:
    """Return coefficients and standard errors.

    Rows of one block of time are one sample. Where flights differ by more (jackknife), that
    counts.
    """
    places = list(chosen)
    gram, moment = _sums(flights)
    c = _solved(gram, moment, chosen)
    inverse = np.linalg.pinv(gram[np.ix_(places, places)], hermitian=True)
    meat = np.zeros((len(places), len(places)))
    blocks = 0
    for rows in flights:
        scores = rows.design[:, places] * (rows.target - rows.design @ c)[:, None]
        sums = np.zeros((int(rows.block.max()) + 1, len(places)))
        np.add.at(sums, rows.block, scores)
        meat += sums.T @ sums
        blocks += len(np.unique(rows.block))
    few = blocks / max(blocks - len(places), 1)
    spread = np.diag(few * inverse @ meat @ inverse)
    without = np.array(
        [_solved(gram - r.gram, moment - r.moment, chosen)[places] for r in flights]
    )
    jackknife = (len(flights) - 1) * without.var(axis=0)
    return c[places], np.sqrt(np.maximum(np.maximum(spread, jackknife), 1e-30))


def interval_of(fit: SparseFit) -> tuple[Array, Array]:
    """Return the ends of the 95 % intervals."""
    return fit.value - _TWO_SIDED * fit.deviation, fit.value + _TWO_SIDED * fit.deviation
