"""The search for causes in stand data: alone or up to three together, by evidence.

The thresholds are those of flights: what a cause has to earn does not depend on the instrument.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from tombo_diagnosis.flight.evidence import solve
from tombo_diagnosis.flight.model_selection import LOG_BF_ADDITIONAL, LOG_BF_FIRST
from tombo_diagnosis.stand.problem import PROPELLER, RUN, SHARE, Fit, Problem, Widths
from tombo_dynamics.propeller.effects import STAND_EFFECTS

_MAX_FITTED_CANDIDATES = 7
"""So many candidates are fitted with the model itself at each step."""
_BEAM_WIDTH = 3
_MAX_CAUSES = 3
_WIDTHS = np.geomspace(1.5, 40.0, 10)
_MIN_TANGENT_LOG_BF = 1.0
_REFINE_WITHIN_LOG_BF = 10.0
"""Log Bayes factor to the best within which explanations are refined."""
_ALWAYS_FITTED = ("centrifugal_stiffening",)
"""Saturates so soon that its tangent at null promises nothing: always fitted by the model."""
_NOISE_EFFECT_PENALTY = 3.0
"""Log Bayes factor that an effect of chance has to bring besides: how noisy a reading is, a stand
knows to some 15 % only, and its tails are heavy."""
_MIN_GROUPS = 3
"""Propellers or runs that it takes to tell scatter from a common error."""


@dataclass(frozen=True)
class Hypothesis:
    """One effect at work."""

    effect: str
    free: tuple[int, ...]
    """Places of its parameters; empty for an effect of chance."""
    width: float = 1.0
    """Factor on the healthy width, of an effect of chance."""


@dataclass(frozen=True, eq=False)
class Explanation:
    """A set of causes, fitted."""

    hypotheses: tuple[Hypothesis, ...]
    fit: Fit
    evidence: float
    """Log Bayes factor against the nominal model."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names of the causes, as they were found."""
        return tuple(hypothesis.effect for hypothesis in self.hypotheses)


@dataclass(frozen=True)
class SearchResult:
    """What the search came to."""

    best: Explanation
    single_log_bf: dict[str, float]
    """Effect -> log Bayes factor of it alone."""
    alternatives: tuple[Explanation, ...]
    """Other explanations, likeliest first."""


def search(problem: Problem, most: int = _MAX_CAUSES) -> SearchResult:
    """Return the best explanation of the points and what else would do."""
    null_hypothesis = Explanation((), problem.null_hypothesis, 0.0)
    single_log_bf: dict[str, float] = {}
    beam = [null_hypothesis]
    tried: dict[tuple[str, ...], Explanation] = {}
    for size in range(1, most + 1):
        grown: dict[tuple[str, ...], Explanation] = {}
        for base in beam:
            every = rank_hypotheses(problem, base)
            if size == 1:
                single_log_bf = {hypothesis.effect: gain for gain, hypothesis in every}
            for place, (gain, hypothesis) in enumerate(every):
                promising = gain >= _MIN_TANGENT_LOG_BF and (
                    size == 1 or place < _MAX_FITTED_CANDIDATES
                )
                if not promising and hypothesis.effect not in _ALWAYS_FITTED:
                    continue
                key = tuple(sorted((*base.effects, hypothesis.effect)))
                if key in grown:
                    continue
                grown[key] = add_hypothesis(problem, base, hypothesis)
        tried.update(grown)
        if size == 1:
            single_log_bf |= {key[0]: e.evidence for key, e in grown.items()}
        least = beam[0].evidence + (LOG_BF_FIRST if size == 1 else LOG_BF_ADDITIONAL)
        kept = [e for e in sorted(grown.values(), key=lambda e: -e.evidence) if e.evidence > least]
        if not kept:
            break
        beam = kept[:_BEAM_WIDTH]
    best = beam[0]
    alternatives = [
        e for key, e in tried.items()
        if len(key) <= len(best.hypotheses) and set(key) != set(best.effects)
    ]  # fmt: skip
    if best.hypotheses:
        best, *alternatives = _refine_near_best(problem, [best, *alternatives])
    return SearchResult(
        best, single_log_bf, tuple(sorted(alternatives, key=lambda e: -e.evidence))
    )


def _refine_near_best(problem: Problem, every: list[Explanation]) -> list[Explanation]:
    """Return explanations likeliest first, the first and all that come close to it refined.

    Refined, one may fall far behind others that were behind it; then these are refined, too.
    """
    rough, done = list(every), list[Explanation]()
    while True:
        top = max(e.evidence for e in (*rough, *done))
        near = [e for e in rough if e.evidence > top - _REFINE_WITHIN_LOG_BF]
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


