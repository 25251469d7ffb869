"""Analysis of flights: the engine's search, and the test against unknown causes."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

from scipy.special import expit

from tombo_bag.flight import Finding
from tombo_diagnosis.engine.model import Analysis, Explanation, Remainder, SearchResult
from tombo_diagnosis.engine.model_selection import LOG_BF_FIRST, rank_hypotheses, restrict_to
from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.engine.verdict import analyse_problem, judge, p_cause
from tombo_diagnosis.flight.fit.prediction import channel_group
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import WIND, Track
from tombo_diagnosis.flight.fit.transients import exclude_spans, find_transients, lost_memories
from tombo_diagnosis.flight.noise import NoiseFit, fit_noise_effects
from tombo_diagnosis.flight.nominal import NominalModel
from tombo_diagnosis.flight.residual_check import (
    GustFit,
    ResidualExcess,
    ScaleVariances,
    cross_validated_r2,
    fit_gusts,
    noise_variances,
    residual_excesses,
    residual_variances,
    with_healthy,
)
from tombo_diagnosis.flight.swing import along, with_swing
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY, Stage
from tombo_dynamics.effects.compose import layout
from tombo_flight.progress import ProgressCallback, no_progress

MAX_LOG_VARIANCE_EXCESS = 0.6
"""Excess (logarithm of a ratio of variances) up to which a remainder counts as noise."""
_FORCE_EFFECTS = frozenset(
    name for name, e in REGISTRY.items() if e.stage in (Stage.WRENCH, Stage.AIR)
)
"""Effects that push the vehicle."""
UNCERTAIN_VERDICTS = ("unknown", "partly_explained")
"""Verdicts that leave something unexplained."""
_DYNAMICS = frozenset({"force", "moment"})
"""Groups of channels that have to be clean before anything is named: what pushes the vehicle in a
way that is not known is imitated by causes in any other group."""
_MIN_FLIGHTS_FOR_SHARE = 3
"""Flights that show whether one of them holds the excess."""
_MAX_EXCESS_LEFT_SHARE = 0.5
"""A cause concerns a channel if it reduces the excess there below this share."""
_MAX_HEALTHY_NOISE_TOLERANCES = 4.0
"""Noise within this number of tolerances of its nominal value is taken as measured."""
_MAX_GUST_R2 = 0.1
"""Largest cross-validated R² of a remainder that can be gusts."""
_MIN_EXPLAINED_CALIBRATED, _MIN_REMOVED_CALIBRATED, _MAX_R2_CALIBRATED = 0.7, 0.5, 0.3
"""Where healthy flights are not known: least explained share of the excess in the causes'
channels; the same of all forces; share of the remainder that other flights may predict."""
_MAX_PREDICTED_SHARE = 0.02
"""Share of the excess of the forces that other flights may predict, whatever of the remainder."""
_MAX_SHARE_OF_ONE_FLIGHT = 0.8
"""Largest share of the excess of the forces that one of several flights may hold with gusts."""
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
    """Excess over gusts and noise of each channel, the largest first."""
    residual_r2: float = 0.0
    """Share of the forces' remainder that other flights predict."""
    unexplained_groups: tuple[str, ...] = ()
    """Groups of channels with more than noise, the largest excess first."""
    excluded: tuple[Finding, ...] = ()
    """Short disturbances, and where an effect's memory is lost: they were excluded."""


FlightAnalysis = Analysis[FlightProblem, FlightRemainder]


def analyse(
    tracks: Sequence[Track], nominal: NominalModel, progress: ProgressCallback = no_progress
) -> FlightAnalysis:
    """Diagnose flights as recorded, then by each of `PASSES` in turn."""
    progress("predicting", 0.0)
    findings = analyse_problem(FlightProblem(tracks, nominal), check_residual, progress)
    for analyse_further in PASSES:
        progress("analysing again", 0.6)
        again = analyse_further(findings)
        if again is not None:
            excluded = dict.fromkeys((*findings.remainder.excluded, *again.remainder.excluded))
            findings = _excluding(again, excluded)
    return findings


