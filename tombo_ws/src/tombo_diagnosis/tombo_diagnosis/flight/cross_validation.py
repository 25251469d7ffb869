"""How much better the extended model predicts flights that neither named nor fitted it.

No cause may make a prediction surely worse: one that does is taken away.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_diagnosis.engine.cause_estimates import gain_of, rms
from tombo_diagnosis.engine.model import Explanation, SearchResult
from tombo_diagnosis.engine.model_selection import LOG_BF_ADDITIONAL, LOG_BF_FIRST, restrict_to
from tombo_diagnosis.engine.regression import Fit, solve
from tombo_diagnosis.flight.analyse import FlightAnalysis, analyse_again
from tombo_diagnosis.flight.fit.prediction import (
    motion_of,
    residuals,
    simulate_along_motion,
    with_air,
)
from tombo_diagnosis.flight.fit.problem import FlightProblem, sum_of, tangent_of
from tombo_diagnosis.flight.fit.sensitivity import with_scatter
from tombo_diagnosis.flight.fit.track import TICK
from tombo_diagnosis.flight.nominal import SCATTER
from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import State
from tombo_dynamics.rotation import conjugate, quaternion_multiply
from tombo_flight.extended_model import Gain
from tombo_logs.checks.even_flight import IMU_WIDTH, smooth
from tombo_sim.inverse_simulation import open_loop

HORIZONS_S = (0.5, 1.0)
_UNITS = {"position": "m", "velocity": "m/s", "attitude": "rad"}
_VELOCITY_WIDTH = 0.05
"""s: deviation of the Gaussian weight by which a window's first and last velocity are taken: of
poses to 0.7 mm it knows them to some mm/s."""
_HELD_DEVIATION_FACTOR = 1e-4
"""Factor on the prior deviation of an unknown that stays where other flights put it."""
_HELD_SLACK = 1e-3
"""Tolerances by which a parameter may pass its bound in flights that are predicted."""


@dataclass(frozen=True)
class HeldOutPrediction:
    """A flight as a fit of other flights predicts it."""

    theta: Array
    """All parameters; other parameters as the other flights have them, within their tolerance."""
    draws: Array
    """(8) of the vehicle."""
    residual: dict[str, Array]
    """group -> (rows, channels): the remainder of the flight's channels."""


@dataclass(frozen=True)
class HeldOut:
    """A flight that was held out, predicted by two models that the other flights calibrated."""

    flight: int
    before: HeldOutPrediction
    """Prediction by the nominal model, with its parameters within their tolerances."""
    after: HeldOutPrediction
    """Prediction by the extended model, with its other parameters within theirs."""


def fit_without_flight(
    problem: FlightProblem, flight: int, tried: Sequence[Explanation]
) -> HeldOut:
    """Name and fit without a flight: the best of the fits that were tried, fitted again."""
    others = [f for f in range(len(problem.tracks)) if f != flight] or [flight]
    base, mean = _solved(problem, problem.null_hypothesis, others)
    before = _predicted(problem, problem.null_hypothesis, flight, mean)
    best: tuple[float, Fit, Array] | None = None
    for explanation in tried:
        evidence, mean = _solved(problem, explanation.fit, others)
        gain = evidence - base - LOG_BF_FIRST
        gain -= LOG_BF_ADDITIONAL * (len(explanation.hypotheses) - 1)
        if gain > 0.0 and (best is None or gain > best[0]):
            best = gain, explanation.fit, mean
    after = before if best is None else _predicted(problem, best[1], flight, best[2])
    return HeldOut(flight, before, after)


