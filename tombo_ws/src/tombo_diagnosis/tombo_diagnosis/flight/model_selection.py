"""The search for causes: which effects, alone or up to three together, explain the flights.

Every candidate is first judged by the tangent about the best explanation so far, the promising
ones then by the model itself. An explanation grows as long as another cause earns its place.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.flight.evidence import solve
from tombo_diagnosis.flight.parameters import effects, variants
from tombo_diagnosis.flight.problem import TIGHT, Fit, Problem, sum_of
from tombo_diagnosis.flight.sensitivity import DRAW_SCALE_LABEL

Array = NDArray[np.float64]

LOG_BF_FIRST = 3.5
"""Log Bayes factor with which a cause earns its place; see docs/diagnosis.md for what it gives."""
LOG_BF_ADDITIONAL = 7.0
"""The same for one cause beside others: two at once are rarer."""
_MIN_TANGENT_LOG_BF = 1.5
_MAX_FITTED_CANDIDATES = 4
"""So many candidates are fitted with the model itself at each step."""
_MIN_RELATIVE_GAIN = 0.2
"""A candidate whose tangent promises less than this share of the best one's is not fitted."""
_MAX_TIGHT_REFITS = 2
_STRETCHED_SIGMAS = 3.0
_BEAM_WIDTH = 2
"""So many explanations are carried on."""
_MAX_CAUSES = 3
_RELINEARIZE_LOG_BF = 25.0
"""From this evidence on the nominal model's slopes are no longer good enough."""
_MAX_BOUND_EXCESS_SIGMAS = 4.0
"""A fit further out of a parameter's bounds than so many deviations is none."""
SCATTER = DRAW_SCALE_LABEL.split(".")[0]
_CONFOUNDED_WITH = {SCATTER: "weak_propeller", "weak_propeller": SCATTER}
"""Effects that are no causes beside each other: what one takes away the other may give back."""
_DRAW_WIDTH_FACTORS = np.geomspace(1.5, 40.0, 12)


@dataclass(frozen=True)
class Hypothesis:
    """One way in which one effect may be at work."""

    effect: str
    free: tuple[int, ...]
    """Places in theta; empty for the scatter of the draws."""
    draw_width: float | None = None
    """Of the draws, where scatter is the cause."""


@dataclass(frozen=True)
class Explanation:
    """A set of causes, fitted."""

    hypotheses: tuple[Hypothesis, ...]
    fit: Fit
    evidence: float
    """Log Bayes factor against the nominal model."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes, in the order in which they were found."""
        return tuple(hypothesis.effect for hypothesis in self.hypotheses)


@dataclass(frozen=True)
class SearchResult:
    """What the search came to."""

    best: Explanation
    single_log_bf: dict[str, float]
    """Effect -> log Bayes factor of it alone, by its best way."""
    alternatives: tuple[Explanation, ...]
    """Other explanations with as many causes, likeliest first."""
    evaluated: Mapping[frozenset[str], float] = field(default_factory=dict)
    """Effects -> log Bayes factor of them together, of every explanation that was fitted."""

    def log_bf_of_difference(self, alternative: Explanation) -> float:
        """Return the log Bayes factor of what the best explanation and a rival do not share."""
        shared = frozenset(self.best.effects) & frozenset(alternative.effects)
        return self.best.evidence - self.evaluated.get(shared, 0.0)


def search(
    problem: Problem, progress: Callable[[float], None] | None = None, most: int = _MAX_CAUSES
) -> SearchResult:
    """Return the best explanation of the flights and what else would do."""
    null_hypothesis = Explanation((), problem.null_hypothesis, 0.0)
    single_log_bf = {
        hypothesis.effect: gain
        for gain, hypothesis in reversed(rank_hypotheses(problem, null_hypothesis))
    }
    beam = [null_hypothesis]
    evaluated: dict[tuple[str, ...], Explanation] = {}
    for size in range(1, most + 1):
        grown: dict[tuple[str, ...], Explanation] = {}
        for explanation in beam:
            promising = [
                (gain, hypothesis)
                for gain, hypothesis in rank_hypotheses(problem, explanation)
                if gain > _MIN_TANGENT_LOG_BF and hypothesis.effect not in explanation.effects
            ]
            for hypothesis in [
                *_shortlist(promising),
                *_rerank_with_tight_priors(problem, explanation),
            ]:
                found = add_hypothesis(problem, explanation, hypothesis)
                key = tuple(sorted(found.effects))
                if key not in grown or grown[key].evidence < found.evidence:
                    grown[key] = found
        if progress is not None:
            progress(size / most)
        evaluated.update(grown)
        ordered = sorted(grown.values(), key=lambda e: -e.evidence)
        kept = [
            e
            for e in ordered
            if e.evidence > beam[0].evidence + (LOG_BF_FIRST if size == 1 else LOG_BF_ADDITIONAL)
        ]
        if not kept:
            break
        beam = [_relinearized(problem, each) for each in kept[:_BEAM_WIDTH]]
    best = beam[0]
    for key, explanation in evaluated.items():
        if len(key) == 1:
            single_log_bf[key[0]] = max(single_log_bf.get(key[0], -math.inf), explanation.evidence)
    own = set(best.effects)
    alternatives = [
        e for e in evaluated.values() if len(e.hypotheses) == len(own) and set(e.effects) != own
    ]
    ordered = sorted(alternatives, key=lambda e: -e.evidence)
    known = {frozenset(e.effects): e.evidence for e in evaluated.values()}
    return SearchResult(free_all_axes(problem, best), single_log_bf, tuple(ordered), known)


