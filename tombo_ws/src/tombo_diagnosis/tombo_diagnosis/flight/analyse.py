"""Analysis of flights: the engine's search, and the test against unknown causes."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from tombo_diagnosis.engine.analyse import analyse_problem
from tombo_diagnosis.engine.model import Findings, Remainder, SearchResult
from tombo_diagnosis.engine.model_selection import LOG_BF_FIRST
from tombo_diagnosis.engine.verdict import logistic, p_cause
from tombo_diagnosis.flight.fit.gust_fit import GustFit, fit_gusts
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import Track
from tombo_diagnosis.flight.fit.transients import Transient, exclude_transients, find_transients
from tombo_diagnosis.flight.noise.noise_statistics import NoiseFit, fit_noise_effects
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.residual_check import (
    ResidualExcess,
    ScaleVariances,
    noise_variances,
    residual_excesses,
    residual_variances,
)
from tombo_diagnosis.flight.residual_predictability import cross_validated_r2
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY, Stage
from tombo_flight.progress import ProgressCallback, no_progress

MAX_LOG_VARIANCE_EXCESS = 0.6
"""Excess (logarithm of a ratio of variances) up to which a remainder counts as noise."""
_FORCES = ("force", "acceleration")
_FORCE_EFFECTS = frozenset(
    name for name, e in REGISTRY.items() if e.stage in (Stage.WRENCH, Stage.AIR)
)
"""Effects that push the vehicle."""
_DOUBTS = ("unknown", "partly_explained")
_CONCERNS = 0.5
"""A cause concerns a channel if it reduces the excess there below this share."""
_HEALTHY = 4.0
"""Noise within this number of tolerances of its nominal value is taken as measured."""
_MAX_GUST_R2 = 0.1
"""Largest cross-validated R² of a remainder that can be gusts."""
_MIN_EXPLAINED_CALIBRATED, _MAX_R2_CALIBRATED = 0.7, 0.5
"""Share of the excess that causes have to explain, and share of the remainder that other flights
may predict, where healthy flights are not known."""
_MIN_PARTIAL_SHARE, _MIN_PARTIAL_SHARE_CALIBRATED = 0.85, 0.5
"""Least share of all excess that a cause removes if it is called part of it."""
_UNEXPLAINED_SLOPE, _UNEXPLAINED_EVEN_EXCESS = 3.0, 0.2
"""Probability that something is unexplained: fitted to synthetic cases of other seeds."""


@dataclass(frozen=True)
class FlightRemainder(Remainder):
    """Remainder of the flights' channels under the best explanation."""

    scatter: tuple[NoiseFit, ...] = ()
    """Stochastic effects that are accepted."""
    all_noise_fits: tuple[NoiseFit, ...] = ()
    """All that were fitted."""
    gusts: GustFit | None = None
    expected: ScaleVariances = field(kw_only=True)
    """Variances that noise leaves, with the causes of noise that were found."""
    residual_excesses: tuple[ResidualExcess, ...] = ()
    """What is left unexplained, gusts and noise taken into account; the largest excess first."""
    residual_r2: float = 0.0
    """Share of the forces' remainder that other flights predict."""
    transients: tuple[Transient, ...] = ()
    """Short disturbances that were excluded."""


FlightFindings = Findings[FlightProblem, FlightRemainder]


def analyse(
    tracks: Sequence[Track], nominal: NominalModel, progress: ProgressCallback = no_progress
) -> FlightFindings:
    """Diagnose flights; if the result is in doubt, again without transients."""
    findings = _analysed(tracks, nominal, progress)
    if findings.judgement.verdict in _DOUBTS:
        events = find_transients(findings.problem, findings.search.best.fit)
        if events:
            progress("again without moments that do not fit", 0.6)
            again = _analysed(exclude_transients(tracks, events), nominal, no_progress)
            return replace(again, remainder=replace(again.remainder, transients=tuple(events)))
    return findings


def _analysed(
    tracks: Sequence[Track], nominal: NominalModel, progress: ProgressCallback
) -> FlightFindings:
    progress("predicting", 0.0)
    return analyse_problem(FlightProblem(tracks, nominal), check_residual, progress)


