"""The search for causes in stand data: alone or up to three together, by evidence.

The thresholds are those of flights: what a cause has to earn does not depend on the instrument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tombo_diagnosis.flight.evidence import solve
from tombo_diagnosis.flight.naming import ADDS, MORE
from tombo_diagnosis.stand.problem import PROPELLER, RUN, SHARE, Fit, Problem, Widths
from tombo_dynamics.propeller.effects import STAND_EFFECTS

_TRIED = 7
"""So many candidates are fitted with the model itself at each step."""
_BEAM = 3
_MOST = 3
_WIDTHS = np.geomspace(1.5, 40.0, 10)
_PROMISING = 1.0
_NEAR = 10.0
"""Log Bayes factor to the best within which explanations are refined."""
_BENT = ("centrifugal_stiffening",)
"""Saturates so soon that its tangent at null promises nothing: always fitted by the model."""
_CHANCE_COST = 3.0
"""Log Bayes factor that an effect of chance has to bring besides: how noisy a reading is, a stand
knows to some 15 % only, and its tails are heavy."""
_FEWEST = 3
"""Propellers or runs that it takes to tell scatter from a common error."""


@dataclass(frozen=True)
class Way:
    """One effect at work."""

    effect: str
    free: tuple[int, ...]
    """Places of its parameters; empty for an effect of chance."""
    width: float = 1.0
    """Factor on the healthy width, of an effect of chance."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes, fitted."""

    ways: tuple[Way, ...]
    fit: Fit
    evidence: float
    """Log Bayes factor against the nominal model."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes, as they were found."""
        return tuple(way.effect for way in self.ways)


@dataclass(frozen=True)
class Search:
    """What the search came to."""

    best: Explanation
    singles: dict[str, float]
    """Effect -> log Bayes factor of it alone."""
    rivals: tuple[Explanation, ...]
    """Other explanations, likeliest first."""


def search(problem: Problem, most: int = _MOST) -> Search:
    """Return the best explanation of the points and what else would do."""
    nothing = Explanation((), problem.nothing, 0.0)
    singles: dict[str, float] = {}
    beam = [nothing]
    tried: dict[tuple[str, ...], Explanation] = {}
    for size in range(1, most + 1):
        grown: dict[tuple[str, ...], Explanation] = {}
        for base in beam:
            every = ranked(problem, base)
            if size == 1:
                singles = {way.effect: gain for gain, way in every}
            for place, (gain, way) in enumerate(every):
                promising = gain >= _PROMISING and (size == 1 or place < _TRIED)
                if not promising and way.effect not in _BENT:
                    continue
                key = tuple(sorted((*base.effects, way.effect)))
                if key in grown:
                    continue
                grown[key] = extend(problem, base, way)
        tried.update(grown)
        if size == 1:
            singles |= {key[0]: e.evidence for key, e in grown.items()}
        least = beam[0].evidence + (ADDS if size == 1 else MORE)
        kept = [e for e in sorted(grown.values(), key=lambda e: -e.evidence) if e.evidence > least]
        if not kept:
            break
        beam = kept[:_BEAM]
    best = beam[0]
    rivals = [
        e for key, e in tried.items()
        if len(key) <= len(best.ways) and set(key) != set(best.effects)
    ]  # fmt: skip
    if best.ways:
        best, *rivals = _settled(problem, [best, *rivals])
    return Search(best, singles, tuple(sorted(rivals, key=lambda e: -e.evidence)))


def _settled(problem: Problem, every: list[Explanation]) -> list[Explanation]:
    """Return explanations likeliest first, the first and all that come close to it refined.

    Refined, one may fall far behind others that were behind it; then these are refined, too.
    """
    rough, done = list(every), list[Explanation]()
    while True:
        top = max(e.evidence for e in (*rough, *done))
        near = [e for e in rough if e.evidence > top - _NEAR]
        if not near:
            return sorted((*rough, *done), key=lambda e: -e.evidence)
        done += [_refined(problem, e) for e in near]
        rough = [e for e in rough if e not in near]


