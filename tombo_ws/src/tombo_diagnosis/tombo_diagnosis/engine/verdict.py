"""The verdict: none, named, set, unknown or partly explained, and how sure it is.

A cause is named only if it passes two tests: its evidence against the nominal model is high
enough, and the remaining residual is noise. Without the second test a strong unknown force would
nearly always get the name of some effect. `judge` is the whole decision, read from top to bottom.
`analyse_problem` is the whole analysis: search for causes, look at what is left, judge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from itertools import combinations
from typing import TypeVar

import numpy as np
from scipy.special import expit

from tombo_diagnosis.diagnosis import Experiment
from tombo_diagnosis.engine.model import (
    Analysis,
    Explanation,
    Judgement,
    RegressionModel,
    Remainder,
    SearchResult,
    Setting,
)
from tombo_diagnosis.engine.model_selection import (
    LOG_BF_ADDITIONAL,
    LOG_BF_FIRST,
    MAX_CAUSES,
    search,
)
from tombo_diagnosis.wording import listed
from tombo_dynamics.effect_registry import Effect
from tombo_flight.progress import ProgressCallback

P = TypeVar("P", bound=RegressionModel)
R = TypeVar("R", bound=Remainder)

LOG_BF_DISTINCT = 4.0
"""Log Bayes factor with which one cause is told from another."""
_STRONG_LOG_BF = 50.0
"""From this evidence on a single cause may be called a part of the explanation."""
_SURE_LOG_BF = 10.0
"""From this evidence on causes may be named although other channels hold something else."""
_NONE_SLOPE, _NONE_EVEN_LOG_BF = 1.3, 2.0
_MAX_EXPONENT = 50.0
_MAX_ADVICE = 6
"""Pairs whose advice is given, the most probable first."""


def judge(setting: Setting, result: SearchResult, remainder: Remainder) -> Judgement:
    """Return the verdict on a search for causes and what its best explanation leaves."""
    best, share = result.best, setting.model_error_share
    weights = dict.fromkeys(best.effects, best.evidence)
    for effect, log_bf in remainder.noise_log_bf.items():
        weights[effect] = max(weights.get(effect, 0.0), log_bf)
    weights = _above_additional_threshold(weights)
    all_causes = bool(best.effects) and all(e in weights for e in best.effects)
    rivals = [
        r
        for r in result.alternatives
        if all_causes and _deficit(r, result, share) < LOG_BF_DISTINCT
    ]
    causes = tuple(sorted(weights, key=lambda e: -weights[e]))[:MAX_CAUSES]
    members = _with_equivalents(_interchangeable_effects(best, rivals), causes, setting.equivalent)
    certain = tuple(e for e in causes if e not in members)
    p_real = p_cause(min(weights.values(), default=0.0))
    p_best = 1.0 / (1.0 + sum(_relative_odds(r, result, share) for r in result.alternatives))

    def verdict(name: str, probability: float, effects: tuple[str, ...] = ()) -> Judgement:
        each = _confidences(setting, result, causes, members, p_real, p_best, rivals)
        each = each if effects else {}
        if name == "set":
            effects = tuple(sorted(effects, key=lambda e: -each.get(e, 0.0)))
        table = setting.calibration.get(name)
        if table:
            said, true = zip(*table, strict=True)
            probability = float(np.interp(probability, said, true))
        stated = _clipped(probability, setting.max_confidence)
        alike = members if name in ("named", "set") else ()
        return Judgement(name, effects, alike, stated, each)

    if not causes and remainder.clean:
        lead = max(result.single_log_bf.values(), default=0.0)
        return verdict("none", expit(_NONE_SLOPE * (_NONE_EVEN_LOG_BF - lead)))
    if not causes:
        return verdict("unknown", remainder.p_unexplained)
    if not remainder.clean:
        strong = remainder.mostly_explained and best.evidence > _STRONG_LOG_BF
        if strong and len(causes) == 1:
            return verdict("partly_explained", remainder.p_unexplained, causes)
        if remainder.clean_where_explained and best.evidence > _SURE_LOG_BF:
            return verdict("partly_explained", p_real, causes)
        # A cause that leaves more than noise where it acts may only resemble the true one.
        return verdict("unknown", remainder.p_unexplained)
    random = [e for e in remainder.imitated if e in causes]
    if any(e in remainder.imitated[r] for r in random for e in causes):
        # The true force leaves random forces where the cause only resembles it.
        named = tuple(e for e in causes if e not in random)
        return verdict("partly_explained", p_real, named)
    if members and certain:
        return verdict("named", p_real, certain)
    if members:
        return verdict("set", p_real, members)
    return verdict("named", p_real * p_best, causes)


def _confidences(
    setting: Setting,
    result: SearchResult,
    causes: Sequence[str],
    members: Sequence[str],
    p_real: float,
    p_best: float,
    rivals: Sequence[Explanation],
) -> dict[str, float]:
    """Return the confidence in each cause and in each member of the set."""
    most = setting.max_confidence
    each = {e: _clipped(p_real * (p_best if e in members else 1.0), most) for e in causes}
    for rival in rivals:
        odds = _relative_odds(rival, result, setting.model_error_share) * p_best
        for e in rival.effects:
            if e in members:
                each.setdefault(e, _clipped(p_real * odds, most))
    for group in setting.equivalent:
        alike = [e for e in members if e in group]
        if alike:
            shared = max(each.get(e, 0.0) for e in alike) / len(alike)
            each |= dict.fromkeys(alike, shared)
    return each


def _above_additional_threshold(weights: dict[str, float]) -> dict[str, float]:
    """Return the accepted causes; further ones than the strongest need more: two are rarer."""
    strongest = max(weights.values(), default=0.0)
    return {
        e: w
        for e, w in weights.items()
        if w > (LOG_BF_FIRST if w == strongest else LOG_BF_ADDITIONAL)
    }


def _interchangeable_effects(best: Explanation, rivals: Sequence[Explanation]) -> tuple[str, ...]:
    """Return the effects that can replace each other in explanations that do as well."""
    every = [best, *rivals]
    shared = set.intersection(*(set(e.effects) for e in every))
    ordered = dict.fromkeys(e for explanation in every for e in explanation.effects)
    return tuple(e for e in ordered if e not in shared)


def _with_equivalents(
    members: tuple[str, ...], causes: tuple[str, ...], groups: Sequence[frozenset[str]]
) -> tuple[str, ...]:
    """Return the effects that can replace each other, with their equivalents in these data."""
    alike = [e for g in groups if g & {*causes, *members} for e in sorted(g)]
    named = [e for e in alike if e in causes]
    return tuple(dict.fromkeys((*members, *named, *alike)))


def _deficit(rival: Explanation, result: SearchResult, share: float) -> float:
    """Return how far a rival is behind the best: a log Bayes factor, less where much is at stake.

    Where a cause is strong, small errors of the model weigh more than noise does: they make a
    `share` of the disputed evidence.
    """
    ahead = result.best.evidence - rival.evidence
    disputed = result.log_bf_of_difference(rival)
    if not math.isfinite(disputed):
        return ahead
    return ahead / max(1.0, share * disputed / LOG_BF_DISTINCT)


def _relative_odds(rival: Explanation, result: SearchResult, share: float) -> float:
    """Return how likely a rival is against the best; of tangents it may look the more probable."""
    return math.exp(min(-_deficit(rival, result, share), _MAX_EXPONENT))


def p_cause(log_bf: float) -> float:
    """Return the probability that a cause of such a log Bayes factor is real."""
    return 1.0 - math.exp(-max(log_bf - 0.5 * LOG_BF_FIRST, 0.0))


def succession(trials: int, failures: int, usual: float = 0.5) -> float:
    """Return the probability of success after `trials` (Laplace's rule of succession).

    `usual`: share of failures before them, which counts as two trials.
    """
    return (trials - failures + 2.0 * (1.0 - usual)) / (trials + 2.0)


def _clipped(probability: float, most: float) -> float:
    return min(max(probability, 0.0), most)


def analyse_problem(
    problem: P, test_residual: Callable[[P, SearchResult], R], progress: ProgressCallback
) -> Analysis[P, R]:
    """Select the causes.

    `test_residual` compares the residual of the best explanation with noise; `progress` is called
    with a stage and the share done, from 0.3 on.
    """
    progress("selecting causes", 0.3)
    result = search(problem, lambda share: progress("selecting causes", 0.3 + 0.3 * share))
    progress("testing the residual", 0.6)
    remainder = test_residual(problem, result)
    return Analysis(problem, result, remainder, judge(problem.setting, result, remainder))


def separating_experiment(
    members: Sequence[str], effects: Mapping[str, Effect]
) -> Experiment | None:
    """Return the registry's advice on how to separate the members of a set; None without a set."""
    if len(members) < 2:
        return None
    texts = []
    for a, b in combinations(members, 2):
        advice = effects[a].separates_from.get(b) or effects[b].separates_from.get(a)
        if advice:
            texts.append(f"{advice} ({listed((a, b))})")
    names = listed(members)
    if not texts:
        text = f"No known measurement tells {names} apart; change one of them by hand."
    else:
        text = f"To tell {names} apart: {'; '.join(texts[:_MAX_ADVICE])}."
    return Experiment(tuple(members), text)
