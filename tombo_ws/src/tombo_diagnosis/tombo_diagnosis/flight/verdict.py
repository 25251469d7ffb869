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
from tombo_diagnosis.flight.leftover import Leftover
from tombo_diagnosis.flight.naming import ADDS, MORE, Explanation, Search
from tombo_diagnosis.flight.nominal import Nominal
from tombo_diagnosis.flight.scatter import ScatterFit
from tombo_dynamics.effects import REGISTRY, Stage

GATE = 0.6
"""Excess (logarithm of a variance's ratio) up to which a remainder counts as chance."""
TELLS = 4.0
"""Log Bayes factor with which one cause is told from another."""
_ALIKE = 0.05
"""The same as a share of what is in dispute: so well does the model itself weigh strong causes."""
_REPEATS = 0.1
"""Share of a remainder that other flights may foretell if it is to be gusts."""
_CALIBRATED = 0.7
"""Share of the excess that causes have to explain where healthy flights are not known."""
_PARTLY = 0.85
"""Share of all excess that a cause has to take away to be called part of it."""
_STRONG = 50.0
_PUSHES = (Stage.WRENCH, Stage.AIR)
"""Effects that push the vehicle."""
_SUREST = 0.99
_NONE_SUREST, _NONE_SLOPE, _NONE_EVEN = 0.85, 1.3, 2.0
_LOUD_EVEN = 0.2
"""Confidence of `none` and `unknown`: fitted to what blind cases of other seeds came to."""
_MOST = 3
_FAR = 50.0


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


def best_scatter(fits: Sequence[ScatterFit]) -> list[ScatterFit]:
    """Return the effects of chance that earn their place, by their best way, likeliest first."""
    best: dict[str, ScatterFit] = {}
    for fit in fits:
        if fit.effect not in best or best[fit.effect].evidence < fit.evidence:
            best[fit.effect] = fit
    chosen = [fit for fit in best.values() if fit.evidence > ADDS]
    return sorted(chosen, key=lambda fit: -fit.evidence)


def judge(
    found: Search,
    noisy: Sequence[ScatterFit],
    gusts: GustFit | None,
    rest: Sequence[Leftover],
    repeats: float,
    explained: float,
    removed: float,
    nominal: Nominal,
) -> Judgement:
    """Weigh what was found.

    Args:
        found: the search for causes that have a mean.
        noisy: effects of chance that earn their place.
        gusts: the same of gusts, or None.
        rest: what is left over, gusts and noise taken into account.
        repeats: share of the forces' remainder that other flights foretell.
        explained: share of the excess that the best explanation takes away, in channels that it
            concerns.
        removed: the same over all channels.
        nominal: the model.
    """
    weights = dict.fromkeys(found.best.effects, found.best.evidence)
    for fit in noisy:
        weights[fit.effect] = max(weights.get(fit.effect, 0.0), fit.evidence)
    airy = gusts is not None and repeats < _REPEATS and not gusts.at_edge
    if airy and gusts is not None:
        weights["gusts"] = gusts.evidence
    weights = _earned(weights)
    excess = max((each.excess for each in rest), default=-math.inf)
    clean = excess <= GATE
    if nominal.calibrated:
        clean = explained > _CALIBRATED and repeats < 0.5
    kept = bool(found.best.effects) and all(e in weights for e in found.best.effects)
    rivals = [r for r in found.rivals if kept and _behind(r, found) < TELLS]
    effects = tuple(sorted(weights, key=lambda e: -weights[e]))[:_MOST]
    members = _members(found.best, rivals)
    lead = _lead(found)
    sure = 1.0 / (1.0 + sum(_odds(r, found) for r in found.rivals))
    real = _real(min(weights.values(), default=0.0))
    loud = _capped(max(_loud(excess), _real(gusts.evidence) if gusts and not airy else 0.0))
    if not weights:
        if clean and (gusts is None or airy):
            return Judgement("none", (), (), _calm(lead), {}, 0.0)
        return Judgement("unknown", (), (), loud, {}, 0.0)
    each = {e: _capped(real * (sure if e in members else 1.0)) for e in effects}
    if not clean or (gusts is not None and not airy):
        strong = found.best.evidence > _STRONG and len(effects) == 1
        if strong and (removed > _PARTLY if not nominal.calibrated else explained > 0.5):
            return Judgement("partly_explained", effects, (), loud, each, explained)
        return Judgement("unknown", (), (), loud, {}, explained)
    if airy and any(REGISTRY[e].stage in _PUSHES for e in effects if e != "gusts"):
        # A force that the named one only resembles leaves a remainder much like gusts.
        pushing = tuple(e for e in effects if e != "gusts")
        return Judgement("partly_explained", pushing, (), _capped(real), each, explained)
    if members:
        for rival in rivals:
            odds = _odds(rival, found) * sure
            for e in rival.effects:
                if e in members and e not in each:
                    each[e] = _capped(real * odds)
        certain = tuple(e for e in effects if e not in members)
        if certain:
            return Judgement("named", certain, members, _capped(real), each, explained)
        named = tuple(sorted(members, key=lambda e: -each.get(e, 0.0)))
        return Judgement("set", named, members, _capped(real), each, explained)
    return Judgement("named", effects, (), _capped(real * sure), each, explained)


def _earned(weights: dict[str, float]) -> dict[str, float]:
    """Return the causes that earn their place beside the strongest: two at once are rarer."""
    strongest = max(weights.values(), default=0.0)
    return {e: weight for e, weight in weights.items() if weight == strongest or weight > MORE}


def _members(best: Explanation, rivals: Sequence[Explanation]) -> tuple[str, ...]:
    """Return the effects that stand in for each other in explanations that do as well."""
    if not rivals:
        return ()
    every = [set(best.effects), *(set(r.effects) for r in rivals)]
    shared = set.intersection(*every)
    ordered = [*best.effects, *(e for r in rivals for e in r.effects)]
    return tuple(dict.fromkeys(e for e in ordered if e not in shared))


def _behind(rival: Explanation, found: Search) -> float:
    """Return how far a rival is behind the best: a log Bayes factor, less where much is at stake.

    Where a cause is strong, small errors of the model weigh more than noise does.
    """
    ahead = found.best.evidence - rival.evidence
    disputed = found.disputed(rival)
    return ahead / max(1.0, _ALIKE * disputed / TELLS) if math.isfinite(disputed) else ahead


def _odds(rival: Explanation, found: Search) -> float:
    """Return how likely a rival is against the best; of tangents it may look the likelier."""
    return math.exp(min(-_behind(rival, found), _FAR))


def _lead(found: Search) -> float:
    return max(found.singles.values(), default=0.0)


def _calm(lead: float) -> float:
    """Return how sure it is that nothing is wrong: small causes hide in healthy flights' noise."""
    return _NONE_SUREST / (1.0 + math.exp(min(_NONE_SLOPE * (lead - _NONE_EVEN), 700.0)))


def _loud(excess: float) -> float:
    """Return how sure it is that something is left over."""
    return 1.0 / (1.0 + math.exp(-3.0 * (excess - _LOUD_EVEN))) if math.isfinite(excess) else 0.5


def _real(evidence: float) -> float:
    """Return how sure it is that a cause of such evidence is no chance."""
    return 1.0 - math.exp(-max(evidence - 0.5 * ADDS, 0.0))


def _capped(probability: float) -> float:
    return min(max(probability, 0.0), _SUREST)