def _shortlist(promising: Sequence[tuple[float, Hypothesis]]) -> list[Hypothesis]:
    """Return the ways worth fitting: the best two of each effect, the best effects first."""
    counts: dict[str, int] = {}
    chosen = []
    least = _MIN_RELATIVE_GAIN * promising[0][0] if promising else 0.0
    for gain, hypothesis in promising:
        counts[hypothesis.effect] = counts.get(hypothesis.effect, 0) + 1
        close = gain > promising[0][0] - 3.0 if counts[hypothesis.effect] > 1 else gain > least
        if counts[hypothesis.effect] <= 2 and close and len(counts) <= _MAX_FITTED_CANDIDATES:
            chosen.append(hypothesis)
    return chosen


def _relinearized(problem: Problem, explanation: Explanation) -> Explanation:
    """Return a strong explanation with all slopes taken where it is, and its evidence then."""
    if explanation.evidence < _RELINEARIZE_LOG_BF:
        return explanation
    fit = problem.relinearized(explanation.fit)
    return replace(
        explanation,
        fit=fit,
        evidence=explanation.evidence + fit.evidence - explanation.fit.evidence,
    )


def _rerank_with_tight_priors(problem: Problem, explanation: Explanation) -> list[Hypothesis]:
    """Return ways that look best with tolerances held, where some are stretched beyond belief."""
    fit = explanation.fit
    columns = problem.columns
    limits = columns.deviations(fit.free, draw_width=fit.draw_width)
    stretched = np.abs(fit.solution.mean - fit.prior_mean) / limits
    own = [
        k for k, i in enumerate(columns.indices) if i in columns.identifiable and i not in fit.free
    ]
    if not own or float(stretched[own].max()) < _STRETCHED_SIGMAS:
        return []
    found = [
        hypothesis
        for gain, hypothesis in rank_hypotheses(problem, explanation, TIGHT)
        if gain > _MIN_TANGENT_LOG_BF
        and hypothesis.effect not in explanation.effects
        and hypothesis.free
    ]
    firsts = {hypothesis.effect: hypothesis for hypothesis in reversed(found)}
    return [hypothesis for hypothesis in found if firsts[hypothesis.effect] is hypothesis][
        :_MAX_TIGHT_REFITS
    ]


def rank_hypotheses(
    problem: Problem, explanation: Explanation, tight: float = 1.0
) -> list[tuple[float, Hypothesis]]:
    """Return every way of every effect with what it adds to an explanation, by the tangent.

    Args:
        problem: the flights.
        explanation: what is known already.
        tight: factor on the tolerances.
    """
    fit = explanation.fit
    normal = sum_of(fit.normals)
    columns = problem.columns
    base = fit.evidence
    if tight != 1.0:
        held = columns.deviations(
            fit.free, draw_width=fit.draw_width, tight=tight, pinned=fit.pinned
        )
        base = solve(normal, held, fit.prior_mean, covariance=False).evidence
    found = []
    out = {*explanation.effects, *(_CONFOUNDED_WITH.get(effect) for effect in explanation.effects)}
    for effect in effects():
        if effect in out:
            continue
        for free in variants(effect, columns.identifiable):
            every = (*fit.free, *free)
            deviations = columns.deviations(
                every,
                draw_width=fit.draw_width,
                tight=tight,
                pinned=_still_pinned(problem, fit, free),
            )
            solution = solve(normal, deviations, fit.prior_mean, covariance=False)
            gain = solution.evidence - base
            if gain < _MIN_TANGENT_LOG_BF:
                found.append(
                    (gain - _multiplicity_penalty(effect, problem), Hypothesis(effect, free))
                )
                continue
            if _outside_bounds(problem, fit.theta, free, solution.mean):
                solution = solve(normal, deviations, fit.prior_mean)
            gain -= _bounds_penalty(problem, fit.theta, free, solution.mean, solution.covariance)
            found.append((gain - _multiplicity_penalty(effect, problem), Hypothesis(effect, free)))
    if columns.draws and SCATTER not in out:
        gains = []
        for factor in _DRAW_WIDTH_FACTORS:
            width = fit.draw_width * factor
            deviations = columns.deviations(
                fit.free, draw_width=width, tight=tight, pinned=fit.pinned
            )
            gains.append(solve(normal, deviations, fit.prior_mean, False).evidence - base)
        best = int(np.argmax(gains))
        # A broad prior over the deviation: the mean over the grid, not the best of it.
        mean = float(np.logaddexp.reduce(gains)) - math.log(len(gains))
        width = fit.draw_width * float(_DRAW_WIDTH_FACTORS[best])
        found.append((mean, Hypothesis(SCATTER, (), width)))
    return sorted(found, key=lambda each: -each[0])


