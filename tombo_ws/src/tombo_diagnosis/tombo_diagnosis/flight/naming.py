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

from tombo_diagnosis.flight.candidates import effects, variants
from tombo_diagnosis.flight.evidence import solve
from tombo_diagnosis.flight.problem import TIGHT, Fit, Problem, sum_of
from tombo_diagnosis.flight.sensitivity import DRAWN

Array = NDArray[np.float64]

ADDS = 3.5
"""Log Bayes factor with which a cause earns its place; see docs/diagnosis.md for what it gives."""
MORE = 7.0
"""The same for one cause beside others: two at once are rarer."""
_PROMISING = 1.5
_TRIED = 4
"""So many candidates are fitted with the model itself at each step."""
_HOPELESS = 0.2
"""A candidate whose tangent promises less than this share of the best one's is not fitted."""
_TRIED_TIGHT = 2
_STRETCHED = 3.0
_BEAM = 2
"""So many explanations are carried on."""
_MOST = 3
_STRONG = 25.0
"""From this evidence on the nominal model's slopes are no longer good enough."""
_OUTSIDE = 4.0
"""A fit further out of a parameter's bounds than so many deviations is none."""
SCATTER = DRAWN.split(".")[0]
_STANDS_IN = {SCATTER: "weak_propeller", "weak_propeller": SCATTER}
"""Effects that are no causes beside each other: what one takes away the other may give back."""
_WIDTHS = np.geomspace(1.5, 40.0, 12)


@dataclass(frozen=True)
class Way:
    """One way in which one effect may be at work."""

    effect: str
    free: tuple[int, ...]
    """Places in theta; empty for the scatter of the draws."""
    draw_width: float | None = None
    """Of the draws, where scatter is the cause."""


@dataclass(frozen=True)
class Explanation:
    """A set of causes, fitted."""

    ways: tuple[Way, ...]
    fit: Fit
    evidence: float
    """Log Bayes factor against the nominal model."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes, in the order in which they were found."""
        return tuple(way.effect for way in self.ways)


@dataclass(frozen=True)
class Search:
    """What the search came to."""

    best: Explanation
    singles: dict[str, float]
    """Effect -> log Bayes factor of it alone, by its best way."""
    rivals: tuple[Explanation, ...]
    """Other explanations with as many causes, likeliest first."""
    tried: Mapping[frozenset[str], float] = field(default_factory=dict)
    """Effects -> log Bayes factor of them together, of every explanation that was fitted."""

    def disputed(self, rival: Explanation) -> float:
        """Return the log Bayes factor of what the best explanation and a rival do not share."""
        shared = frozenset(self.best.effects) & frozenset(rival.effects)
        return self.best.evidence - self.tried.get(shared, 0.0)


def search(
    problem: Problem, progress: Callable[[float], None] | None = None, most: int = _MOST
) -> Search:
    """Return the best explanation of the flights and what else would do."""
    nothing = Explanation((), problem.nothing, 0.0)
    singles = {way.effect: gain for gain, way in reversed(ranked(problem, nothing))}
    beam = [nothing]
    tried: dict[tuple[str, ...], Explanation] = {}
    for size in range(1, most + 1):
        grown: dict[tuple[str, ...], Explanation] = {}
        for explanation in beam:
            promising = [
                (gain, way)
                for gain, way in ranked(problem, explanation)
                if gain > _PROMISING and way.effect not in explanation.effects
            ]
            for way in [*_shortlist(promising), *_hard_pressed(problem, explanation)]:
                found = extend(problem, explanation, way)
                key = tuple(sorted(found.effects))
                if key not in grown or grown[key].evidence < found.evidence:
                    grown[key] = found
        if progress is not None:
            progress(size / most)
        tried.update(grown)
        ordered = sorted(grown.values(), key=lambda e: -e.evidence)
        kept = [
            e for e in ordered if e.evidence > beam[0].evidence + (ADDS if size == 1 else MORE)
        ]
        if not kept:
            break
        beam = [_settled(problem, each) for each in kept[:_BEAM]]
    best = beam[0]
    for key, explanation in tried.items():
        if len(key) == 1:
            singles[key[0]] = max(singles.get(key[0], -math.inf), explanation.evidence)
    own = set(best.effects)
    rivals = [e for e in tried.values() if len(e.ways) == len(own) and set(e.effects) != own]
    ordered = sorted(rivals, key=lambda e: -e.evidence)
    known = {frozenset(e.effects): e.evidence for e in tried.values()}
    return Search(whole(problem, best), singles, tuple(ordered), known)


