"""The verdict: none, named, set, unknown or partly explained, and how sure it is.

Two gates stand before a name: the cause must earn its place against the nominal model, and what it
leaves over must be what chance leaves. Without the second one a strong unknown force is nearly
always given somebody's name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from tombo_diagnosis.flight.gust_fit import GustFit
from tombo_diagnosis.flight.model_selection import (
    LOG_BF_ADDITIONAL,
    LOG_BF_FIRST,
    Explanation,
    SearchResult,
)
from tombo_diagnosis.flight.noise_statistics import NoiseFit
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.residual_test import ResidualExcess
from tombo_dynamics.effects import REGISTRY, Stage

MAX_LOG_VARIANCE_EXCESS = 0.6
"""Excess (logarithm of a variance's ratio) up to which a remainder counts as chance."""
LOG_BF_DISTINCT = 4.0
"""Log Bayes factor with which one cause is told from another."""
_MODEL_ERROR_SHARE = 0.05
"""The same as a share of what is in dispute: so well does the model itself weigh strong causes."""
_MAX_GUST_R2 = 0.1
"""Share of a remainder that other flights may foretell if it is to be gusts."""
_MIN_EXPLAINED_CALIBRATED = 0.7
"""Share of the excess that causes have to explain where healthy flights are not known."""
_MIN_PARTIAL_SHARE = 0.85
"""Share of all excess that a cause has to take away to be called part of it."""
_STRONG_LOG_BF = 50.0
_FORCE_STAGES = (Stage.WRENCH, Stage.AIR)
"""Effects that push the vehicle."""
_MAX_PROBABILITY = 0.99
_NONE_MAX_PROBABILITY, _NONE_SLOPE, _NONE_EVEN_LOG_BF = 0.85, 1.3, 2.0
_UNEXPLAINED_EVEN_EXCESS = 0.2
"""Confidence of `none` and `unknown`: fitted to what blind cases of other seeds came to."""
_MAX_CAUSES = 3
_MAX_EXPONENT = 50.0


@dataclass(frozen=True)
class Judgement:
    """The verdict and what it rests on."""

    verdict: str
    effects: tuple[str, ...]
    """Causes, likeliest first."""
    members: tuple[str, ...]
    """Of the set, where the data can't tell. Named causes beside it are sure: one of the set is at
    work besides."""
    confidence: float
    each: dict[str, float]
    """Confidence in each effect that was named or is in the set."""
    explained: float
    """Share of the excess that the causes explain."""


def select_noise_fits(fits: Sequence[NoiseFit]) -> list[NoiseFit]:
    """Return the effects of chance that earn their place, by their best way, likeliest first."""
    best: dict[str, NoiseFit] = {}
    for fit in fits:
        if fit.effect not in best or best[fit.effect].evidence < fit.evidence:
            best[fit.effect] = fit
    chosen = [fit for fit in best.values() if fit.evidence > LOG_BF_FIRST]
    return sorted(chosen, key=lambda fit: -fit.evidence)


def judge(
    found: SearchResult,
    noise_fits: Sequence[NoiseFit],
    gusts: GustFit | None,
    rest: Sequence[ResidualExcess],
    residual_r2: float,
    explained: float,
    removed: float,
    nominal: NominalModel,
) -> Judgement:
    """Weigh what was found.

    Args:
        found: the search for causes that have a mean.
        noise_fits: effects of chance that earn their place.
        gusts: the same of gusts, or None.
        rest: what is left over, gusts and noise taken into account.
        residual_r2: share of the forces' remainder that other flights foretell.
        explained: share of the excess that the best explanation takes away, in channels that it
            concerns.
        removed: the same over all channels.
        nominal: the model.
    """
    weights = dict.fromkeys(found.best.effects, found.best.evidence)
    for fit in noise_fits:
        weights[fit.effect] = max(weights.get(fit.effect, 0.0), fit.evidence)
    gusts_accepted = gusts is not None and residual_r2 < _MAX_GUST_R2 and not gusts.at_edge
    if gusts_accepted and gusts is not None:
        weights["gusts"] = gusts.evidence
    weights = _above_additional_threshold(weights)
    excess = max((each.excess for each in rest), default=-math.inf)
    clean = excess <= MAX_LOG_VARIANCE_EXCESS
    if nominal.calibrated:
        clean = explained > _MIN_EXPLAINED_CALIBRATED and residual_r2 < 0.5
    kept = bool(found.best.effects) and all(e in weights for e in found.best.effects)
    alternatives = [
        r for r in found.alternatives if kept and _log_bf_deficit(r, found) < LOG_BF_DISTINCT
    ]
    effects = tuple(sorted(weights, key=lambda e: -weights[e]))[:_MAX_CAUSES]
    members = _interchangeable_effects(found.best, alternatives)
    lead = _best_single_log_bf(found)
    p_best = 1.0 / (1.0 + sum(_relative_odds(r, found) for r in found.alternatives))
    p_cause = _p_cause(min(weights.values(), default=0.0))
    p_unexplained = _clip_probability(
        max(
            _p_unexplained(excess),
            _p_cause(gusts.evidence) if gusts and not gusts_accepted else 0.0,
        )
    )
    if not weights:
        if clean and (gusts is None or gusts_accepted):
            return Judgement("none", (), (), _p_none(lead), {}, 0.0)
        return Judgement("unknown", (), (), p_unexplained, {}, 0.0)
    each = {e: _clip_probability(p_cause * (p_best if e in members else 1.0)) for e in effects}
    if not clean or (gusts is not None and not gusts_accepted):
        strong = found.best.evidence > _STRONG_LOG_BF and len(effects) == 1
        if strong and (
            removed > _MIN_PARTIAL_SHARE if not nominal.calibrated else explained > 0.5
        ):
            return Judgement("partly_explained", effects, (), p_unexplained, each, explained)
        return Judgement("unknown", (), (), p_unexplained, {}, explained)
    if gusts_accepted and any(REGISTRY[e].stage in _FORCE_STAGES for e in effects if e != "gusts"):
        # A force that the named one only resembles leaves a remainder much like gusts.
        pushing = tuple(e for e in effects if e != "gusts")
        return Judgement(
            "partly_explained", pushing, (), _clip_probability(p_cause), each, explained
        )
    if members:
        for alternative in alternatives:
            odds = _relative_odds(alternative, found) * p_best
            for e in alternative.effects:
                if e in members and e not in each:
                    each[e] = _clip_probability(p_cause * odds)
        certain = tuple(e for e in effects if e not in members)
        if certain:
            return Judgement(
                "named", certain, members, _clip_probability(p_cause), each, explained
            )
        named = tuple(sorted(members, key=lambda e: -each.get(e, 0.0)))
        return Judgement("set", named, members, _clip_probability(p_cause), each, explained)
    return Judgement("named", effects, (), _clip_probability(p_cause * p_best), each, explained)


def _above_additional_threshold(weights: dict[str, float]) -> dict[str, float]:
    """Return the causes that earn their place beside the strongest: two at once are rarer."""
    strongest = max(weights.values(), default=0.0)
    return {
        e: weight
        for e, weight in weights.items()
        if weight == strongest or weight > LOG_BF_ADDITIONAL
    }


def _interchangeable_effects(
    best: Explanation, alternatives: Sequence[Explanation]
) -> tuple[str, ...]:
    """Return the effects that stand in for each other in explanations that do as well."""
    if not alternatives:
        return ()
    every = [set(best.effects), *(set(r.effects) for r in alternatives)]
    shared = set.intersection(*every)
    ordered = [*best.effects, *(e for r in alternatives for e in r.effects)]
    return tuple(dict.fromkeys(e for e in ordered if e not in shared))


def _log_bf_deficit(alternative: Explanation, found: SearchResult) -> float:
    """Return how far a rival is behind the best: a log Bayes factor, less where much is at stake.

    Where a cause is strong, small errors of the model weigh more than noise does.
    """
    ahead = found.best.evidence - alternative.evidence
    log_bf_of_difference = found.log_bf_of_difference(alternative)
    return (
        ahead / max(1.0, _MODEL_ERROR_SHARE * log_bf_of_difference / LOG_BF_DISTINCT)
        if math.isfinite(log_bf_of_difference)
        else ahead
    )


def _relative_odds(alternative: Explanation, found: SearchResult) -> float:
    """Return how likely a rival is against the best; of tangents it may look the likelier."""
    return math.exp(min(-_log_bf_deficit(alternative, found), _MAX_EXPONENT))


def _best_single_log_bf(found: SearchResult) -> float:
    return max(found.single_log_bf.values(), default=0.0)


def _p_none(lead: float) -> float:
    """Return how sure it is that nothing is wrong: small causes hide in healthy flights' noise."""
    return _NONE_MAX_PROBABILITY / (
        1.0 + math.exp(min(_NONE_SLOPE * (lead - _NONE_EVEN_LOG_BF), 700.0))
    )


def _p_unexplained(excess: float) -> float:
    """Return how sure it is that something is left over."""
    return (
        1.0 / (1.0 + math.exp(-3.0 * (excess - _UNEXPLAINED_EVEN_EXCESS)))
        if math.isfinite(excess)
        else 0.5
    )


def _p_cause(evidence: float) -> float:
    """Return how sure it is that a cause of such evidence is no chance."""
    return 1.0 - math.exp(-max(evidence - 0.5 * LOG_BF_FIRST, 0.0))


def _clip_probability(probability: float) -> float:
    return min(max(probability, 0.0), _MAX_PROBABILITY)