def check_residual(problem: FlightProblem, found: SearchResult) -> FlightRemainder:
    """Return the remainder of the best explanation, tested against known noise and gusts."""
    nominal, best = problem.nominal, found.best.fit
    # Of a vehicle that the suite does not know, healthy noise is not known either.
    fits = [] if nominal.calibrated else fit_noise_effects(problem.tracks, nominal, problem.theta)
    noise_fits = select_noise_fits(fits)
    theta = best.theta.copy()
    for fit in sorted(fits, key=lambda each: each.evidence):
        if fit in noise_fits or _within_tolerance(fit, theta, nominal):
            theta[list(fit.free)] = fit.value
    measured = residual_variances(problem, best)
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
        residual_r2 = cross_validated_r2(problem, best, _FORCES)
    if forces_unexplained and not nominal.calibrated:
        gust_fit = fit_gusts(problem, replace(best, theta=theta), measured)
        if gust_fit.evidence > LOG_BF_FIRST:
            gusts = gust_fit
            expected = noise_variances(problem, gust_fit.theta)
            rest = residual_excesses(measured, expected)
    return weigh_remainder(
        FlightRemainder(
            False, 0.0, False, explained=explained, scatter=tuple(noise_fits),
            all_noise_fits=tuple(fits), gusts=gusts, expected=expected,
            residual_excesses=tuple(rest), residual_r2=residual_r2,
        ),
        removed,
        nominal.calibrated,
    )  # fmt: skip


def weigh_remainder(
    found: FlightRemainder, removed: float, thrust_fitted: bool
) -> FlightRemainder:
    """Return a remainder with its meaning filled in.

    `removed` is the share of the excess of all channels that the best explanation takes away.
    `thrust_fitted`: thrust was fitted to the same flights, so healthy noise is not known.
    """
    gusts, explained = found.gusts, found.explained
    accepted = gusts is not None and found.residual_r2 < _MAX_GUST_R2 and not gusts.at_edge
    excess = max((each.excess for each in found.residual_excesses), default=-math.inf)
    if thrust_fitted:
        clean = explained > _MIN_EXPLAINED_CALIBRATED and found.residual_r2 < _MAX_R2_CALIBRATED
        mostly = explained > _MIN_PARTIAL_SHARE_CALIBRATED
    else:
        clean = excess <= MAX_LOG_VARIANCE_EXCESS
        mostly = removed > _MIN_PARTIAL_SHARE
    odds = _UNEXPLAINED_SLOPE * (excess - _UNEXPLAINED_EVEN_EXCESS)
    p_left = logistic(odds) if math.isfinite(excess) else 0.5
    noise = {fit.effect: fit.evidence for fit in found.scatter}
    if gusts is not None and accepted:
        noise["gusts"] = gusts.evidence
    elif gusts is not None:
        clean, p_left = False, max(p_left, p_cause(gusts.evidence))
    return replace(
        found, clean=clean, p_unexplained=p_left, mostly_explained=mostly, noise_log_bf=noise,
        imitated={"gusts": _FORCE_EFFECTS - {"gusts"}} if accepted else {},
    )  # fmt: skip


def select_noise_fits(fits: Sequence[NoiseFit]) -> list[NoiseFit]:
    """Return the stochastic effects that are accepted, by their best way, most probable first."""
    best: dict[str, NoiseFit] = {}
    for fit in fits:
        if fit.effect not in best or best[fit.effect].evidence < fit.evidence:
            best[fit.effect] = fit
    chosen = [fit for fit in best.values() if fit.evidence > LOG_BF_FIRST]
    return sorted(chosen, key=lambda fit: -fit.evidence)


def _within_tolerance(fit: NoiseFit, theta: Array, nominal: NominalModel) -> bool:
    """Return whether noise is within a few tolerances of its nominal value."""
    return len(fit.free) == 1 and all(
        abs(value - float(theta[i])) < _HEALTHY * nominal.parameters[i].tolerance
        for i, value in zip(fit.free, fit.value, strict=True)
    )


def _explained(
    before: ScaleVariances, after: ScaleVariances, expected: ScaleVariances
) -> tuple[float, float]:
    """Return the shares of the excess that an explanation removes.

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
