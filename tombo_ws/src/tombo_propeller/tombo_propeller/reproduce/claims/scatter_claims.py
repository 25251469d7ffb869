"""Claims about the model that depend on the printed scatter of Table III's thrusts."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import stats

from tombo_dynamics.arrays import Array
from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    HOLDS,
    OPEN,
    ClaimOutcome,
    Verdict,
    by_law,
    judge_of,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers
from tombo_propeller.reproduce.paper_values import Paper

CHANCE = 0.05
"""Significance level."""
DRAWS = 20_000
STANDARD_ERRORS = 3.0
"""A slope this many standard errors from none is one."""


@judges
def thrust_within_deviation(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether measured scatter can explain the differences."""
    devs = [row.thrust_dev_N.value for row in paper.table_3.values()]

    def away(law: LawNumbers, conf: int) -> float:
        row = paper.table_3[conf]
        return abs(law.low[conf].thrust_N - row.thrust_N.value) / row.thrust_dev_N.value

    def chance(law: LawNumbers) -> float:
        squares = sum(away(law, c) ** 2 for c in paper.table_3)
        return float(stats.chi2.sf(squares, len(paper.table_3)))

    def worst(law: LawNumbers) -> str:
        conf = max(paper.table_3, key=lambda c: away(law, c))
        return f"{away(law, conf):.1f} (Conf. {conf})"

    where = ", ".join(f"{name} {worst(law)}" for name, law in numbers.laws.items())
    return of_laws(
        numbers,
        by_law(numbers, chance),
        lambda p: p > CHANCE,
        f"Farthest off, in deviations: {where}.",
        least=f"{min(devs):g}",
        most=f"{max(devs):g}",
        chance=f"{CHANCE:g}",
    )


@judges
def better_than_mean(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the model tells one propeller from another."""
    measured, deviation = _measured(paper)
    rms_mean = float(_rms(_left_out(measured) - measured))

    def by_chance(law: LawNumbers) -> float:
        thrust = _computed(paper, law)
        drawn = draws(thrust, deviation)
        return 100.0 * float(np.mean(_rms(drawn - thrust) > _rms(_left_out(drawn) - drawn)))

    chance = by_law(numbers, by_chance)
    return of_laws(
        numbers,
        by_law(numbers, lambda law: _rms(_computed(paper, law) - measured)),
        lambda e: e < rms_mean,
        f"The mean of the other eight errs by {rms_mean:.3f} N (their own mean, "
        f"{measured.mean():.3f} N, by {float(measured.std()):.3f} N); were the law true, the "
        f"printed scatter would still let the mean win in {per_law(chance, '{:.0f} %')}.",
        rms_mean=f"{rms_mean:.4f}",
    )


@judges
def thrust_follows_stiffness(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether measured thrust grows with stiffness, as every law says."""
    measured, deviation = _measured(paper)
    stiffness = np.array([paper.table_1[c][1].value for c in paper.table_3 if c])
    found = stats.spearmanr(stiffness, measured)
    rho, p = float(found.statistic), float(found.pvalue)

    def as_low(law: LawNumbers) -> float:
        drawn = draws(_computed(paper, law), deviation)
        return float(np.mean(_rank_correlations(stiffness, drawn) <= rho + 1e-9))

    def slope(law: LawNumbers) -> tuple[float, float]:
        return weighted_slope(_computed(paper, law), measured, deviation)

    def verdict(chance: float | None) -> Verdict:
        if rho > 0.0 and p < CHANCE:
            return HOLDS
        return FAILS if chance is not None and chance < CHANCE else OPEN

    computed, judge = by_law(numbers, as_low), judge_of(numbers)
    spans = [_computed(paper, law) for law in numbers.laws.values()]
    enough = min(float(span.std()) * span.size**0.5 for span in spans) / STANDARD_ERRORS
    slopes = per_law(by_law(numbers, lambda law: slope(law)[0]), "{:.1f}")
    return of_laws(
        numbers,
        computed,
        {law: verdict(chance) for law, chance in computed.items()},
        f"No order is seen (Spearman's ρ = {rho:.2f}, p = {p:.2f}), but the printed deviations "
        f"could hide it: the slope of measured on computed thrust is {slopes} (± "
        f"{slope(numbers.laws[judge])[1]:.1f} under law {judge}), where the law has 1; thrusts "
        f"known to {enough:.3f} N would show it.",
        chance=f"{CHANCE:g}",
    )


def draws(thrust: Array, deviation: Array) -> Array:
    """Return `DRAWS` measurements of thrusts with normal scatter, (DRAWS, n); always the same."""
    noise = np.random.default_rng(0).standard_normal((DRAWS, thrust.size))
    return np.asarray(thrust + deviation * noise)


def weighted_slope(x: Array, y: Array, deviation: Array) -> tuple[float, float]:
    """Return the slope of y on x and its standard error, weighted by the deviations of y."""
    weights = deviation**-2.0
    apart = x - np.average(x, weights=weights)
    square = float(np.sum(weights * apart**2))
    return float(np.sum(weights * apart * y)) / square, square**-0.5


def _measured(paper: Paper) -> tuple[Array, Array]:
    rows = [row for conf, row in paper.table_3.items() if conf]
    return (
        np.array([row.thrust_N.value for row in rows]),
        np.array([row.thrust_dev_N.value for row in rows]),
    )


def _computed(paper: Paper, law: LawNumbers) -> Array:
    return np.array([law.low[conf].thrust_N for conf in paper.table_3 if conf])


def _left_out(values: Array) -> Array:
    """Return the mean of the others for each of the last axis."""
    return np.asarray((values.sum(-1, keepdims=True) - values) / (values.shape[-1] - 1))


def _rms(errors: Array) -> Any:
    return np.sqrt(np.mean(errors**2, axis=-1))


def _rank_correlations(x: Array, rows: Array) -> Array:
    """Return Spearman's rho of x with each row; no ties."""
    ranks = stats.rankdata(rows, axis=-1) - stats.rankdata(x)
    n = x.size
    return np.asarray(1.0 - 6.0 * np.sum(ranks**2, axis=-1) / (n * (n * n - 1.0)))
