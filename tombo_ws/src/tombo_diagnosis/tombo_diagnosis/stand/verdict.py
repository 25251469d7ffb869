"""The verdict on stand data: none, named, set, unknown or partly explained, and how sure it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.flight.naming import ADDS
from tombo_diagnosis.flight.verdict import TELLS
from tombo_diagnosis.stand.leftover import Curves, curves
from tombo_diagnosis.stand.problem import RUN, SHARE, Problem
from tombo_diagnosis.stand.search import Explanation, Search

LEFT = 3.0
"""Log Bayes factor with which free curves say that something is left."""
_PARTLY = 0.7
"""Share of what free curves explain that a cause has to explain to be called part of it."""
_AHEAD, _AHEAD_MORE = 4.0, 6.0
"""Log Bayes factor by which a cause, and each further one, has to beat free curves alone: names
say more than a shape only if they say it with less."""
_STRONG = 50.0
_FEW_SPEEDS, _FEW_SHARE = 4, 0.3
"""With fewer speeds than this only the priors' widths tell causes apart, and they must not: what
comes within this share of the best one's evidence is in the set."""
_SUREST = 0.99
_HEARD = ((0.0, 0.15), (0.7, 0.2), (0.88, 0.4), (0.97, 0.68), (0.99, 0.87))
"""Raw against calibrated probability that nothing is there: small causes stay unheard. Found on
blind cases of other seeds than those that are reported."""
_DRAWN = ((0.0, 0.5), (0.8, 0.6), (0.9, 0.7), (0.97, 0.92), (0.99, 0.975))
"""The same of named causes and sets."""
_STRANGE = ((0.0, 0.45), (0.5, 0.6), (0.9, 0.9), (0.99, 0.99))
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
    left: Curves
    """What free curves explain beside the causes."""
    free: Curves
    """What free curves explain without any cause."""


def judge(problem: Problem, found: Search) -> Judgement:
    """Weigh what was found against each other and against free curves."""
    best = found.best
    left = curves(problem, best.fit)
    # A level for each run is what these effects of chance are: no rival of theirs.
    own = {RUN, SHARE} & set(best.effects)
    free = curves(problem, problem.nothing, by_run=not own) if best.ways else left
    clean = left.evidence < LEFT
    if best.ways:
        ahead = _AHEAD + _AHEAD_MORE * (len(best.ways) - 1)
        clean = clean and best.evidence > free.evidence + ahead
    loud = _capped(1.0 / (1.0 + math.exp(-min(max(left.evidence - LEFT, -50.0), 50.0))))
    if not best.ways:
        if clean:
            lead = max(found.singles.values(), default=0.0)
            calm = 1.0 / (1.0 + math.exp(min(lead - ADDS, 700.0)))
            return Judgement("none", (), (), _heard(calm, _HEARD), {}, left, free)
        return Judgement("unknown", (), (), _heard(loud, _STRANGE), {}, left, free)
    tells = TELLS
    if _speeds(problem) < _FEW_SPEEDS:
        tells = max(TELLS, _FEW_SHARE * best.evidence)
    rivals = [r for r in found.rivals if r.evidence > best.evidence - tells and r.ways]
    weights = [math.exp(r.evidence - best.evidence) for r in found.rivals if r.ways]
    sure = 1.0 / (1.0 + sum(weights))
    real = 1.0 - math.exp(-max(best.evidence - 0.5 * ADDS, 0.0))
    members = _members(best, rivals)
    each = {e: _capped(real * (sure if e in members else 1.0)) for e in best.effects}
    if not clean:
        partly = best.evidence > _PARTLY * (best.evidence + left.evidence)
        if best.evidence > _STRONG and partly and len(best.ways) == 1:
            return Judgement("partly_explained", best.effects, (), loud, each, left, free)
        return Judgement("unknown", (), (), _heard(loud, _STRANGE), {}, left, free)
    if not members:
        return Judgement("named", best.effects, (), _heard(real * sure, _DRAWN), each, left, free)
    for rival in rivals:
        odds = math.exp(rival.evidence - best.evidence) * sure
        for e in rival.effects:
            if e in members and e not in best.effects:
                each[e] = max(each.get(e, 0.0), _capped(real * odds))
    certain = tuple(e for e in best.effects if e not in members)
    if certain:
        return Judgement("named", certain, members, _heard(real, _DRAWN), each, left, free)
    order = {e: k for k, e in enumerate(members)}
    ordered = tuple(sorted(members, key=lambda e: (-each.get(e, 0.0), order[e])))
    return Judgement("set", ordered, members, _heard(real, _DRAWN), each, left, free)


def _members(best: Explanation, rivals: list[Explanation]) -> tuple[str, ...]:
    """Return the effects that stand in for each other in explanations that do as well."""
    if not rivals:
        return ()
    every = [set(best.effects), *(set(r.effects) for r in rivals)]
    shared = set.intersection(*every)
    ordered = [*best.effects, *(e for r in rivals for e in r.effects)]
    return tuple(dict.fromkeys(e for e in ordered if e not in shared))


def _capped(probability: float) -> float:
    return min(max(probability, 0.0), _SUREST)


def _heard(probability: float, table: tuple[tuple[float, float], ...]) -> float:
    """Return the calibrated probability."""
    raw, true = zip(*table, strict=True)
    return _capped(float(np.interp(probability, raw, true)))


def _speeds(problem: Problem) -> int:
    speed = problem.points.setup.speed
    turning = speed[problem.seen.any(axis=1) & (speed > 0.0)]
    return int(np.unique(np.round(50.0 * turning / max(float(speed.max()), 1e-9))).size)