def _shortlist(promising: Sequence[tuple[float, Way]]) -> list[Way]:
    """Return the ways worth fitting: the best two of each effect, the best effects first."""
    counts: dict[str, int] = {}
    chosen = []
    least = _HOPELESS * promising[0][0] if promising else 0.0
    for gain, way in promising:
        counts[way.effect] = counts.get(way.effect, 0) + 1
        close = gain > promising[0][0] - 3.0 if counts[way.effect] > 1 else gain > least
        if counts[way.effect] <= 2 and close and len(counts) <= _TRIED:
            chosen.append(way)
    return chosen


def _settled(problem: Problem, explanation: Explanation) -> Explanation:
    """Return a strong explanation with all slopes taken where it is, and its evidence then."""
    if explanation.evidence < _STRONG:
        return explanation
    fit = problem.about(explanation.fit)
    return replace(
        explanation,
        fit=fit,
        evidence=explanation.evidence + fit.evidence - explanation.fit.evidence,
    )


def _hard_pressed(problem: Problem, explanation: Explanation) -> list[Way]:
    """Return ways that look best with tolerances held, where some are stretched beyond belief."""
    fit = explanation.fit
    columns = problem.columns
    limits = columns.deviations(fit.free, draw_width=fit.draw_width)
    stretched = np.abs(fit.solution.mean - fit.centre) / limits
    own = [k for k, i in enumerate(columns.indices) if i in columns.open and i not in fit.free]
    if not own or float(stretched[own].max()) < _STRETCHED:
        return []
    found = [
        way
        for gain, way in ranked(problem, explanation, TIGHT)
        if gain > _PROMISING and way.effect not in explanation.effects and way.free
    ]
    firsts = {way.effect: way for way in reversed(found)}
    return [way for way in found if firsts[way.effect] is way][:_TRIED_TIGHT]


def ranked(
    problem: Problem, explanation: Explanation, tight: float = 1.0
) -> list[tuple[float, Way]]:
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
        base = solve(normal, held, fit.centre, covariance=False).evidence
    found = []
    out = {*explanation.effects, *(_STANDS_IN.get(effect) for effect in explanation.effects)}
    for effect in effects():
        if effect in out:
            continue
        for free in variants(effect, columns.open):
            every = (*fit.free, *free)
            deviations = columns.deviations(
                every, draw_width=fit.draw_width, tight=tight, pinned=_still(problem, fit, free)
            )
            solution = solve(normal, deviations, fit.centre, covariance=False)
            gain = solution.evidence - base
            if gain < _PROMISING:
                found.append((gain - _ways_cost(effect, problem), Way(effect, free)))
                continue
            if _beyond(problem, fit.theta, free, solution.mean):
                solution = solve(normal, deviations, fit.centre)
            gain -= _out_of_bounds(problem, fit.theta, free, solution.mean, solution.covariance)
            found.append((gain - _ways_cost(effect, problem), Way(effect, free)))
    if columns.draws and SCATTER not in out:
        gains = []
        for factor in _WIDTHS:
            width = fit.draw_width * factor
            deviations = columns.deviations(
                fit.free, draw_width=width, tight=tight, pinned=fit.pinned
            )
            gains.append(solve(normal, deviations, fit.centre, False).evidence - base)
        best = int(np.argmax(gains))
        # A broad prior over the deviation: the mean over the grid, not the best of it.
        mean = float(np.logaddexp.reduce(gains)) - math.log(len(gains))
        width = fit.draw_width * float(_WIDTHS[best])
        found.append((mean, Way(SCATTER, (), width)))
    return sorted(found, key=lambda each: -each[0])


