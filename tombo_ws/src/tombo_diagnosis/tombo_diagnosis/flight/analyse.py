"""What the flights call for: the whole analysis, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.flight.events import Event, momentary, set_apart
from tombo_diagnosis.flight.gust_fit import GustFit, fit_gusts
from tombo_diagnosis.flight.leftover import Leftover, Powers, chance_powers, left_powers, leftovers
from tombo_diagnosis.flight.naming import ADDS, Search, search
from tombo_diagnosis.flight.nominal import Nominal
from tombo_diagnosis.flight.predictable import foretold
from tombo_diagnosis.flight.problem import Problem
from tombo_diagnosis.flight.scatter import ScatterFit, scatter_fits
from tombo_diagnosis.flight.track import Track
from tombo_diagnosis.flight.verdict import Judgement, best_scatter, judge

Progress = Callable[[str, float], None]
_FORCES = ("force", "acceleration")
_DOUBTS = ("unknown", "partly_explained")
_CONCERNS = 0.5
"""A cause concerns the channels whose excess it brings below this share."""
_HEALTHY = 4.0
"""Noise off its nominal value by up to so many tolerances is taken as it is measured."""


@dataclass(frozen=True)
class Findings:
    """All that the analysis came to, before it is put into words."""

    problem: Problem
    search: Search
    scatter: tuple[ScatterFit, ...]
    """Effects of chance that earn their place."""
    every_scatter: tuple[ScatterFit, ...]
    """All of them that were looked at."""
    gusts: GustFit | None
    expected: Powers
    """What chance leaves over, as far as it is explained."""
    leftovers: tuple[Leftover, ...]
    repeats: float
    judgement: Judgement
    events: tuple[Event, ...] = ()
    """Moments that were set apart."""


def quiet(stage: str, share: float) -> None:
    """Report nothing."""


def analyse(tracks: Sequence[Track], nominal: Nominal, progress: Progress = quiet) -> Findings:
    """Name what the flights call for; where moments do not fit, without these moments."""
    findings = _analysed(tracks, nominal, progress)
    if findings.judgement.verdict in _DOUBTS:
        events = momentary(findings.problem, findings.search.best.fit)
        if events:
            progress("again without moments that do not fit", 0.6)
            calm = set_apart(tracks, events)
            return replace(_analysed(calm, nominal, quiet), events=tuple(events))
    return findings


def _analysed(tracks: Sequence[Track], nominal: Nominal, progress: Progress) -> Findings:
    progress("predicting", 0.0)
    problem = Problem(tracks, nominal)
    progress("naming", 0.3)
    found = search(problem, lambda share: progress("naming", 0.3 + 0.3 * share))
    progress("looking at what is left over", 0.6)
    # Of a vehicle that the suite does not know, healthy noise is not known either.
    fits = [] if nominal.calibrated else scatter_fits(tracks, nominal, problem.theta)
    noisy = best_scatter(fits)
    theta = found.best.fit.theta.copy()
    for fit in sorted(fits, key=lambda each: each.evidence):
        if fit in noisy or _healthy(fit, theta, nominal):
            theta[list(fit.free)] = fit.value
    measured = left_powers(problem, found.best.fit)
    expected = chance_powers(problem, theta)
    before = left_powers(problem, problem.nothing)
    explained, removed = _explained(before, measured, expected)
    rest = leftovers(measured, expected)
    gusts = None
    repeats = 0.0
    loud = any(each.excess > 0.0 and each.channel.startswith(_FORCES) for each in rest)
    if loud:
        repeats = foretold(problem, found.best.fit, _FORCES)
    if loud and not nominal.calibrated:
        blown = fit_gusts(problem, replace(found.best.fit, theta=theta), measured)
        if blown.evidence > ADDS:
            gusts = blown
            expected = chance_powers(problem, blown.theta)
            rest = leftovers(measured, expected)
    judgement = judge(found, noisy, gusts, rest, repeats, explained, removed, nominal)
    return Findings(
        problem, found, tuple(noisy), tuple(fits), gusts, expected, tuple(rest), repeats, judgement
    )


def _healthy(fit: ScatterFit, theta: NDArray[np.float64], nominal: Nominal) -> bool:
    """Return whether noise is within a few tolerances of its nominal value."""
    return len(fit.free) == 1 and all(
        abs(value - float(theta[i])) < _HEALTHY * nominal.parameters[i].tolerance
        for i, value in zip(fit.free, fit.value, strict=True)
    )


def _explained(before: Powers, after: Powers, expected: Powers) -> tuple[float, float]:
    """Return the shares of the excess that an explanation takes away.

    The mean over the channels that it concerns, and of the sum over all channels.
    """
    worst = {each.channel: each for each in leftovers(after, expected)}
    concerned = []
    total = rest = 0.0
    for was in leftovers(before, expected):
        now = worst[was.channel]
        much = max((was.measured / was.expected) ** 2 - 1.0, 0.0)
        less = max((now.measured / now.expected) ** 2 - 1.0, 0.0)
        total += much
        rest += less
        if less < _CONCERNS * much:
            concerned.append(1.0 - less / much)
    mean = sum(concerned) / len(concerned) if concerned else 0.0
    return mean, max(0.0, 1.0 - rest / total) if total > 0.0 else 0.0
