"""Claims about the laws: printed numbers, optima over speed, one curve for all, scatter."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import pairwise
from typing import Any

import numpy as np
from scipy import stats

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import configuration, nodus_moduli
from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.reproduce.claims.claim import (
    FAILS,
    HOLDS,
    OPEN,
    ClaimResult,
    holds_if,
    judges,
)
from tombo_propeller.reproduce.computed_values import LawNumbers, Numbers, Optimum
from tombo_propeller.reproduce.paper_values import Paper

EXACT = 1e-9
"""Differences below it are rounding errors."""
SAME_ANGLE_DEG = 0.1
"""No twist is printed at the optima; a figure shows no finer difference."""
READING_DEG = 0.5
"""A formula with smaller errors reads the angle right; estimated."""
CHANCE = 0.05
"""Significance level."""
DRAWS = 20_000
"""Drawn sets of measurements: a probability of 0.05 is then known to 0.002."""
STANDARD_ERRORS = 3.0
"""A slope this many standard errors from none is one."""


# --- Tables I and III


@judges
def table_1(paper: Paper, law: LawNumbers, numbers: Numbers) -> ClaimResult:
    """Judge the moduli of the nodus, Eq. 2."""
    pairs = [
        (printed, value)
        for conf, moduli in paper.table_1.items()
        for printed, value in zip(moduli, law.moduli[conf], strict=True)
    ]
    met = sum(printed.agrees(value) for printed, value in pairs)
    own = {c: nodus_moduli(configuration(c)).G_N_MPa for c in paper.table_1}
    by_ratio = numbers.shear_from_ratio
    texts = {
        "whole": len(pairs),
        "confs": len(paper.table_1),
        "fibre_shear": numbers.fibre_shear_MPa,
        "ours": sum(shear.agrees(own[c]) for c, (_, shear) in paper.table_1.items()),
        "theirs": sum(shear.agrees(by_ratio[c]) for c, (_, shear) in paper.table_1.items()),
    }
    return ClaimResult(met, holds_if(met == len(pairs)), texts)


@judges
def table_3_lift_over_drag(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge the simulated column of Table III."""
    met = sum(row.ratio.agrees(law.low[c].ratio) for c, row in paper.table_3.items())
    softest = min(paper.soft)
    texts = {
        "whole": len(paper.table_3),
        "softest": softest,
        "ratio": paper.table_3[softest].ratio,
    }
    each = {"found": law.low[softest].ratio}
    return ClaimResult(met, holds_if(met == len(paper.table_3)), texts, each)