def analyse_again(problem: FlightProblem, excluded: Iterable[Finding] = ()) -> FlightAnalysis:
    """Search for the causes of a problem; `excluded`: spans that it is without."""
    return _excluding(analyse_problem(problem, check_residual, no_progress), excluded)


def _excluding(findings: FlightAnalysis, excluded: Iterable[Finding]) -> FlightAnalysis:
    return replace(findings, remainder=replace(findings.remainder, excluded=tuple(excluded)))


def without_lost_memories(findings: FlightAnalysis) -> FlightAnalysis | None:
    """Analyse what can be followed, where an effect with a memory is at work.

    Findings that are explained without the effect need no second look.
    """
    judgement, problem = findings.judgement, findings.problem
    effects = {effect for linear in problem.linears for effect in linear.lost}
    if judgement.verdict not in UNCERTAIN_VERDICTS:
        effects &= {*judgement.effects, *judgement.members}
    lost = lost_memories(problem, effects)
    left = exclude_spans(problem.tracks, lost) if lost else []
    if not left:
        return None
    followed = FlightProblem(left, problem.nominal)
    null = Explanation((), followed.null_hypothesis, 0.0)
    ranked = rank_hypotheses(followed, null)
    if not any(h.effect in effects for gain, h in ranked if gain > 0.0):
        return None
    again = analyse_again(followed, chain.from_iterable(lost))
    named = {*again.judgement.effects, *again.judgement.members}
    return again if effects & named else None


def in_swinging_air(findings: FlightAnalysis) -> FlightAnalysis | None:
    """Analyse with the swing of a wind, where one is left and its mean is a cause.

    A force that swings without a mean is neither wind nor gusts: it may be a push as well.
    """
    judgement, problem, best = findings.judgement, findings.problem, findings.search.best
    if judgement.verdict not in UNCERTAIN_VERDICTS and "gusts" not in judgement.effects:
        return None
    # A map that is turned would turn the swing with it.
    kept = [e for e in best.effects if REGISTRY[e].stage is not Stage.MOCAP]
    tracks = with_swing(problem, restrict_to(problem, best, kept).fit)
    if tracks is None:
        return None
    again = analyse_again(FlightProblem(tracks, problem.nominal))
    if WIND in again.judgement.effects and along(tracks, *mean_wind(again)):
        return again
    return _without_gusts(findings)


def without_transients(findings: FlightAnalysis) -> FlightAnalysis | None:
    """Analyse doubtful findings without the moments that no effect describes."""
    problem = findings.problem
    if findings.judgement.verdict not in UNCERTAIN_VERDICTS:
        return None
    events = find_transients(problem, findings.search.best.fit)
    if not events:
        return None
    quiet = FlightProblem(exclude_spans(problem.tracks, events), problem.nominal)
    return analyse_again(quiet, chain.from_iterable(events))


PASSES: Sequence[Callable[[FlightAnalysis], FlightAnalysis | None]] = (
    without_lost_memories, in_swinging_air, without_transients,
)  # fmt: skip
"""Further analyses in this order, each on the findings of the one before: None without a reason
for it, or if it explains nothing more."""


def _without_gusts(findings: FlightAnalysis) -> FlightAnalysis | None:
    """Return findings whose gusts are an unknown force; None without gusts."""
    left = findings.remainder
    if left.gusts is None:
        return None
    left = replace(
        left, gusts=None, clean=False, clean_where_explained=False, imitated={},
        noise_log_bf={e: v for e, v in left.noise_log_bf.items() if e != "gusts"},
        p_unexplained=max(left.p_unexplained, p_cause(left.gusts.evidence)),
        unexplained_groups=tuple(dict.fromkeys((*left.unexplained_groups, "force"))),
    )  # fmt: skip
    judgement = judge(findings.problem.setting, findings.search, left)
    return replace(findings, remainder=left, judgement=judgement)


def mean_wind(findings: FlightAnalysis) -> tuple[float, float]:
    """Return the velocity of the air along map x, y that the best explanation has [m/s]."""
    places = layout()[WIND]
    theta = findings.problem.final(findings.search.best.fit)
    return float(theta[places["east"]]), float(theta[places["north"]])