def _predicted(problem: FlightProblem, fit: Fit, flight: int, mean: Array) -> HeldOutPrediction:
    """Return a flight as a fit predicts it whose unknowns are those of other flights.

    The draws of a vehicle come from the fit; where each flight has draws of its own, from this
    flight: left to itself a simulation with rotors a percent too strong tips over in a second.
    Parameters that the nominal fit absorbs (bias, level) are calibrated in each flight, too.
    """
    unknowns, limits = problem.unknowns, problem.unknowns.deviations(fit.free, fit.prior_std_scale)
    mean = np.clip(mean, fit.prior_mean - 3.0 * limits, fit.prior_mean + 3.0 * limits)
    if unknowns.absorbed:
        calibrated = unknowns.places(sorted(unknowns.absorbed))
        deviations = _HELD_DEVIATION_FACTOR * limits
        deviations[calibrated] = limits[calibrated]
        centre = mean.copy()
        centre[calibrated] = fit.prior_mean[calibrated]
        mean = solve(tangent_of(fit).normals[flight], deviations, centre, covariance=False).mean
    theta = fit.theta.copy()
    for place, index in enumerate(unknowns.indices):
        p = unknowns.parameters[index]
        theta[index] = np.clip(theta[index] + mean[place], p.low, p.high)
    draws = np.zeros(8)
    if problem.drawn:
        first = problem.first_draw(flight)
        draw_means = mean if problem.vehicles == 1 else fit.solution.mean
        draws[problem.drawn] = draw_means[first : first + len(problem.drawn)]
        # Draws are in units of the nominal scatter, whatever a fit has made of its size.
        scale = problem.nominal.scatter.index
        theta[scale] = problem.theta[scale]
        theta, _ = with_scatter(theta, problem.nominal)
    residual = residuals(problem.tracks[flight], problem.nominal, theta, draws=draws)
    return HeldOutPrediction(theta, draws, residual)


def nominal_theta(problem: FlightProblem) -> Array:
    """Return the parameters of the model as it was, with what its own fit has taken up."""
    theta = problem.theta.copy()
    absorbed = sorted(problem.unknowns.absorbed)
    theta[absorbed] = problem.null_hypothesis.theta[absorbed]
    return theta


def nominal_residuals(problem: FlightProblem, flight: int) -> dict[str, Array]:
    """Return the residual of the nominal model in a flight, group -> (rows, channels)."""
    if not problem.unknowns.absorbed:
        return problem.linears[flight].residual
    return residuals(problem.tracks[flight], problem.nominal, nominal_theta(problem))


def _solved(problem: FlightProblem, fit: Fit, flights: Sequence[int]) -> tuple[float, Array]:
    """Return the evidence and the unknowns of a fit by some of the flights.

    A parameter that is not a cause stays at its nominal value if it would pass its bound: no
    propeller is stronger than new.
    """
    normal = sum_of([tangent_of(fit).normals[f] for f in flights])
    solution, _ = problem.solve_in_bounds(
        normal, fit.free, fit.prior_std_scale, fit.theta, fit.prior_mean,
        slack=_HELD_SLACK, pinned=fit.pinned, pin_free=False,
    )  # fmt: skip
    return solution.evidence, solution.mean


def extended(
    problem: FlightProblem, fit: Fit, flight: int, mean: Array | None = None
) -> dict[str, Array]:
    """Return the residual of the extended model in a flight, group -> (rows, channels).

    Only what is named counts of the unknowns; tolerances stay as the nominal model has them.
    `mean`: the fit's unknowns, if not those of all flights.
    """
    unknowns = problem.unknowns
    mean = fit.solution.mean if mean is None else mean
    draws = np.zeros(8)
    theta = nominal_theta(problem)
    for place in unknowns.places((*fit.free, *unknowns.absorbed)):
        p = unknowns.parameters[unknowns.indices[place]]
        theta[p.index] = np.clip(fit.theta[p.index] + mean[place], p.low, p.high)
    if fit.prior_std_scale.get(SCATTER, 1.0) > 1.01 and problem.vehicles == 1:
        draws[problem.drawn] = mean[len(unknowns.indices) :]
        theta, _ = with_scatter(theta, problem.nominal)
    return residuals(problem.tracks[flight], problem.nominal, theta, draws=draws)


def one_step_gains(problem: FlightProblem, held: Sequence[HeldOut]) -> list[Gain]:
    """Return the gain of every channel's equation error."""
    errors = []
    for each in held:
        for group, before in each.before.residual.items():
            channels, after = problem.channels[each.flight][group], each.after.residual[group]
            for c, old, new in zip(channels, before.T, after.T, strict=True):
                errors.append((c.name, c.unit, rms(old), rms(new)))
    return _gains(errors, "one step")