@judges
def table_3_fibres(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge whether the propellers of Table III are those of Table I."""
    met = [c for c, row in paper.table_3.items() if row.ratio.agrees(law.table_1_ratio[c])]
    texts = {"whole": len(paper.table_3), "confs": ", ".join(map(str, met)) or "none"}
    return ClaimResult(len(met), holds_if(len(met) == len(paper.table_3)), texts)


@judges
def soft_lift_over_drag(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge whether soft propellers are more efficient."""
    gains = [100.0 * (law.low[c].ratio / law.low[0].ratio - 1.0) for c in paper.soft]
    better = sum(gain > 0.0 for gain in gains)
    texts, each = {"soft": len(gains)}, {"gain": max(gains)}
    return ClaimResult(better, holds_if(better == len(gains)), texts, each)


# --- Optima over speed


@judges
def universal_curve(_: Paper, law: LawNumbers, __: Numbers) -> ClaimResult:
    """Judge the theorem behind what is said to be the same for every configuration."""
    return ClaimResult(law.collapse, holds_if(law.collapse < EXACT), {"exact": EXACT})


@judges
def rigid_lift_over_drag(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge the lift over drag of the rigid propeller."""
    spread = law.rigid_ratio_spread
    texts = {"exact": EXACT, "ratio": paper.table_3[0].ratio}
    return ClaimResult(spread, holds_if(spread < EXACT), texts, {"found": law.low[0].ratio})


@judges
def hover(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge whether the nine propellers can carry the vehicle at all."""
    vehicle = VehicleParams()
    needed = vehicle.hover_thrust()
    weak = [c for c in paper.soft if law.thrust[c].value <= needed]
    texts, each = {"mass": vehicle.mass, "needed": needed}, {"weak": _listed(weak) or "none"}
    return ClaimResult(len(paper.soft) - len(weak), holds_if(not weak), texts, each)


@judges
def curves(_: Paper, law: LawNumbers, __: Numbers) -> ClaimResult:
    """Judge the curves of the figures, whose values are not printed."""
    return ClaimResult(law.thrust[3].value if law.thrust[3].inside else None, OPEN)


@judges
def eps_mld(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge the value of eps_mld."""
    printed = paper.number("model", "largest_lift_over_drag")
    values = [optimum.value for optimum in law.ratio.values()]
    farthest = max(values, key=lambda value: abs(value - printed.value))
    return ClaimResult(farthest, holds_if(printed.agrees(farthest)))


@judges
def eps_mld_same(paper: Paper, law: LawNumbers, numbers: Numbers) -> ClaimResult:
    """Judge whether eps_mld is one number for all."""
    digit = 2.0 * paper.number("model", "largest_lift_over_drag").half
    spread = _spread(law.ratio, "value")
    rising = [n for n, other in numbers.laws.items() if _spread(other.ratio, "value") is None]
    maxima = f"{', '.join(rising)}: still rising at 18 000 rpm" if rising else "all have a maximum"
    holds = holds_if(spread is not None and spread < digit)
    return ClaimResult(spread, holds, {"digit": digit, "maxima": maxima})


@judges
def gamma_mld(_: Paper, law: LawNumbers, __: Numbers) -> ClaimResult:
    """Judge whether the twist at maximum lift over drag is the same for every configuration."""
    return _same_twist(law.ratio)


@judges
def gamma_mtf(_: Paper, law: LawNumbers, __: Numbers) -> ClaimResult:
    """Judge whether the twist at maximum thrust is the same for every configuration."""
    return _same_twist(law.thrust)


def _same_twist(optima: Mapping[int, Optimum]) -> ClaimResult:
    """Judge whether all configurations have the same twist at their optima."""
    spread, text = _spread(optima, "gamma_deg"), "none"
    if spread is not None:
        twists = [optimum.gamma_deg for optimum in optima.values()]
        text = f"{min(twists):.2f}–{max(twists):.2f}°"
    holds = holds_if(spread is not None and spread < SAME_ANGLE_DEG)
    return ClaimResult(spread, holds, {"angle": SAME_ANGLE_DEG}, {"twist": text})


def _spread(optima: Mapping[int, Optimum], name: str) -> float | None:
    """Return the largest difference between configurations of a value at their optima.

    None: a configuration has no maximum within the law's range of speed.

    Args:
        optima: number of the configuration → its optimum.
        name: field of `Optimum`, in whose unit the difference is.
    """
    if not all(o.inside for o in optima.values()):
        return None
    values = [getattr(o, name) for o in optima.values()]
    return float(max(values) - min(values))


@judges
def omega_mtf_order(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge whether omega_mtf grows with stiffness."""
    optima = [law.thrust[int(c)] for c in paper.texts["model"]["ordered_configurations"]]
    speeds = [optimum.speed_rpm for optimum in optima]
    if not all(optimum.inside for optimum in optima):
        return ClaimResult(None, FAILS, {}, {"speeds": "no maximum up to 18 000 rpm"})
    step = min(b - a for a, b in pairwise(speeds))
    said = " < ".join(f"{speed:.0f}" for speed in speeds) + " rpm"
    return ClaimResult(step, holds_if(step > 0.0), {}, {"speeds": said})


# --- Thrust


def error_percent(paper: Paper, law: LawNumbers, conf: int) -> float:
    """Return how far computed thrust is from the measured one at 2000 rpm [%]."""
    return 100.0 * (law.low[conf].thrust_N / paper.table_3[conf].thrust_N.value - 1.0)


@judges
def thrust_error(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge the bound of 8 %, where the paper claims it."""
    bound = paper.number("model", "thrust_error_percent").value
    claimed = [int(c) for c in paper.texts["model"]["thrust_configurations"]]
    known = [c for c in claimed if c in paper.table_3]
    worst = max((error_percent(paper, law, c) for c in known), key=abs, default=None)
    speeds = " to ".join(paper.texts["model"]["thrust_speeds_rpm"])
    texts = {"speeds": speeds, "claimed": len(claimed), "known": _listed(known)}
    if worst is not None and abs(worst) >= bound:
        return ClaimResult(worst, FAILS, texts)
    open_yet = len(known) < len(claimed)
    return ClaimResult(worst, OPEN if open_yet else holds_if(worst is not None), texts)


@judges
def thrust_error_table_3(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge the same bound where thrusts are printed."""
    bound = paper.number("model", "thrust_error_percent").value
    errors = {c: error_percent(paper, law, c) for c in paper.soft}
    conf = max(errors, key=lambda c: abs(errors[c]))
    within = sum(abs(error) < bound for error in errors.values())
    said = f"{errors[conf]:+.1f} % (Conf. {conf}), {within} of {len(errors)} within"
    return ClaimResult(errors[conf], holds_if(abs(errors[conf]) < bound), {}, {"worst": said})


@judges
def centrifugal_stiffening(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge the paper's remark that the spinning propeller becomes stiff."""
    soft = [paper.table_3[c].thrust_N.value for c in paper.soft]
    loss = 100.0 * (1.0 - float(np.mean(soft)) / paper.table_3[0].thrust_N.value)
    low, high = paper.texts["model"]["thrust_speeds_rpm"]
    growth = law.high[13].gamma_deg / law.low[13].gamma_deg
    return ClaimResult(growth, OPEN, {"low": low, "high": high, "loss": loss})


@judges
def thrust_within_deviation(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge whether measured scatter can explain the differences."""
    deviations = {c: row.thrust_dev_N.value for c, row in paper.table_3.items()}
    away = {
        c: abs(law.low[c].thrust_N - row.thrust_N.value) / deviations[c]
        for c, row in paper.table_3.items()
    }
    conf = max(away, key=lambda c: away[c])
    chance = float(stats.chi2.sf(sum(a**2 for a in away.values()), len(away)))
    least, most = min(deviations.values()), max(deviations.values())
    texts = {"least": least, "most": most, "chance": CHANCE}
    return ClaimResult(
        chance, holds_if(chance > CHANCE), texts, {"worst": f"{away[conf]:.1f} (Conf. {conf})"}
    )


@judges
def better_than_mean(paper: Paper, law: LawNumbers, _: Numbers) -> ClaimResult:
    """Judge whether the model tells one propeller from another."""
    measured, deviation = _measured(paper)
    thrust = _computed(paper, law)
    drawn = draws(thrust, deviation)
    wins = 100.0 * float(np.mean(_rms(drawn - thrust) > _rms(_left_out(drawn) - drawn)))
    error, rms_mean = _rms(thrust - measured), float(_rms(_left_out(measured) - measured))
    texts = {"rms_mean": rms_mean, "mean": measured.mean(), "scatter": measured.std()}
    return ClaimResult(error, holds_if(error < rms_mean), texts, {"wins": wins})


@judges
def thrust_follows_stiffness(paper: Paper, law: LawNumbers, numbers: Numbers) -> ClaimResult:
    """Judge whether measured thrust grows with stiffness, as every law says."""
    measured, deviation = _measured(paper)
    stiffness = np.array([paper.table_1[c][1].value for c in paper.soft])
    rank = stats.spearmanr(stiffness, measured)
    rho, p = float(rank.statistic), float(rank.pvalue)
    thrust = _computed(paper, law)
    drawn = draws(thrust, deviation)
    chance = float(np.mean(_rank_correlations(stiffness, drawn) <= rho + 1e-9))
    slope, error = weighted_slope(thrust, measured, deviation)
    spans = [_computed(paper, other) for other in numbers.laws.values()]
    enough = min(float(span.std()) * span.size**0.5 for span in spans) / STANDARD_ERRORS
    seen = rho > 0.0 and p < CHANCE
    return ClaimResult(
        chance,
        HOLDS if seen else FAILS if chance < CHANCE else OPEN,
        {"chance": CHANCE, "rho": rho, "p": p, "error": error, "enough": enough},
        {"slope": slope},
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
    """Return thrusts of the soft propellers and their deviations [N]."""
    rows = [paper.table_3[c] for c in paper.soft]
    thrust = np.array([row.thrust_N.value for row in rows])
    return thrust, np.array([row.thrust_dev_N.value for row in rows])


def _computed(paper: Paper, law: LawNumbers) -> Array:
    """Return the thrusts of the soft propellers by a law [N], in the order of `_measured`."""
    return np.array([law.low[c].thrust_N for c in paper.soft])


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


# --- Deformation


@judges
def beta_reading(_: Paper, law: LawNumbers, __: Numbers) -> ClaimResult:
    """Judge the formula with which the paper reads the flap from pictures."""
    points = [p for by_conf in (law.low, law.high) for c, p in by_conf.items() if c]
    errors = [reading_deg(p.alpha_deg, p.beta_deg) - p.beta_deg for p in points]
    bias, flap = max(errors, key=abs), law.low[13]
    read = reading_deg(flap.alpha_deg, flap.beta_deg)
    texts = {"reading": READING_DEG, "beta": flap.beta_deg, "read": read}
    return ClaimResult(bias, holds_if(abs(bias) < READING_DEG), texts)


def reading_deg(alpha_deg: float, beta_deg: float) -> float:
    """Return the reading [deg] of the paper's formula for a wing with lag and flap."""
    joint = configuration(13).blade
    inner, length = joint.joint.outer_radius_m, joint.tip_radius_m - joint.joint.outer_radius_m
    alpha, beta = math.radians(alpha_deg), math.radians(beta_deg)
    seen = math.hypot(
        inner + length * math.cos(alpha) * math.cos(beta),
        length * math.sin(alpha) * math.cos(beta),
    )
    return math.degrees(math.acos(max(-1.0, min(1.0, (seen - inner) / length))))


def _listed(confs: list[int]) -> str:
    return ", ".join(map(str, confs))