def check_residual(problem: FlightProblem, result: SearchResult) -> FlightRemainder:
    """Return the remainder of the best explanation, tested against known noise and gusts.

    Expected are the variances that healthy noise leaves, and stochastic effects where sensors
    show them; the remainder is the excess over them, by channel. Gusts are fitted last, and only
    to forces that nothing else explains: they can imitate any force.

    Args:
        problem: flights, their predictions and the nominal model.
        result: the search for causes, whose best explanation is tested.
    """
    nominal, best = problem.nominal, result.best.fit
    # Of a vehicle that the suite does not know, healthy noise is not known either.
    fits = [] if nominal.calibrated else fit_noise_effects(problem.tracks, nominal, problem.theta)
    least_log_bf = LOG_BF_FIRST + problem.setting.log_prior_cost
    noise_fits = select_noise_fits(fits, least_log_bf)
    theta = best.theta.copy()
    for fit in sorted(fits, key=lambda each: each.evidence):  # the most probable is set last
        if fit in noise_fits or _within_tolerance(fit, theta, nominal):
            theta[list(fit.free)] = fit.value
    measured = residual_variances(problem, best)
    expected = with_healthy(noise_variances(problem, theta), nominal.healthy)
    before = residual_variances(problem, problem.null_hypothesis)
    explanation = explained_excess(before, measured, expected)
    excesses = residual_excesses(measured, expected)
    gusts = None
    residual_r2 = 0.0
    forces_unexplained = any(each.excess > 0.0 and each.of_forces for each in excesses)
    if forces_unexplained:
        residual_r2 = cross_validated_r2(problem, best)
    if (
        forces_unexplained
        and not nominal.calibrated
        and _share_of_one_flight(problem, best, expected) <= _MAX_SHARE_OF_ONE_FLIGHT
    ):
        gust_fit = fit_gusts(problem, replace(best, theta=theta), measured)
        if gust_fit.evidence > least_log_bf and gust_fit.stronger:
            gusts = gust_fit
            expected = with_healthy(noise_variances(problem, gust_fit.theta), nominal.healthy)
            excesses = residual_excesses(measured, expected)
    return weigh_remainder(
        FlightRemainder(
            clean=False, p_unexplained=0.0, mostly_explained=False,  # `weigh_remainder` sets them
            scatter=tuple(noise_fits), all_noise_fits=tuple(fits),
            gusts=gusts, expected=expected, residual_excesses=tuple(excesses),
            residual_r2=residual_r2,
        ),
        explanation,
        nominal.calibrated,
    )  # fmt: skip


def _share_of_one_flight(problem: FlightProblem, fit: Fit, expected: ScaleVariances) -> float:
    """Return the largest share of the excess of the forces that a single flight holds.

    Of two flights or one: zero, as nothing tells which of them is usual. Air moves in every
    flight; a wall, a cable or a knock may be there in one.
    """
    if len(problem.tracks) < _MIN_FLIGHTS_FOR_SHARE:
        return 0.0
    excess = []
    for f in range(len(problem.tracks)):
        each = residual_excesses(residual_variances(problem, fit, (f,)), expected)
        excess.append(sum(e.beyond for e in each if e.of_forces))
    return max(excess) / sum(excess) if sum(excess) > 0.0 else 0.0


