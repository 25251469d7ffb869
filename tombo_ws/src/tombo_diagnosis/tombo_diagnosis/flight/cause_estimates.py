"""What was named, in figures: parameters with intervals, from fits of every kind."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from tombo_diagnosis.diagnosis import Cause, Score
from tombo_diagnosis.flight.analyse import Findings
from tombo_diagnosis.flight.model_selection import SCATTER, Explanation
from tombo_diagnosis.flight.sensitivity import DRAW_SCALE_LABEL
from tombo_dynamics.effects import REGISTRY
from tombo_flight.extended_model import FittedParameter

_TWO_SIDED = 1.96
_MODEL = 0.015
"""Share of a change that is in doubt however well it is fitted: ticks, kernels, noise's shape."""


def estimate_cause(effect: str, findings: Findings, explanation: Explanation) -> Cause:
    """Return a cause with its parameters, from the fit of an explanation or of chance."""
    rows: dict[int, tuple[float, float]] = {}
    covariance: dict[tuple[int, int], float] = {}
    problem = findings.problem
    for hypothesis in explanation.hypotheses:
        if hypothesis.effect != effect or not hypothesis.free:
            continue
        places = problem.columns.places(hypothesis.free)
        spread = explanation.fit.solution.covariance
        for index, place in zip(hypothesis.free, places, strict=True):
            deviation = math.sqrt(max(float(spread[place, place]), 0.0))
            rows[index] = float(explanation.fit.theta[index]), deviation
        for a, place_a in zip(hypothesis.free, places, strict=True):
            for b, place_b in zip(hypothesis.free, places, strict=True):
                covariance[a, b] = float(spread[place_a, place_b])
    for fit in findings.scatter:
        if fit.effect == effect:
            for index, value, deviation in zip(fit.free, fit.value, fit.deviation, strict=True):
                rows[index] = value, deviation
                covariance[index, index] = deviation**2
    if effect == "gusts" and findings.gusts is not None:
        own = [p for p in problem.nominal.parameters if p.effect == "gusts"]
        found = {
            "deviation": (findings.gusts.deviation, findings.gusts.deviation_error),
            "time": (findings.gusts.time, findings.gusts.time_error),
        }
        for p in own:
            rows[p.index] = found[p.name]
            covariance[p.index, p.index] = found[p.name][1] ** 2
    if effect == SCATTER and not rows:
        return _scatter_cause(findings, explanation)
    theta = tuple(_fitted(findings, index, *row) for index, row in sorted(rows.items()))
    keys = sorted(rows)
    matrix = tuple(tuple(covariance.get((a, b), 0.0) for b in keys) for a in keys)
    each = findings.judgement.each
    return Cause(effect, theta, each.get(effect, 0.0), REGISTRY[effect].signature, matrix)


def _fitted(findings: Findings, index: int, value: float, deviation: float) -> FittedParameter:
    p = findings.problem.nominal.parameters[index]
    nominal = float(findings.problem.theta[index])
    # No simulation is exact: a change is not known better than its own small share.
    half = _TWO_SIDED * math.hypot(deviation, _MODEL * abs(value - nominal))
    low, high = max(value - half, p.low), min(value + half, p.high)
    return FittedParameter(p.name, p.unit, nominal, value, min(low, value), max(high, value))


def _scatter_cause(findings: Findings, explanation: Explanation) -> Cause:
    """Return the scatter of the draws: their root mean square, with a chi-square interval."""
    problem = findings.problem
    columns = problem.columns
    p = next(p for p in problem.nominal.parameters if p.label == DRAW_SCALE_LABEL)
    first = len(columns.indices)
    drawn = explanation.fit.solution.mean[first:]
    unit = max(float(problem.theta[p.index]), p.step)
    count = max(drawn.size, 1)
    value = min(unit * float(np.sqrt(np.mean(drawn**2))), p.high)
    low = value * math.sqrt(count / float(stats.chi2.ppf(0.975, count)))
    high = min(value * math.sqrt(count / float(stats.chi2.ppf(0.025, count))), p.high)
    nominal = float(problem.theta[p.index])
    theta = (FittedParameter(p.name, p.unit, nominal, value, low, high),)
    variance = ((high - low) / (2.0 * _TWO_SIDED)) ** 2
    each = findings.judgement.each
    return Cause(
        SCATTER, theta, each.get(SCATTER, 0.0), REGISTRY[SCATTER].signature, ((variance,),)
    )


def scores(findings: Findings, gains: dict[str, float]) -> tuple[Score, ...]:
    """Return all effects of the registry, likeliest first.

    Args:
        findings: what the analysis came to.
        gains: effect -> share of the excess that it removes in held-out flights.
    """
    evidence: dict[str, float] = dict(findings.search.single_log_bf)
    for fit in findings.all_noise_fits:
        evidence[fit.effect] = max(evidence.get(fit.effect, -math.inf), fit.evidence)
    if findings.gusts is not None:
        evidence["gusts"] = findings.gusts.evidence
    elif findings.problem.tracks and not findings.problem.nominal.calibrated:
        evidence.setdefault("gusts", 0.0)
    finite = {name: max(min(float(e), 700.0), -700.0) for name, e in evidence.items()}
    total = float(np.logaddexp.reduce([0.0, *(finite.values())]))
    absorbed = {label.split(".")[0] for label in findings.problem.nominal.fitted}
    result = []
    for name in REGISTRY:
        seen = name in finite
        remark = "" if seen else _why_not(name, name in absorbed)
        probability = math.exp(finite[name] - total) if seen else 0.0
        result.append(
            Score(name, gains.get(name, 0.0), finite.get(name, 0.0), probability, seen, remark)
        )
    return tuple(sorted(result, key=lambda s: (-s.excited, -s.evidence)))


def _why_not(effect: str, absorbed: bool) -> str:
    if absorbed:
        return "taken up by the fit of the nominal model to the same flights"
    if REGISTRY[effect].module.endswith(("contact", "strike")):
        return "nothing was touched in the spans that count"
    return "these flights have no channel that shows it"


def join_names(effects: Sequence[str], last: str = "and") -> str:
    """Return effects as people say them: a, b and c."""
    texts = [effect.replace("_", " ") for effect in effects]
    return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} {last} {texts[-1]}"