def open_loop_gains(problem: FlightProblem, held: Sequence[HeldOut]) -> list[Gain]:
    """Return the gain of open-loop simulation over each horizon.

    Position and velocity with the attitude that was measured, attitude by itself.
    """
    gains = []
    for horizon in HORIZONS_S:
        errors = []
        for each in held:
            before, after = (
                _window_errors(problem, each.flight, model, horizon)
                for model in (each.before, each.after)
            )
            for name, old in before.items():
                errors.append((name, _UNITS[name.split()[0]], rms(old), rms(after[name])))
        gains += _gains(errors, f"{horizon:g} s")
    return gains


def _gains(errors: Sequence[tuple[str, str, float, float]], horizon: str) -> list[Gain]:
    """Return the gains from each flight's channel, unit, and RMS errors before and after."""
    pairs: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for name, unit, before, after in errors:
        pairs.setdefault((name, unit), []).append((before, after))
    return [
        gain_of(name, unit, horizon, *zip(*values, strict=True))
        for (name, unit), values in pairs.items()
    ]


def _window_errors(
    problem: FlightProblem, flight: int, model: HeldOutPrediction, horizon: float
) -> dict[str, Array]:
    track, nominal = problem.tracks[flight], problem.nominal
    ticks = round(horizon / TICK)
    rows = np.interp(track.t, track.slow.t, track.slow_rows.astype(np.float64)) > 0.99
    starts = np.arange(0, track.t.size - ticks - 1, ticks)
    whole = np.concatenate([[0], np.cumsum(rows)])
    starts = starts[whole[starts + ticks] - whole[starts] == ticks]
    if not starts.size or not (track.command.size or track.speed.size):
        return {}
    theta, draws = model.theta, model.draws
    motion = motion_of(track, nominal, theta)
    along = simulate_along_motion(track, nominal, theta, motion, draws)
    command = track.command if track.command.size else track.speed[:, :4]
    smooth = _smooth(motion.state, rates_measured=track.gyro.size > 0)
    theta = with_air(track, theta)
    true = smooth[starts + ticks, :13]

    def flown(attitude_held: bool) -> Array:
        states = np.zeros(starts.size, State.layout)
        open_loop(
            nominal.plant(draws), nominal.maps, theta, TICK, smooth, command, track.speed,
            along, starts, ticks, attitude_held, states,
        )  # fmt: skip
        return states.view(np.float64).reshape(-1, 13)

    # Place and velocity along the attitude that was measured: else they show within half a second
    # how the rotors are balanced, whatever the force.
    off = flown(attitude_held=True) - true
    errors = {f"position {a}": off[:, i] for i, a in enumerate("xyz")}
    errors |= {f"velocity {a}": off[:, 3 + i] for i, a in enumerate("xyz")}
    if nominal.moments:
        out = flown(attitude_held=False)
        turn = quaternion_multiply(conjugate(true[:, 6:10]), out[:, 6:10])
        errors["attitude"] = 2.0 * np.arcsin(
            np.clip(np.linalg.norm(turn[:, :3], axis=1), 0.0, 1.0)
        )
    return errors


def _smooth(state: Array, rates_measured: bool) -> Array:
    """Return a motion whose velocity is not the noise of single poses; rows as they were.

    Its rates are not compared either, where they are differences of attitudes and not measured.
    """
    motion = state.copy()
    columns = [(slice(0, 6), _VELOCITY_WIDTH)]
    columns += [] if rates_measured else [(slice(10, 13), IMU_WIDTH)]
    for where, width in columns:
        motion[:, where] = smooth(state[:, where], width, TICK)
    return motion


def gain_by_effect(problem: FlightProblem, result: SearchResult) -> dict[str, float]:
    """Return effect -> share of the best explanation's gain, in flights not fitted on."""
    shares = {}
    best = result.best.fit
    flights = range(len(problem.tracks))
    whole = sum(_removed(problem, best, best.solution.mean, f) for f in flights)
    for explanation in (result.best, *result.alternatives):
        if len(explanation.hypotheses) != 1 or whole <= 0.0:
            continue
        removed = 0.0
        for f in flights:
            others = [k for k in flights if k != f] or [f]
            mean = _solved(problem, explanation.fit, others)[1]
            removed += _removed(problem, explanation.fit, mean, f)
        shares[explanation.effects[0]] = float(np.clip(removed / whole, 0.0, 1.0))
    return shares