def rank_hypotheses(problem: Problem, base: Explanation) -> list[tuple[float, Hypothesis]]:
    """Return each effect with what it adds to an explanation, by the tangent."""
    found: list[tuple[float, Hypothesis]] = []
    fit = base.fit
    prior_mean = np.zeros(fit.solution.mean.size)
    prior_mean[: fit.theta.size] = problem.nominal - fit.theta
    for name, effect in STAND_EFFECTS.items():
        if name in base.effects:
            continue
        if effect.stochastic:
            hypothesis = _noise_hypothesis(problem, base, name)
            if hypothesis is not None:
                found.append(hypothesis)
            continue
        free = problem.identifiable(name)
        if free:
            deviations = problem.deviations((*fit.free, *free), fit.widths)
            gain = solve(fit.normal, deviations, prior_mean, covariance=False).evidence
            held = problem.deviations(fit.free, fit.widths)
            gain -= solve(fit.normal, held, prior_mean, covariance=False).evidence
            found.append((gain, Hypothesis(name, free)))
    return sorted(found, key=lambda each: -each[0])


def _noise_hypothesis(
    problem: Problem, base: Explanation, name: str
) -> tuple[float, Hypothesis] | None:
    if not _scatter_identifiable(problem, name):
        return None
    gains = []
    fit = base.fit
    for width in _WIDTHS:
        widths = widened(fit.widths, name, float(width))
        gains.append(_at(problem, fit, widths) - fit.evidence)
    best = int(np.argmax(gains))
    # A broad prior over the width: the mean over the grid, not the best of it.
    mean = float(np.logaddexp.reduce(gains)) - math.log(len(gains)) - _NOISE_EFFECT_PENALTY
    return mean, Hypothesis(name, (), float(_WIDTHS[best]))


def _scatter_identifiable(problem: Problem, name: str) -> bool:
    """Return whether there is enough to tell an effect of chance from a common error.

    Of the shares of runs, runs of one propeller have to differ: each on its own propeller they
    look like fabrication.
    """
    if name == PROPELLER:
        return problem.scatters and problem.propellers >= _MIN_GROUPS
    if name == RUN:
        return problem.runs >= _MIN_GROUPS or problem.repeated
    return name != SHARE or problem.repeated


def _at(problem: Problem, fit: Fit, widths: Widths) -> float:
    """Return the evidence of a fit with other widths, by the tangent."""
    slopes = problem.slopes
    if fit.free:
        slopes = slopes.copy()
        for k in fit.free:
            slopes[:, :, k] = problem.slope(fit.theta, k)
    normal, half = problem.normal(fit.theta, slopes, widths)
    prior_mean = np.zeros(fit.solution.mean.size)
    prior_mean[: fit.theta.size] = problem.nominal - fit.theta
    deviations = problem.deviations(fit.free, widths)
    return solve(normal, deviations, prior_mean, covariance=False).evidence - half


def widened(widths: Widths, name: str, factor: float) -> Widths:
    """Return widths with those of one effect of chance replaced."""
    key = {PROPELLER: "propeller", RUN: "run", SHARE: "share"}.get(name, "speed")
    return replace(widths, **{key: factor})


def add_hypothesis(problem: Problem, base: Explanation, hypothesis: Hypothesis) -> Explanation:
    """Return an explanation with one more cause, everything in it fitted anew."""
    return fit_hypotheses(problem, (*base.hypotheses, hypothesis), base.fit)


def fit_hypotheses(
    problem: Problem, hypotheses: tuple[Hypothesis, ...], start: Fit | None = None
) -> Explanation:
    """Fit a set of causes."""
    free = tuple(k for each in hypotheses for k in each.free)
    widths = Widths()
    cost = 0.0
    for each in hypotheses:
        if not each.free:
            widths = widened(widths, each.effect, each.width)
            cost += math.log(len(_WIDTHS)) - 1.0 + _NOISE_EFFECT_PENALTY
    fit = problem.fit(free, widths, None if start is None else start.theta)
    evidence = fit.evidence - problem.null_hypothesis.evidence - cost
    theta = problem.final(fit)
    for each in hypotheses:
        if each.free and all(theta[k] == problem.nominal[k] for k in each.free):
            evidence = -math.inf  # at the edge of its bounds it does nothing: no cause
    return Explanation(hypotheses, fit, evidence)