def weigh_remainder(
    remainder: FlightRemainder, explanation: ExplainedExcess, thrust_fitted: bool
) -> FlightRemainder:
    """Return a remainder with its meaning filled in.

    `explanation` is what the best explanation takes away of the excess. `thrust_fitted`: thrust
    was fitted to the same flights, so healthy noise is not known.
    """
    gusts = remainder.gusts
    accepted = gusts is not None and remainder.residual_r2 < _MAX_GUST_R2 and not gusts.at_edge
    excess = max((each.excess for each in remainder.residual_excesses), default=-math.inf)
    unexplained = [
        e for e in remainder.residual_excesses if not e.excess <= MAX_LOG_VARIANCE_EXCESS
    ]
    groups = tuple(dict.fromkeys(channel_group(e.channel) for e in unexplained))
    if thrust_fitted:
        predicted = remainder.residual_r2 * (1.0 - explanation.of_forces)
        clean = (
            explanation.mean > _MIN_EXPLAINED_CALIBRATED
            and explanation.of_forces > _MIN_REMOVED_CALIBRATED
            and (remainder.residual_r2 < _MAX_R2_CALIBRATED or predicted < _MAX_PREDICTED_SHARE)
        )
        mostly = min(explanation.mean, explanation.of_forces) > _MIN_PARTIAL_SHARE_CALIBRATED
        clean_where_explained = clean
    else:
        clean = not unexplained
        mostly = explanation.total > _MIN_PARTIAL_SHARE
        concerned = explanation.concerned
        # What sensors say of each other, no force that is not known can make: only what acts on
        # the motion is in doubt where motion is left unexplained.
        doubted = _DYNAMICS if not concerned or concerned & _DYNAMICS else frozenset()
        clean_where_explained = not (concerned | doubted) & {*groups}
    odds = _UNEXPLAINED_SLOPE * (excess - _UNEXPLAINED_EVEN_EXCESS)
    p_left = float(expit(odds)) if math.isfinite(excess) else 0.5
    noise = {fit.effect: fit.evidence for fit in remainder.scatter}
    if gusts is not None and accepted:
        noise["gusts"] = gusts.evidence
    elif gusts is not None:
        clean = clean_where_explained = False
        p_left = max(p_left, p_cause(gusts.evidence))
    return replace(
        remainder, clean=clean, p_unexplained=p_left, mostly_explained=mostly, noise_log_bf=noise,
        imitated={"gusts": _FORCE_EFFECTS - {"gusts"}} if accepted else {},
        clean_where_explained=clean_where_explained, unexplained_groups=groups,
    )  # fmt: skip


def select_noise_fits(fits: Sequence[NoiseFit], least: float = LOG_BF_FIRST) -> list[NoiseFit]:
    """Return the stochastic effects that are accepted, by their best way, most probable first.

    `least`: log Bayes factor above which an effect is accepted.
    """
    best: dict[str, NoiseFit] = {}
    for fit in fits:
        if fit.effect not in best or best[fit.effect].evidence < fit.evidence:
            best[fit.effect] = fit
    chosen = [fit for fit in best.values() if fit.evidence > least]
    return sorted(chosen, key=lambda fit: -fit.evidence)


def _within_tolerance(fit: NoiseFit, theta: Array, nominal: NominalModel) -> bool:
    """Return whether noise is within a few tolerances of its nominal value."""
    return len(fit.free) == 1 and all(
        abs(value - float(theta[i]))
        < _MAX_HEALTHY_NOISE_TOLERANCES * nominal.parameters[i].tolerance
        for i, value in zip(fit.free, fit.value, strict=True)
    )


@dataclass(frozen=True)
class ExplainedExcess:
    """Shares of the excess over noise that an explanation removes."""

    mean: float
    """Mean over the channels that it concerns."""
    total: float
    """Share of the sum over all channels."""
    of_forces: float
    """Share of the sum over the forces."""
    concerned: frozenset[str]
    """Groups of the channels that it concerns."""


def explained_excess(
    before: ScaleVariances, after: ScaleVariances, expected: ScaleVariances
) -> ExplainedExcess:
    """Return the shares of the excess over noise that an explanation removes.

    `before`, `after`: residual variances without and with it; `expected`: those of noise. The
    excess is that of a channel's variance at its worst time scale, over the expected one.
    """
    left = {each.channel: each.beyond for each in residual_excesses(after, expected)}
    every = residual_excesses(before, expected)
    concerned = [e for e in every if left[e.channel] < _MAX_EXCESS_LEFT_SHARE * e.beyond]
    shares = [1.0 - left[each.channel] / each.beyond for each in concerned]

    def removed_share(some: Sequence[ResidualExcess]) -> float:
        total = sum(each.beyond for each in some)
        kept = sum(left[each.channel] for each in some)
        return max(0.0, 1.0 - kept / total) if total > 0.0 else 0.0

    return ExplainedExcess(
        sum(shares) / len(shares) if shares else 0.0,
        removed_share(every),
        removed_share([each for each in every if each.of_forces]),
        frozenset(channel_group(each.channel) for each in concerned),
    )
