"""Causes of a stand run: parameters with intervals, and the score of every candidate."""

from __future__ import annotations

import math

import numpy as np

from tombo_diagnosis.diagnosis import Cause, Score
from tombo_diagnosis.engine import cause_estimates
from tombo_diagnosis.engine.cause_estimates import TWO_SIDED, Estimate, fitted_parameters
from tombo_diagnosis.engine.model import Explanation
from tombo_diagnosis.stand.analyse import StandFindings
from tombo_diagnosis.stand.problem import PROPELLER, SHARE, SPEED, StandProblem
from tombo_dynamics.propeller.effects import STAND_EFFECTS
from tombo_flight.extended_model import FittedParameter


def fitted(problem: StandProblem, explanation: Explanation, effect: str) -> Estimate:
    """Return an effect's parameters with 95 % intervals, and their covariance."""
    hypothesis = next(h for h in explanation.hypotheses if h.effect == effect)
    if hypothesis.width is not None:
        return _widths(problem, effect, hypothesis.width, explanation), ()
    return fitted_parameters(problem, explanation, effect)


def _widths(
    problem: StandProblem, effect: str, width: float, explanation: Explanation
) -> tuple[FittedParameter, ...]:
    """Return the widths of a stochastic effect; the interval is what so few draws leave open."""
    count = {PROPELLER: problem.propellers, SPEED: problem.used}.get(effect, problem.runs)
    spread = math.exp(TWO_SIDED / math.sqrt(2.0 * max(count - 1, 1)))
    found = []
    # Thrust may differ from run to run and torque not: the draws say it, the common width not.
    drawn = explanation.fit.solution.mean[-2 * problem.runs :].reshape(2, -1)
    for j, p in enumerate(STAND_EFFECTS[effect].theta):
        healthy = problem.healthy[f"{effect}.{p.name}"]
        value = healthy * width
        if effect == SHARE:
            if j not in problem.points.measured:
                continue
            value = healthy * float(np.sqrt(np.mean(drawn[j] ** 2)))
        found.append(
            FittedParameter(p.name, p.unit, healthy, value, value / spread, value * spread)
        )
    return tuple(found)


def estimate_cause(effect: str, findings: StandFindings) -> Cause:
    """Return a cause with its parameters, from the most probable explanation that has it."""
    explanation = findings.search.explaining(effect)
    theta, covariance = fitted(findings.problem, explanation, effect)
    confidence = findings.judgement.each.get(effect, 0.0)
    return Cause(effect, theta, confidence, STAND_EFFECTS[effect].signature, covariance)


def scores(findings: StandFindings, shares: dict[str, float]) -> tuple[Score, ...]:
    """Return all candidates, most probable first.

    `shares`: effect -> share of the excess that it removes in held-out data.
    """
    problem = findings.problem
    columns = problem.columns
    model = "plain" if problem.points.setup.plain else "tombo"
    absorbed = {columns.parameters[k].effect for k in columns.absorbed}

    def why_not(effect: str) -> str:
        if effect in absorbed:
            return "taken up by the fit of the nominal model to these data"
        if STAND_EFFECTS[effect].stochastic:
            return "needs three propellers, or runs of one propeller"
        return "far below the noise of these points, or its channel was not measured"

    effects = [name for name, effect in STAND_EFFECTS.items() if effect.suits(model)]
    return cause_estimates.scores(findings.search.single_log_bf, shares, effects, why_not)
