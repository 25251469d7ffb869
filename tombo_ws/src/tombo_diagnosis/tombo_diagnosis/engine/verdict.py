"""The verdict: none, named, set, unknown or partly explained, and how sure it is.

A cause is named only if it passes two tests: its evidence against the nominal model is high
enough, and the remaining residual is noise. Without the second test a strong unknown force would
nearly always get the name of some effect. `RULES` is the whole decision, read from top to bottom.
`analyse_problem` is the whole analysis: search for causes, look at what is left, judge.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from tombo_diagnosis.engine.model import (
    Analysis,
    Calibration,
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


@dataclass(frozen=True)
class Facts:
    """Input of the rules."""

    causes: tuple[str, ...]
    """Effects that are accepted, most probable first."""
    members: tuple[str, ...]
    """Effects that replace each other in explanations that are about as good."""
    clean: bool
    """Only known noise is left unexplained."""
    clean_where_explained: bool
    """The same where the causes act; elsewhere more may be left."""
    strong: bool
    """One strong cause removes most of the excess."""
    imitated: frozenset[str]
    """Causes that a random force may only resemble."""
    p_none: float
    """Probability that no cause is present, if none was accepted."""
    p_unexplained: float
    """Probability that something is left unexplained."""
    p_cause: float
    """Probability that the weakest of the causes is real."""
    p_best: float
    """Probability of the best explanation against its alternatives."""

    @property
    def certain(self) -> tuple[str, ...]:
        """Causes that all explanations have that are about as good."""
        return tuple(e for e in self.causes if e not in self.members)


@dataclass(frozen=True)
class Rule:
    """One line of the decision: a condition, and the verdict if it holds."""

    holds: Callable[[Facts], bool]
    verdict: str
    causes: Callable[[Facts], tuple[str, ...]]
    """Effects of the verdict."""
    probability: Callable[[Facts], float]
    """Of the verdict, before it is calibrated."""
    reason: str


def _no_effects(_: Facts) -> tuple[str, ...]:
    return ()


RULES: Sequence[Rule] = (
    Rule(lambda f: not f.causes and f.clean,
         "none", _no_effects, lambda f: f.p_none,
         "no effect reaches the log Bayes factor threshold, and what is left is noise"),
    Rule(lambda f: not f.causes,
         "unknown", _no_effects, lambda f: f.p_unexplained,
         "no effect reaches the log Bayes factor threshold, but more than noise is left"),
    Rule(lambda f: not f.clean and f.strong,
         "partly_explained", lambda f: f.causes, lambda f: f.p_unexplained,
         "one strong cause takes away most, but more than noise is left"),
    Rule(lambda f: not f.clean and f.clean_where_explained,
         "partly_explained", lambda f: f.causes, lambda f: f.p_cause,
         "causes leave noise where they act; elsewhere more than noise is left"),
    Rule(lambda f: not f.clean,
         "unknown", _no_effects, lambda f: f.p_unexplained,
         "what looks like a cause leaves more than noise: it may only resemble the true one"),
    Rule(lambda f: bool(f.imitated),
         "partly_explained", lambda f: tuple(e for e in f.causes if e in f.imitated),
         lambda f: f.p_cause,
         "random forces beside a cause are what a force leaves that the cause only resembles"),
    Rule(lambda f: bool(f.members and f.certain),
         "named", lambda f: f.certain, lambda f: f.p_cause,
         "some causes are in all explanations that do as well, others can replace each other"),
    Rule(lambda f: bool(f.members),
         "set", lambda f: f.members, lambda f: f.p_cause,
         "several explanations do as well"),
    Rule(lambda _: True,
         "named", lambda f: f.causes, lambda f: f.p_cause * f.p_best,
         "one explanation reaches the log Bayes factor threshold and is ahead of all others"),
)  # fmt: skip
"""The first rule that holds gives the verdict."""


def judge(setting: Setting, result: SearchResult, remainder: Remainder) -> Judgement:
    """Return the verdict on a search for causes and what its best explanation leaves."""
    weights = dict.fromkeys(result.best.effects, result.best.evidence)
    for effect, log_bf in remainder.noise_log_bf.items():
        weights[effect] = max(weights.get(effect, 0.0), log_bf)
    weights = _above_additional_threshold(weights)
    all_causes = bool(result.best.effects) and all(e in weights for e in result.best.effects)
    share = setting.model_error_share
    rivals = [
        r
        for r in result.alternatives
        if all_causes and _deficit(r, result, share) < LOG_BF_DISTINCT
    ]
    facts = _facts(setting, result, remainder, weights, rivals)
    rule = next(rule for rule in RULES if rule.holds(facts))
    causes = rule.causes(facts)
    each = _confidences(setting, result, facts, rivals) if causes else {}
    if rule.verdict == "set":
        causes = tuple(sorted(causes, key=lambda e: -each.get(e, 0.0)))
    table = setting.calibration.get(rule.verdict, ())
    confidence = calibrated(rule.probability(facts), table, setting.max_confidence)
    members = facts.members if rule.verdict in ("named", "set") else ()
    explained = remainder.explained if facts.causes else 0.0
    return Judgement(rule.verdict, causes, members, confidence, each, explained, rule.reason)


def _facts(
    setting: Setting,
    result: SearchResult,
    remainder: Remainder,
    weights: dict[str, float],
    rivals: Sequence[Explanation],
) -> Facts:
    share = setting.model_error_share
    causes = tuple(sorted(weights, key=lambda e: -weights[e]))[:MAX_CAUSES]
    random = [e for e in remainder.imitated if e in causes]
    forces = {e for r in random for e in causes if e in remainder.imitated[r]}
    lead = max(result.single_log_bf.values(), default=0.0)
    return Facts(
        causes=causes,
        members=_with_equivalents(
            _interchangeable_effects(result.best, rivals), causes, setting.equivalent
        ),
        clean=remainder.clean,
        clean_where_explained=remainder.clean_where_explained
        and result.best.evidence > _SURE_LOG_BF,
        strong=remainder.mostly_explained
        and result.best.evidence > _STRONG_LOG_BF
        and len(causes) == 1,
        imitated=frozenset(e for e in causes if forces and e not in random),
        p_none=logistic(_NONE_SLOPE * (_NONE_EVEN_LOG_BF - lead)),
        p_unexplained=remainder.p_unexplained,
        p_cause=p_cause(min(weights.values(), default=0.0)),
        p_best=1.0 / (1.0 + sum(_relative_odds(r, result, share) for r in result.alternatives)),
    )


def _confidences(
    setting: Setting, result: SearchResult, facts: Facts, rivals: Sequence[Explanation]
) -> dict[str, float]:
    """Return the confidence in each cause and in each member of the set."""
    most = setting.max_confidence
    each = {
        e: _clipped(facts.p_cause * (facts.p_best if e in facts.members else 1.0), most)
        for e in facts.causes
    }
    for rival in rivals:
        odds = _relative_odds(rival, result, setting.model_error_share) * facts.p_best
        for e in rival.effects:
            if e in facts.members:
                each.setdefault(e, _clipped(facts.p_cause * odds, most))
    for group in setting.equivalent:
        alike = [e for e in facts.members if e in group]
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


def logistic(x: float) -> float:
    """Return the probability whose logarithm of the odds is x."""
    return 1.0 / (1.0 + math.exp(-min(max(x, -700.0), 700.0)))


def succession(trials: int, failures: int, usual: float = 0.5) -> float:
    """Return the probability of success after `trials` (Laplace's rule of succession).

    `usual`: share of failures before them, which counts as two trials.
    """
    return (trials - failures + 2.0 * (1.0 - usual)) / (trials + 2.0)


def calibrated(probability: float, table: Calibration, most: float) -> float:
    """Return a probability as a table calibrates it, never more than `most`."""
    if table:
        stated, true = zip(*table, strict=True)
        probability = float(np.interp(probability, stated, true))
    return _clipped(probability, most)


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
