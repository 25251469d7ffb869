"""From measured flights to a diagnosis: the whole way, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from tombo_sysid.flight_log import FlightLog
from tombo_sysid.gust_fit import GustFit, fit_gusts
from tombo_sysid.leftover import Leftover, Powers, chance_powers, left_powers, leftovers
from tombo_sysid.naming import ADDS, Search, search
from tombo_sysid.nominal import Nominal
from tombo_sysid.candidates import PARAMETERS
from tombo_sysid.predictable import foretold
from tombo_sysid.problem import Problem
from tombo_sysid.scatter import ScatterFit, scatter_fits
from tombo_sysid.track import Track
from tombo_sysid.verdict import Judgement, best_scatter, judge

Progress = Callable[[str, float], None]
_FORCES = ("force", "acceleration")
_HEALTHY = 4.0
"""Noise off its nominal value by up to so many tolerances is taken as it is measured."""


@dataclass(frozen=True)
class Findings:
    """All that the analysis came to, before it is put into words."""

    problem: Problem
    search: Search
    scatter: tuple[ScatterFit, ...]
    """Effects of chance that earn their place."""
    gusts: GustFit | None
    expected: Powers
    """What chance leaves over, as far as it is explained."""
    leftovers: tuple[Leftover, ...]
    repeats: float
    judgement: Judgement


def quiet(stage: str, share: float) -> None:
    """Report nothing."""


def analyse(tracks: Sequence[Track], nominal: Nominal, progress: Progress = quiet) -> Findings:
    """Name what the flights call for."""
    progress("predicting", 0.0)
    problem = Problem(tracks, nominal)
    progress("naming", 0.3)
    found = search(problem, lambda share: progress("naming", 0.3 + 0.3 * share))
    progress("looking at what is left over", 0.6)
    fits = scatter_fits(tracks, nominal, problem.theta)
    noisy = best_scatter(fits)
    theta = found.best.fit.theta.copy()
    for fit in sorted(fits, key=lambda each: each.evidence):
        if fit in noisy or _healthy(fit, theta):
            theta[list(fit.free)] = fit.value
    measured = left_powers(problem, found.best.fit)
    expected = chance_powers(problem, theta)
    explained = _explained(left_powers(problem, problem.nothing), measured, expected)
    rest = leftovers(measured, expected)
    gusts = None
    repeats = 0.0
    if any(each.excess > 0.0 and each.channel.startswith(_FORCES) for each in rest):
        repeats = foretold(problem, found.best.fit, _FORCES)
        blown = fit_gusts(problem, replace(found.best.fit, theta=theta), measured)
        if blown.evidence > ADDS:
            gusts = blown
            expected = chance_powers(problem, blown.theta)
            rest = leftovers(measured, expected)
    judgement = judge(found, noisy, gusts, rest, repeats, explained, nominal)
    return Findings(
        problem, found, tuple(noisy), gusts, expected, tuple(rest), repeats, judgement
    )


def _healthy(fit: ScatterFit, theta: object) -> bool:
    """Return whether noise is within a few tolerances of its nominal value."""
    return len(fit.free) == 1 and all(
        abs(value - float(theta[i])) < _HEALTHY * PARAMETERS[i].tolerance  # type: ignore[index]
        for i, value in zip(fit.free, fit.value, strict=True)
    )


def _explained(before: Powers, after: Powers, expected: Powers) -> float:
    """Return the share of the excess, over all channels, that an explanation takes away."""
    worst_before = {each.channel: each for each in leftovers(before, expected)}
    total = rest = 0.0
    for each in leftovers(after, expected):
        was = worst_before[each.channel]
        total += max((was.measured / was.expected) ** 2 - 1.0, 0.0)
        rest += max((each.measured / each.expected) ** 2 - 1.0, 0.0)
    return max(0.0, 1.0 - rest / total) if total > 0.0 else 0.0
