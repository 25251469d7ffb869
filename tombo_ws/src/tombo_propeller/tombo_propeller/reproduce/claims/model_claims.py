"""Claims about the model: the optima over speed, one curve for all, and printed scatter."""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import stats

from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    HOLDS,
    OPEN,
    ClaimOutcome,
    Verdict,
    by_law,
    joined,
    judge_of,
    judges,
    of_laws,
    per_law,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers, Optimum
from tombo_propeller.reproduce.paper_values import Paper

EXACT = 1e-9
SAME_ANGLE_DEG = 0.1
"""No twist is printed at the optima; a figure shows no finer difference."""
CHANCE = 0.05
"""Significance level."""
DRAWS = 20_000
STANDARD_ERRORS = 3.0
"""A slope this many standard errors from none is one."""


@judges
def universal_curve(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the theorem behind what is said to be the same for every configuration."""
    return of_laws(
        numbers,
        by_law(numbers, lambda law: law.collapse),
        lambda d: d < EXACT,
        "A theorem of the equations: one configuration measured at many speeds tests the model "
        "as well as thirteen.",
        exact=f"{EXACT:g}",
    )


@judges
def rigid_lift_over_drag(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the lift over drag of the rigid propeller."""
    ratio = by_law(numbers, lambda law: law.low[0].ratio)
    return of_laws(
        numbers,
        by_law(numbers, lambda law: law.rigid_ratio_spread),
        lambda d: d < EXACT,
        f"L/D = {per_law(ratio, '{:.4f}')} at every speed, by construction: C_L and C_D know no "
        "Reynolds number; not measured.",
        exact=f"{EXACT:g}",
        ratio=paper.table_3[0].ratio.text,
    )


@judges
def hover(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the nine propellers can carry the vehicle at all."""
    vehicle = VehicleParams()
    needed = vehicle.hover_thrust()
    soft = [c for c in paper.table_3 if c]
    short = {
        name: ", ".join(str(c) for c in soft if law.thrust[c].value <= needed) or "none"
        for name, law in numbers.laws.items()
    }
    return of_laws(
        numbers,
        by_law(numbers, lambda law: sum(law.thrust[c].value > needed for c in soft)),
        lambda n: n == len(soft),
        f"Too weak for {needed:.2f} N, Conf.: {joined(short)}; the paper flew Conf. 13 only, and "
        "nobody measured thrust above 3200 rpm.",
        mass=f"{vehicle.mass:g}",
        needed=f"{needed:.2f}",
    )


@judges
def curves(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the curves of the figures, whose values are not printed."""
    return of_laws(
        numbers,
        by_law(numbers, lambda law: law.thrust[3].value if law.thrust[3].inside else None),
        dict.fromkeys(numbers.laws, OPEN),
        "Recomputed and drawn, but none of their values is printed as a number.",
    )


@judges
def eps_mld(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge the value of eps_mld."""
    printed = paper.number("model", "largest_lift_over_drag")

    def farthest(law: LawNumbers) -> float:
        values = [o.value for o in law.ratio.values()]
        return max(values, key=lambda v: abs(v - printed.value))

    return of_laws(
        numbers,
        by_law(numbers, farthest),
        printed.agrees,
        "Most of the difference between the laws is drag weighted with cos(θ + γ), where Eq. 8 "
        "has cos(θ − γ).",
    )


@judges
def eps_mld_same(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether eps_mld is one number for all."""
    digit = 2.0 * paper.number("model", "largest_lift_over_drag").half
    rising = [n for n, law in numbers.laws.items() if _spread(law.ratio, "value") is None]
    maxima = "all have a maximum"
    if rising:
        maxima = f"{', '.join(rising)}: still rising at 18 000 rpm"
    return of_laws(
        numbers,
        by_law(numbers, lambda law: _spread(law.ratio, "value")),
        lambda d: d < digit,
        f"It must be so ({maxima}): without gravity the equations know only ω²/G_N.",
        digit=f"{digit:g}",
    )


@judges
def gamma_mld(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the twist at maximum lift over drag is the same for every configuration."""
    return _same_twist(numbers, "ratio")


@judges
def omega_mtf_order(paper: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether omega_mtf grows with stiffness."""
    confs = [int(c) for c in paper.texts["model"]["ordered_configurations"]]

    def rising(law: LawNumbers) -> float | None:
        speeds = [law.thrust[c].speed_rpm for c in confs]
        if not all(law.thrust[c].inside for c in confs):
            return None
        return min(b - a for a, b in pairwise(speeds))

    computed = by_law(numbers, rising)
    speeds = {
        name: "no maximum up to 18 000 rpm"
        if computed[name] is None
        else " < ".join(f"{law.thrust[c].speed_rpm:.0f}" for c in confs) + " rpm"
        for name, law in numbers.laws.items()
    }
    return of_laws(
        numbers,
        computed,
        lambda d: d > 0.0,
        f"{joined(speeds)}: that there is a maximum at all hangs on one disputed in-plane term of "
        "the twist.",
    )


@judges
def gamma_mtf(_: Paper, numbers: Numbers) -> ClaimOutcome:
    """Judge whether the twist at maximum thrust is the same for every configuration."""
    return _same_twist(numbers, "thrust")


def _same_twist(numbers: Numbers, which: str) -> ClaimOutcome:
    optima: dict[str, Mapping[int, Optimum]] = {
        name: getattr(law, which) for name, law in numbers.laws.items()
    }
    computed = {name: _spread(by_conf, "gamma_deg") for name, by_conf in optima.items()}
    values = {
        name: "none"
        if computed[name] is None
        else f"{min(o.gamma_deg for o in by_conf.values()):.2f}–"
        f"{max(o.gamma_deg for o in by_conf.values()):.2f}°"
        for name, by_conf in optima.items()
    }
    return of_laws(
        numbers,
        computed,
        lambda d: d < SAME_ANGLE_DEG,
        f"γ there: {joined(values)}; a theorem where there is a maximum, not an observation.",
        angle=f"{SAME_ANGLE_DEG:g}",
    )


def _spread(optima: Mapping[int, Optimum], name: str) -> float | None:
    """Return the largest difference between configurations, None unless all have a maximum."""
    if not all(o.inside for o in optima.values()):
        return None
    values = [getattr(o, name) for o in optima.values()]
    return float(max(values) - min(values))


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
    rank = stats.spearmanr(stiffness, measured)
    rho, p = float(rank.statistic), float(rank.pvalue)

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
