"""The causes in figures: parameters with their intervals, and the score of every candidate."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.diagnosis import Cause, Score
from tombo_diagnosis.stand.analyse import Findings
from tombo_diagnosis.stand.model_selection import Explanation, Hypothesis, fit_hypotheses
from tombo_diagnosis.stand.problem import SHARE, Problem
from tombo_dynamics.propeller.effects import STAND_EFFECTS
from tombo_flight.extended_model import FittedParameter

Array = NDArray[np.float64]

_WIDE = 1.96


def fitted(problem: Problem, explanation: Explanation, effect: str) -> tuple[FittedParameter, ...]:
    """Return an effect's parameters with 95 % intervals."""
    hypothesis = next(w for w in explanation.hypotheses if w.effect == effect)
    if not hypothesis.free:
        return _width(problem, hypothesis, explanation)
    theta = problem.final(explanation.fit)
    covariance = explanation.fit.solution.covariance
    found = []
    for k in hypothesis.free:
        p = problem.parameters[k]
        half = _WIDE * math.sqrt(max(float(covariance[k, k]), 0.0))
        value = float(theta[k])
        found.append(
            FittedParameter(
                p.name, p.unit, float(problem.nominal[k]), value,
                max(p.low, value - half), min(p.high, value + half),
            )
        )  # fmt: skip
    return tuple(found)


def _width(
    problem: Problem, hypothesis: Hypothesis, explanation: Explanation
) -> tuple[FittedParameter, ...]:
    """Return the widths of an effect of chance; the interval is what so few draws leave open."""
    counts = {
        "fabrication_scatter": problem.propellers,
        "tare_scatter": problem.runs,
        "run_scatter": problem.runs,
        "speed_noise": problem.used,
    }
    spread = math.exp(_WIDE / math.sqrt(2.0 * max(counts[hypothesis.effect] - 1, 1)))
    found = []
    # Thrust may differ from run to run and torque not: the draws say it, the common width not.
    drawn = explanation.fit.solution.mean[-2 * problem.runs :].reshape(2, -1)
    for j, p in enumerate(STAND_EFFECTS[hypothesis.effect].theta):
        healthy = problem.healthy[f"{hypothesis.effect}.{p.name}"]
        value = healthy * hypothesis.width
        if hypothesis.effect == SHARE:
            if j not in problem.points.measured:
                continue
            value = healthy * float(np.sqrt(np.mean(drawn[j] ** 2)))
        found.append(
            FittedParameter(p.name, p.unit, healthy, value, value / spread, value * spread)
        )
    return tuple(found)


def causes(findings: Findings) -> tuple[Cause, ...]:
    """Return the causes, or the members of a set, likeliest first."""
    problem, best = findings.problem, findings.search.best
    result = []
    for effect in findings.judgement.effects:
        own = best
        if effect not in best.effects:
            own = next(r for r in findings.search.alternatives if effect in r.effects)
        hypothesis = next(w for w in own.hypotheses if w.effect == effect)
        covariance = own.fit.solution.covariance[np.ix_(hypothesis.free, hypothesis.free)]
        result.append(
            Cause(
                effect,
                fitted(problem, own, effect),
                findings.judgement.each.get(effect, 0.0),
                STAND_EFFECTS[effect].signature,
                tuple(tuple(float(v) for v in row) for row in covariance),
            )
        )
    return tuple(result)


def scores(findings: Findings, shares: dict[str, float]) -> tuple[Score, ...]:
    """Return all candidates, likeliest first.

    Args:
        findings: the analysis.
        shares: effect -> share of the excess that it removes in held-out data.
    """
    problem, single_log_bf = findings.problem, findings.search.single_log_bf
    top = max([0.0, *single_log_bf.values()])
    weights = {e: math.exp(max(v - top, -700.0)) for e, v in single_log_bf.items()}
    total = sum(weights.values()) + math.exp(-top)
    model = "plain" if problem.points.setup.plain else "tombo"
    found = []
    for name, effect in STAND_EFFECTS.items():
        if model not in effect.models:
            continue
        remark = ""
        if name not in single_log_bf:
            remark = _why_not(problem, name)
        found.append(
            Score(
                name, shares.get(name, 0.0), single_log_bf.get(name, 0.0),
                weights.get(name, 0.0) / total, name in single_log_bf, remark,
            )
        )  # fmt: skip
    return tuple(sorted(found, key=lambda s: (-s.probability, -s.evidence)))


def _why_not(problem: Problem, name: str) -> str:
    places = [k for k, p in enumerate(problem.parameters) if p.effect == name]
    if any(k in problem.absorbed for k in places):
        return "taken up by the fit of the nominal model to these data"
    if STAND_EFFECTS[name].stochastic:
        return "needs three propellers, or runs of one propeller"
    return "far below the noise of these points, or its channel was not measured"


def alone(findings: Findings, effect: str) -> Explanation | None:
    """Return an effect as the only cause, fitted; None for one that these points can't show."""
    free = findings.problem.identifiable(effect)
    return fit_hypotheses(findings.problem, (Hypothesis(effect, free),)) if free else None