def _refined(problem: Problem, found: Explanation) -> Explanation:
    """Return an explanation with the slopes of everything else where its fit ended."""
    if not found.fit.free or not math.isfinite(found.evidence):
        return found
    fit = problem.refined(found.fit)
    return replace(found, fit=fit, evidence=found.evidence + fit.evidence - found.fit.evidence)


def ranked(problem: Problem, base: Explanation) -> list[tuple[float, Way]]:
    """Return each effect with what it adds to an explanation, by the tangent."""
    found: list[tuple[float, Way]] = []
    fit = base.fit
    centre = np.zeros(fit.solution.mean.size)
    centre[: fit.theta.size] = problem.nominal - fit.theta
    for name, effect in STAND_EFFECTS.items():
        if name in base.effects:
            continue
        if effect.chance:
            way = _chance_way(problem, base, name)
            if way is not None:
                found.append(way)
            continue
        free = problem.open(name)
        if free:
            deviations = problem.deviations((*fit.free, *free), fit.widths)
            gain = solve(fit.normal, deviations, centre, covariance=False).evidence
            held = problem.deviations(fit.free, fit.widths)
            gain -= solve(fit.normal, held, centre, covariance=False).evidence
            found.append((gain, Way(name, free)))
    return sorted(found, key=lambda each: -each[0])


def _chance_way(problem: Problem, base: Explanation, name: str) -> tuple[float, Way] | None:
    if not _can_scatter(problem, name):
        return None
    gains = []
    fit = base.fit
    for width in _WIDTHS:
        widths = widened(fit.widths, name, float(width))
        gains.append(_at(problem, fit, widths) - fit.evidence)
    best = int(np.argmax(gains))
    # A broad prior over the width: the mean over the grid, not the best of it.
    mean = float(np.logaddexp.reduce(gains)) - math.log(len(gains)) - _CHANCE_COST
    return mean, Way(name, (), float(_WIDTHS[best]))


def _can_scatter(problem: Problem, name: str) -> bool:
    """Return whether there is enough to tell an effect of chance from a common error.

    Of the shares of runs, runs of one propeller have to differ: each on its own propeller they
    look like fabrication.
    """
    if name == PROPELLER:
        return problem.scatters and problem.propellers >= _FEWEST
    if name == RUN:
        return problem.runs >= _FEWEST or problem.repeated
    return name != SHARE or problem.repeated


def _at(problem: Problem, fit: Fit, widths: Widths) -> float:
    """Return the evidence of a fit with other widths, by the tangent."""
    slopes = problem.slopes
    if fit.free:
        slopes = slopes.copy()
        for k in fit.free:
            slopes[:, :, k] = problem.slope(fit.theta, k)
    normal, half = problem.normal(fit.theta, slopes, widths)
    centre = np.zeros(fit.solution.mean.size)
    centre[: fit.theta.size] = problem.nominal - fit.theta
    deviations = problem.deviations(fit.free, widths)
    return solve(normal, deviations, centre, covariance=False).evidence - half


def widened(widths: Widths, name: str, factor: float) -> Widths:
    """Return widths with those of one effect of chance replaced."""
    key = {PROPELLER: "propeller", RUN: "run", SHARE: "share"}.get(name, "speed")
    return replace(widths, **{key: factor})


def extend(problem: Problem, base: Explanation, way: Way) -> Explanation:
    """Return an explanation with one more cause, everything in it fitted anew."""
    return explain(problem, (*base.ways, way), base.fit)


def explain(problem: Problem, ways: tuple[Way, ...], start: Fit | None = None) -> Explanation:
    """Fit a set of causes."""
    free = tuple(k for each in ways for k in each.free)
    widths = Widths()
    cost = 0.0
    for each in ways:
        if not each.free:
            widths = widened(widths, each.effect, each.width)
            cost += math.log(len(_WIDTHS)) - 1.0 + _CHANCE_COST
    fit = problem.fit(free, widths, None if start is None else start.theta)
    evidence = fit.evidence - problem.nothing.evidence - cost
    theta = problem.final(fit)
    for each in ways:
        if each.free and all(theta[k] == problem.nominal[k] for k in each.free):
            evidence = -math.inf  # at the edge of its bounds it does nothing: no cause
    return Explanation(ways, fit, evidence)