def _removed(problem: FlightProblem, fit: Fit, mean: Array, flight: int) -> float:
    """Return the cost that what is named takes off a flight's; tolerances take nothing."""
    after = extended(problem, fit, flight, mean)
    before = nominal_residuals(problem, flight)
    return sum(
        float(np.sum((rows**2 - after[group] ** 2) / problem.variances[flight][group]))
        for group, rows in before.items()
    )


_MIN_REDUCTION = -0.1
"""Reduction of an error below which a change for the worse is one; less is what tolerances of
other parameters make of it when they are fitted again."""
_JUDGED_CHANNELS = (
    "force",
    "acceleration",
    "mocap against",
    "gyro against",
    "position",
    "velocity",
)
"""Channels that are judged: moments, speeds and voltage follow the balance of the rotors and the
state of the battery first, whatever the cause."""
_MAX_REFUSED = 3


def final_explanation(findings: FlightAnalysis) -> Explanation:
    """Return the explanation that goes into the model: the sure causes, or the most probable."""
    judgement = findings.judgement
    best = findings.search.best
    if judgement.verdict in ("none", "unknown"):
        return Explanation((), findings.problem.null_hypothesis, 0.0)
    if judgement.verdict == "set":
        return best
    return restrict_to(findings.problem, best, judgement.effects)


def held_out_gains(findings: FlightAnalysis, final: Explanation) -> list[Gain]:
    """Return how much better each channel of each flight is predicted by what others taught."""
    if not final.hypotheses:
        return []
    problem = findings.problem
    tried = [final]
    if len(final.hypotheses) > 1:
        tried += [restrict_to(problem, final, (effect,)) for effect in final.effects]
    tried += findings.search.alternatives if findings.judgement.members else ()
    held = [fit_without_flight(problem, f, tried) for f in range(len(problem.tracks))]
    return one_step_gains(problem, held) + open_loop_gains(problem, held)


def surely_worse(gains: Sequence[Gain]) -> list[Gain]:
    """Return the judged channels whose prediction gets surely worse (an interval below zero)."""
    return [
        g
        for g in gains
        if g.high < 0.0 and g.reduction < _MIN_REDUCTION and g.channel.startswith(_JUDGED_CHANNELS)
    ]


def refuse_contradicted(
    findings: FlightAnalysis,
) -> tuple[FlightAnalysis, Explanation, list[Gain], dict[str, str]]:
    """Take away causes that held-out flights contradict.

    A cause that makes the prediction of a channel surely worse goes, of several the least that
    does; then the search begins again without it.

    Returns:
        The findings after it, what goes into the model, its gain in held-out flights, and refused
        effect -> what speaks against it.
    """
    refused: dict[str, str] = {}
    while True:
        final = final_explanation(findings)
        gains = held_out_gains(findings, final)
        worse = surely_worse(gains)
        if not worse or len(refused) == _MAX_REFUSED:
            return findings, final, gains, refused
        worst = min(worse, key=lambda g: g.reduction)
        refused[_culprit(findings, final, worst)] = _refusal_text(worst)
        problem = findings.problem
        problem.refuse(refused)
        findings = analyse_again(problem, findings.remainder.excluded)


def _culprit(findings: FlightAnalysis, final: Explanation, worst: Gain) -> str:
    """Return the least of the causes without which a channel is not surely predicted worse.

    If there is none, the cause that the evidence misses least.
    """
    problem = findings.problem
    without = {
        effect: restrict_to(problem, final, [e for e in final.effects if e != effect])
        for effect in final.effects
    }
    least_first = sorted(without, key=lambda effect: -without[effect].evidence)
    for effect in least_first:
        left = surely_worse(held_out_gains(findings, without[effect]))
        if (worst.channel, worst.horizon) not in {(g.channel, g.horizon) for g in left}:
            return effect
    return least_first[0]


def _refusal_text(gain: Gain) -> str:
    return (
        f"with it {gain.channel} ({gain.horizon}) is predicted {-100.0 * gain.reduction:.0f} % "
        "worse in flights held out"
    )
