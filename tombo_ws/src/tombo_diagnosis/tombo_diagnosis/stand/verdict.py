"""The verdict on stand data: none, named, set, unknown or partly explained, and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.flight.model_selection import LOG_BF_FIRST
from tombo_diagnosis.flight.verdict import LOG_BF_DISTINCT
from tombo_diagnosis.stand.model_selection import Explanation, SearchResult
from tombo_diagnosis.stand.problem import RUN, SHARE, Problem
from tombo_diagnosis.stand.residual_test import ResidualCurves, fit_residual_curves

LOG_BF_CURVES = 3.0
"""Log Bayes factor with which free curves say that something is left."""
_MIN_PARTIAL_SHARE = 0.7
"""Share of what free curves explain that a cause has to explain to be called part of it."""
_LOG_BF_OVER_CURVES, _LOG_BF_OVER_CURVES_EACH = 4.0, 6.0
"""Log Bayes factor by which a cause, and each further one, has to beat free curves alone: names
say more than a shape only if they say it with less."""
_STRONG_LOG_BF = 50.0
_FEW_SPEEDS, _FEW_SHARE = 4, 0.3
"""With fewer speeds than this only the priors' widths tell causes apart, and they must not: what
comes within this share of the best one's evidence is in the set."""
_MAX_PROBABILITY = 0.99
_CALIBRATION_NONE = ((0.0, 0.15), (0.7, 0.2), (0.88, 0.4), (0.97, 0.68), (0.99, 0.87))
"""Raw against calibrated probability that nothing is there: small causes stay unheard. Found on
blind cases of other seeds than those that are reported."""
_CALIBRATION_NAMED = ((0.0, 0.5), (0.8, 0.6), (0.9, 0.7), (0.97, 0.92), (0.99, 0.975))
"""The same of named causes and sets."""
_CALIBRATION_UNKNOWN = ((0.0, 0.45), (0.5, 0.6), (0.9, 0.9), (0.99, 0.99))
"""The same of unknown ones."""


@dataclass(frozen=True)
class Judgement:
    """The verdict and what it rests on."""

    verdict: str
    effects: tuple[str, ...]
    """Causes, likeliest first; of a set its members."""
    members: tuple[str, ...]
    """What the data can't tell apart."""
    confidence: float
    each: dict[str, float]
    """Confidence in each effect."""
    residual_curves: ResidualCurves
    """What free curves explain beside the causes."""
    curves_without_causes: ResidualCurves
    """What free curves explain without any cause."""


def judge(problem: Problem, found: SearchResult) -> Judgement:
    """Weigh what was found against each other and against free curves."""
    best = found.best
    residual_curves = fit_residual_curves(problem, best.fit)
    # A level for each run is what these effects of chance are: no rival of theirs.
    own = {RUN, SHARE} & set(best.effects)
    curves_without_causes = (
        fit_residual_curves(problem, problem.null_hypothesis, by_run=not own)
        if best.hypotheses
        else residual_curves
    )
    clean = residual_curves.evidence < LOG_BF_CURVES
    if best.hypotheses:
        ahead = _LOG_BF_OVER_CURVES + _LOG_BF_OVER_CURVES_EACH * (len(best.hypotheses) - 1)
        clean = clean and best.evidence > curves_without_causes.evidence + ahead
    p_unexplained = _clip_probability(
        1.0 / (1.0 + math.exp(-min(max(residual_curves.evidence - LOG_BF_CURVES, -50.0), 50.0)))
    )
    if not best.hypotheses:
        if clean:
            lead = max(found.single_log_bf.values(), default=0.0)
            p_none = 1.0 / (1.0 + math.exp(min(lead - LOG_BF_FIRST, 700.0)))
            return Judgement(
                "none",
                (),
                (),
                _calibrated(p_none, _CALIBRATION_NONE),
                {},
                residual_curves,
                curves_without_causes,
            )
        return Judgement(
            "unknown",
            (),
            (),
            _calibrated(p_unexplained, _CALIBRATION_UNKNOWN),
            {},
            residual_curves,
            curves_without_causes,
        )
    tells = LOG_BF_DISTINCT
    if _speeds(problem) < _FEW_SPEEDS:
        tells = max(LOG_BF_DISTINCT, _FEW_SHARE * best.evidence)
    alternatives = [
        r for r in found.alternatives if r.evidence > best.evidence - tells and r.hypotheses
    ]
    weights = [math.exp(r.evidence - best.evidence) for r in found.alternatives if r.hypotheses]
    p_best = 1.0 / (1.0 + sum(weights))
    p_cause = 1.0 - math.exp(-max(best.evidence - 0.5 * LOG_BF_FIRST, 0.0))
    members = _interchangeable_effects(best, alternatives)
    each = {
        e: _clip_probability(p_cause * (p_best if e in members else 1.0)) for e in best.effects
    }
    if not clean:
        partly = best.evidence > _MIN_PARTIAL_SHARE * (best.evidence + residual_curves.evidence)
        if best.evidence > _STRONG_LOG_BF and partly and len(best.hypotheses) == 1:
            return Judgement(
                "partly_explained",
                best.effects,
                (),
                p_unexplained,
                each,
                residual_curves,
                curves_without_causes,
            )
        return Judgement(
            "unknown",
            (),
            (),
            _calibrated(p_unexplained, _CALIBRATION_UNKNOWN),
            {},
            residual_curves,
            curves_without_causes,
        )
    if not members:
        return Judgement(
            "named",
            best.effects,
            (),
            _calibrated(p_cause * p_best, _CALIBRATION_NAMED),
            each,
            residual_curves,
            curves_without_causes,
        )
    for alternative in alternatives:
        odds = math.exp(alternative.evidence - best.evidence) * p_best
        for e in alternative.effects:
            if e in members and e not in best.effects:
                each[e] = max(each.get(e, 0.0), _clip_probability(p_cause * odds))
    certain = tuple(e for e in best.effects if e not in members)
    if certain:
        return Judgement(
            "named",
            certain,
            members,
            _calibrated(p_cause, _CALIBRATION_NAMED),
            each,
            residual_curves,
            curves_without_causes,
        )
    order = {e: k for k, e in enumerate(members)}
    ordered = tuple(sorted(members, key=lambda e: (-each.get(e, 0.0), order[e])))
    return Judgement(
        "set",
        ordered,
        members,
        _calibrated(p_cause, _CALIBRATION_NAMED),
        each,
        residual_curves,
        curves_without_causes,
    )


def _interchangeable_effects(
    best: Explanation, alternatives: list[Explanation]
) -> tuple[str, ...]:
    """Return the effects that stand in for each other in explanations that do as well."""
    if not alternatives:
        return ()
    every = [set(best.effects), *(set(r.effects) for r in alternatives)]
    shared = set.intersection(*every)
    ordered = [*best.effects, *(e for r in alternatives for e in r.effects)]
    return tuple(dict.fromkeys(e for e in ordered if e not in shared))


def _clip_probability(probability: float) -> float:
    return min(max(probability, 0.0), _MAX_PROBABILITY)


def _calibrated(probability: float, table: tuple[tuple[float, float], ...]) -> float:
    """Return the calibrated probability."""
    raw, true = zip(*table, strict=True)
    return _clip_probability(float(np.interp(probability, raw, true)))


def _speeds(problem: Problem) -> int:
    speed = problem.points.setup.speed
    turning = speed[problem.seen.any(axis=1) & (speed > 0.0)]
    return int(np.unique(np.round(50.0 * turning / max(float(speed.max()), 1e-9))).size)