def extend(problem: Problem, explanation: Explanation, way: Way) -> Explanation:
    """Return an explanation with one more cause, everything in it fitted anew."""
    ways = (*explanation.ways, way)
    free = tuple(dict.fromkeys(i for each in ways for i in each.free))
    widths = [each.draw_width for each in ways if each.draw_width is not None]
    fit = problem.refine(free, explanation.fit, widths[0] if widths else None)
    cost = sum(_ways_cost(each.effect, problem) for each in ways)
    evidence = fit.evidence - problem.nothing.evidence - cost
    if widths:
        evidence -= math.log(len(_WIDTHS)) - 1.0
    evidence -= _out_of_bounds(
        problem, fit.theta, free, fit.solution.mean, fit.solution.covariance, fitted=True
    )
    for each in ways:
        if each.free and all(fit.theta[i] == problem.theta[i] for i in each.free):
            evidence = -math.inf  # at the edge of its bounds it does nothing: no cause
    return Explanation(ways, fit, evidence)


def whole(problem: Problem, explanation: Explanation) -> Explanation:
    """Return an explanation with every parameter of a named unit free: all axes of a bias or wind.

    What was too small on one axis to earn its place is measured there all the same.
    """
    ways = []
    for way in explanation.ways:
        own = [problem.columns.parameters[i] for i in way.free]
        free = way.free
        if own and own[0].low < own[0].null < own[0].high:
            units = {p.unit for p in own}
            free = tuple(
                p.index
                for p in problem.columns.parameters
                if p.effect == way.effect and p.unit in units and p.index in problem.columns.open
            )
        ways.append(Way(way.effect, free, way.draw_width))
    if not ways:
        return explanation
    if tuple(ways) == explanation.ways:
        if explanation.evidence >= _STRONG:
            return explanation
        return replace(explanation, fit=problem.about(explanation.fit))
    every = tuple(dict.fromkeys(i for each in ways for i in each.free))
    fit = problem.refine(every, explanation.fit)
    if explanation.evidence < _STRONG:  # else its slopes are right already
        fit = problem.about(fit)
    return Explanation(tuple(ways), fit, explanation.evidence)


def only(problem: Problem, explanation: Explanation, effects_kept: Sequence[str]) -> Explanation:
    """Return an explanation with some of its causes only, fitted anew."""
    kept = tuple(way for way in explanation.ways if way.effect in effects_kept)
    if kept == explanation.ways:
        return explanation
    result = Explanation((), problem.nothing, 0.0)
    for way in kept:
        result = extend(problem, result, way)
    return result


def _ways_cost(effect: str, problem: Problem) -> float:
    """An effect that may show in many ways is not for that the likelier one."""
    return math.log(max(1, len(variants(effect, problem.columns.open)))) if effect else 0.0


def _still(problem: Problem, fit: Fit, free: Sequence[int]) -> list[int]:
    """Return the columns that stay pinned while others are freed."""
    return [place for place in fit.pinned if problem.columns.indices[place] not in free]


def _beyond(problem: Problem, theta: Array, free: Sequence[int], mean: Array) -> bool:
    """Return whether a fit lies beyond a bound of its parameters."""
    for index, place in zip(free, problem.columns.places(free), strict=True):
        p = problem.columns.parameters[index]
        if not p.low <= theta[index] + mean[place] <= p.high:
            return True
    return False


def _out_of_bounds(
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
        if fitted and over > _OUTSIDE * deviation:
            return math.inf
        cost += 0.5 * (over / deviation) ** 2
    return min(cost, 1e6)