def add_hypothesis(
    problem: Problem, explanation: Explanation, hypothesis: Hypothesis
) -> Explanation:
    """Return an explanation with one more cause, everything in it fitted anew."""
    hypotheses = (*explanation.hypotheses, hypothesis)
    free = tuple(dict.fromkeys(i for each in hypotheses for i in each.free))
    widths = [each.draw_width for each in hypotheses if each.draw_width is not None]
    fit = problem.refine(free, explanation.fit, widths[0] if widths else None)
    cost = sum(_multiplicity_penalty(each.effect, problem) for each in hypotheses)
    evidence = fit.evidence - problem.null_hypothesis.evidence - cost
    if widths:
        evidence -= math.log(len(_DRAW_WIDTH_FACTORS)) - 1.0
    evidence -= _bounds_penalty(
        problem, fit.theta, free, fit.solution.mean, fit.solution.covariance, fitted=True
    )
    for each in hypotheses:
        if each.free and all(fit.theta[i] == problem.theta[i] for i in each.free):
            evidence = -math.inf  # at the edge of its bounds it does nothing: no cause
    return Explanation(hypotheses, fit, evidence)


def free_all_axes(problem: Problem, explanation: Explanation) -> Explanation:
    """Return an explanation with every parameter of a named unit free: all axes of a bias or wind.

    What was too small on one axis to earn its place is measured there all the same.
    """
    hypotheses = []
    for hypothesis in explanation.hypotheses:
        own = [problem.columns.parameters[i] for i in hypothesis.free]
        free = hypothesis.free
        if own and own[0].low < own[0].null < own[0].high:
            units = {p.unit for p in own}
            free = tuple(
                p.index
                for p in problem.columns.parameters
                if p.effect == hypothesis.effect
                and p.unit in units
                and p.index in problem.columns.identifiable
            )
        hypotheses.append(Hypothesis(hypothesis.effect, free, hypothesis.draw_width))
    if not hypotheses:
        return explanation
    if tuple(hypotheses) == explanation.hypotheses:
        if explanation.evidence >= _RELINEARIZE_LOG_BF:
            return explanation
        return replace(explanation, fit=problem.relinearized(explanation.fit))
    every = tuple(dict.fromkeys(i for each in hypotheses for i in each.free))
    fit = problem.refine(every, explanation.fit)
    if explanation.evidence < _RELINEARIZE_LOG_BF:  # else its slopes are right already
        fit = problem.relinearized(fit)
    return Explanation(tuple(hypotheses), fit, explanation.evidence)


def restrict_to(
    problem: Problem, explanation: Explanation, effects_kept: Sequence[str]
) -> Explanation:
    """Return an explanation with some of its causes only, fitted anew."""
    kept = tuple(
        hypothesis for hypothesis in explanation.hypotheses if hypothesis.effect in effects_kept
    )
    if kept == explanation.hypotheses:
        return explanation
    result = Explanation((), problem.null_hypothesis, 0.0)
    for hypothesis in kept:
        result = add_hypothesis(problem, result, hypothesis)
    return result


def _multiplicity_penalty(effect: str, problem: Problem) -> float:
    """An effect that may show in many ways is not for that the likelier one."""
    return math.log(max(1, len(variants(effect, problem.columns.identifiable)))) if effect else 0.0


def _still_pinned(problem: Problem, fit: Fit, free: Sequence[int]) -> list[int]:
    """Return the columns that stay pinned while others are freed."""
    return [place for place in fit.pinned if problem.columns.indices[place] not in free]


def _outside_bounds(problem: Problem, theta: Array, free: Sequence[int], mean: Array) -> bool:
    """Return whether a fit lies beyond a bound of its parameters."""
    for index, place in zip(free, problem.columns.places(free), strict=True):
        p = problem.columns.parameters[index]
        if not p.low <= theta[index] + mean[place] <= p.high:
            return True
    return False


def _bounds_penalty(
    problem: Problem,
    theta: Array,
    free: Sequence[int],
    mean: Array,
    covariance: Array,
    fitted: bool = False,
) -> float:
    """Return what it costs that a fit lies beyond the bounds of its parameters.

    A tangent may end far beyond them where the model bends; `fitted`: this is no tangent.
    """
    cost = 0.0
    for index, place in zip(free, problem.columns.places(free), strict=True):
        p = problem.columns.parameters[index]
        value = theta[index] + mean[place]
        over = max(p.low - value, value - p.high, 0.0)
        deviation = math.sqrt(max(float(covariance[place, place]), 1e-18)) + p.tolerance
        if fitted and over > _MAX_BOUND_EXCESS_SIGMAS * deviation:
            return math.inf
        cost += 0.5 * (over / deviation) ** 2
    return min(cost, 1e6)
