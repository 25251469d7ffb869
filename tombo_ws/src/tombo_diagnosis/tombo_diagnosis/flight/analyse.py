"""What the flights call for: the whole analysis, in order."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.flight.gust_fit import GustFit, fit_gusts
from tombo_diagnosis.flight.model_selection import LOG_BF_FIRST, SearchResult, search
from tombo_diagnosis.flight.noise_statistics import NoiseFit, fit_noise_effects
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.problem import Problem
from tombo_diagnosis.flight.residual_predictability import cross_validated_r2
from tombo_diagnosis.flight.residual_test import (
    ResidualExcess,
    ScaleVariances,
    noise_variances,
    residual_excesses,
    residual_variances,
)
from tombo_diagnosis.flight.track import Track
from tombo_diagnosis.flight.transients import Transient, exclude_transients, find_transients
from tombo_diagnosis.flight.verdict import Judgement, judge, select_noise_fits

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
    search: SearchResult
    scatter: tuple[NoiseFit, ...]
    """Effects of chance that earn their place."""
    all_noise_fits: tuple[NoiseFit, ...]
    """All of them that were looked at."""
    gusts: GustFit | None
    expected: ScaleVariances
    """What chance leaves over, as far as it is explained."""
    residual_excesses: tuple[ResidualExcess, ...]
    residual_r2: float
    judgement: Judgement
    events: tuple[Transient, ...] = ()
    """Moments that were set apart."""


def no_progress(stage: str, share: float) -> None:
    """Report nothing."""


def analyse(
    tracks: Sequence[Track], nominal: NominalModel, progress: Progress = no_progress
) -> Findings:
    """Name what the flights call for; where moments do not fit, without these moments."""
    findings = _analysed(tracks, nominal, progress)
    if findings.judgement.verdict in _DOUBTS:
        events = find_transients(findings.problem, findings.search.best.fit)
        if events:
            progress("again without moments that do not fit", 0.6)
            without_transients = exclude_transients(tracks, events)
            return replace(
                _analysed(without_transients, nominal, no_progress), events=tuple(events)
            )
    return findings


def _analysed(tracks: Sequence[Track], nominal: NominalModel, progress: Progress) -> Findings:
    progress("predicting", 0.0)
    problem = Problem(tracks, nominal)
    progress("naming", 0.3)
    found = search(problem, lambda share: progress("naming", 0.3 + 0.3 * share))
    progress("looking at what is left over", 0.6)
    # Of a vehicle that the suite does not know, healthy noise is not known either.
    fits = [] if nominal.calibrated else fit_noise_effects(tracks, nominal, problem.theta)
    noise_fits = select_noise_fits(fits)
    theta = found.best.fit.theta.copy()
    for fit in sorted(fits, key=lambda each: each.evidence):
        if fit in noise_fits or _within_tolerance(fit, theta, nominal):
            theta[list(fit.free)] = fit.value
    measured = residual_variances(problem, found.best.fit)
    expected = noise_variances(problem, theta)
    before = residual_variances(problem, problem.null_hypothesis)
    explained, removed = _explained(before, measured, expected)
    rest = residual_excesses(measured, expected)
    gusts = None
    residual_r2 = 0.0
    forces_unexplained = any(
        each.excess > 0.0 and each.channel.startswith(_FORCES) for each in rest
    )
    if forces_unexplained:
        residual_r2 = cross_validated_r2(problem, found.best.fit, _FORCES)
    if forces_unexplained and not nominal.calibrated:
        blown = fit_gusts(problem, replace(found.best.fit, theta=theta), measured)
        if blown.evidence > LOG_BF_FIRST:
            gusts = blown
            expected = noise_variances(problem, blown.theta)
            rest = residual_excesses(measured, expected)
    judgement = judge(found, noise_fits, gusts, rest, residual_r2, explained, removed, nominal)
    return Findings(
        problem,
        found,
        tuple(noise_fits),
        tuple(fits),
        gusts,
        expected,
        tuple(rest),
        residual_r2,
        judgement,
    )


def _within_tolerance(fit: NoiseFit, theta: NDArray[np.float64], nominal: NominalModel) -> bool:
    """Return whether noise is within a few tolerances of its nominal value."""
    return len(fit.free) == 1 and all(
        abs(value - float(theta[i])) < _HEALTHY * nominal.parameters[i].tolerance
        for i, value in zip(fit.free, fit.value, strict=True)
    )


def _explained(
    before: ScaleVariances, after: ScaleVariances, expected: ScaleVariances
) -> tuple[float, float]:
    """Return the shares of the excess that an explanation takes away.

    The mean over the channels that it concerns, and of the sum over all channels.
    """
    worst = {each.channel: each for each in residual_excesses(after, expected)}
    concerned = []
    total = rest = 0.0
    for was in residual_excesses(before, expected):
        now = worst[was.channel]
        much = max((was.measured / was.expected) ** 2 - 1.0, 0.0)
        less = max((now.measured / now.expected) ** 2 - 1.0, 0.0)
        total += much
        rest += less
        if less < _CONCERNS * much:
            concerned.append(1.0 - less / much)
    mean = sum(concerned) / len(concerned) if concerned else 0.0
    return mean, max(0.0, 1.0 - rest / total) if total > 0.0 else 0.0
