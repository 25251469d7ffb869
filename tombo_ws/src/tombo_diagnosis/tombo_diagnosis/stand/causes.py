"""Causes of a stand run: parameters with intervals, scores, and the gain on points held out."""

from __future__ import annotations

import math

import numpy as np

from tombo_diagnosis.diagnosis import Cause, Score
from tombo_diagnosis.engine import cause_estimates
from tombo_diagnosis.engine.cause_estimates import TWO_SIDED, fitted_parameters, gain_of, rms
from tombo_diagnosis.engine.model import Explanation, Hypothesis
from tombo_diagnosis.engine.model_selection import fit_hypotheses
from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.stand.analyse import StandAnalysis
from tombo_diagnosis.stand.problem import PROPELLER, SHARE, SPEED, StandProblem
from tombo_diagnosis.stand.tables.operating_points import UNITS
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS, STAND_EFFECTS
from tombo_flight.extended_model import FittedParameter, Gain
from tombo_logs.checks.spans import Mask


def _stochastic_parameters(
    problem: StandProblem, effect: str, width: float, explanation: Explanation
) -> tuple[FittedParameter, ...]:
    """Return the widths of a stochastic effect; the interval is what so few draws leave open."""
    count = {PROPELLER: problem.propellers, SPEED: problem.used}.get(effect, problem.runs)
    spread = math.exp(TWO_SIDED / math.sqrt(2.0 * max(count - 1, 1)))
    fitted = []
    # Thrust may differ from run to run and torque not: the draws say it, the common width not.
    drawn = explanation.fit.solution.mean[-2 * problem.runs :].reshape(2, -1)
    for j, p in enumerate(STAND_EFFECTS[effect].theta):
        healthy = problem.healthy[f"{effect}.{p.name}"]
        value = healthy * width
        if effect == SHARE:
            if j not in problem.points.measured:
                continue
            value = healthy * float(np.sqrt(np.mean(drawn[j] ** 2)))
        fitted.append(
            FittedParameter(p.name, p.unit, healthy, value, value / spread, value * spread)
        )
    return tuple(fitted)


def estimate_cause(effect: str, findings: StandAnalysis) -> Cause:
    """Return a cause with its parameters, from the most probable explanation that has it."""
    explanation = findings.search.explaining(effect)
    width = next(h.width for h in explanation.hypotheses if h.effect == effect)
    theta, covariance = (
        fitted_parameters(findings.problem, explanation, effect)
        if width is None
        else (_stochastic_parameters(findings.problem, effect, width, explanation), ())
    )
    confidence = findings.judgement.each.get(effect, 0.0)
    return Cause(effect, theta, confidence, STAND_EFFECTS[effect].signature, covariance)


def scores(findings: StandAnalysis, shares: dict[str, float]) -> tuple[Score, ...]:
    """Return all candidates, most probable first.

    `shares`: effect -> share of the excess that it removes in held-out data.
    """
    problem = findings.problem
    unknowns = problem.unknowns
    model = "plain" if problem.points.setup.plain else "tombo"
    absorbed = {unknowns.parameters[k].effect for k in unknowns.absorbed}

    def why_not(effect: str) -> str:
        if effect in absorbed:
            return "taken up by the fit of the nominal model to these data"
        if STAND_EFFECTS[effect].stochastic:
            return "needs three propellers, or runs of one propeller"
        return "far below the noise of these points, or its channel was not measured"

    effects = [name for name, effect in STAND_EFFECTS.items() if effect.suits(model)]
    return cause_estimates.scores(findings.search.single_log_bf, shares, effects, why_not)


def held_out(findings: StandAnalysis) -> tuple[list[Gain], dict[str, float]]:
    """Return the gain of every channel, and each effect's share of the excess that it removes.

    One configuration (else run, else fifth of the speeds) after the other is left out; the causes
    are fitted to the others and predict it. Parameters only: random draws can't be predicted.
    """
    problem, points = findings.problem, findings.problem.points
    single_log_bf = findings.search.single_log_bf
    hypotheses_of_best = tuple(w for w in findings.search.best.hypotheses if w.free)
    tried = {e: (Hypothesis(e, free),) for e in single_log_bf if (free := problem.identifiable(e))}
    before: dict[int, list[float]] = {c: [] for c in points.measured}
    after: dict[int, list[float]] = {c: [] for c in points.measured}
    removed = dict.fromkeys(tried, 0.0)
    unknowns = problem.unknowns
    absorbed = {unknowns.parameters[k].effect for k in unknowns.absorbed}
    whole = 0.0
    for out in points.blocks():
        rest = points.only(~out)
        if rest.count < 3 or not np.isfinite(rest.readings).any():
            continue
        part = StandProblem(rest, tuple(absorbed))

        def left(fit: Fit, part: StandProblem = part, out: Mask = out) -> Array:
            return np.asarray(problem.residual(part.final(fit))[out])

        base = left(part.null_hypothesis)
        best = left(fit_hypotheses(part, hypotheses_of_best).fit) if hypotheses_of_best else base
        for c in points.measured:
            seen = problem.seen[out, c]
            if seen.any():
                before[c].append(rms(base[seen, c]))
                after[c].append(rms(best[seen, c]))
        cost = _cost(problem, base, out)
        whole += max(cost - _cost(problem, best, out), 0.0) if hypotheses_of_best else cost
        for effect, hypotheses in tried.items():
            alone = left(fit_hypotheses(part, hypotheses).fit)
            removed[effect] += cost - _cost(problem, alone, out)
    gains = [
        gain_of(CHANNELS[c], UNITS[CHANNELS[c]], "held out", values, after[c])
        for c, values in before.items()
        if values
    ]
    shares = {
        e: float(np.clip(r / whole, 0.0, 1.0)) if whole > 0 else 0.0 for e, r in removed.items()
    }
    return gains, shares


def _cost(problem: StandProblem, left: Array, rows: Mask) -> float:
    return float(np.sum((left / problem.sigma[rows]) ** 2 * problem.seen[rows]))
