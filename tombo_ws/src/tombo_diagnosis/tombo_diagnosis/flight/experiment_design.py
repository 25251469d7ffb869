"""The experiment that distinguishes causes: every manoeuvre is simulated with each of them.

Each manoeuvre is a mission that `tombo fly` flies; it takes at most 40 s and stays within
4 m x 4 m x 3 m about the place of take-off. For each the nominal model is flown. The slopes along
that flight say what each member of the set would change and how well the others could explain it.
The best manoeuvres are then flown with each member in turn and compared with all of them by the
analysis itself.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.diagnosis import Experiment
from tombo_diagnosis.engine.regression import NormalEquations, solve
from tombo_diagnosis.flight.analyse import FlightAnalysis
from tombo_diagnosis.flight.cause_estimates import estimate_cause
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.track import track_of
from tombo_diagnosis.flight.nominal import SCATTER, NominalModel
from tombo_diagnosis.wording import capital, listed
from tombo_dynamics.effects import REGISTRY
from tombo_dynamics.errors import InputError
from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.progress import ProgressCallback
from tombo_flight.scenario import extended_scenario

Waypoints = list[dict[str, float]]

_QUARTER = 1.5708


@dataclass(frozen=True)
class Manoeuvre:
    """A flight that excites certain effects."""

    name: str
    text: str
    """How it is done with a real vehicle, a sentence or two."""
    scenario: Mapping[str, Any]
    """A scenario of plain values, as in a file."""


def manoeuvre_catalogue() -> dict[str, Manoeuvre]:
    """Return all manoeuvres by name."""
    return {
        name: Manoeuvre(name, text, mission(name, text, course))
        for name, text, course in _courses()
    }


def mission(name: str, text: str, course: Waypoints) -> dict[str, Any]:
    """Return the scenario of a course: no obstacle, no reaction, and landing at its end."""
    return {
        "extends": "no_obstacle",
        "description": f"{name.replace('_', ' ').capitalize()}: {text}",
        "reaction": {"name": "none"},
        "control": {"velocity_max_xy": 3.0, "velocity_max_z": 1.8},
        "mission": {
            "takeoff_time": 0.5,
            "height": 1.2,
            "climb_speed": 0.9,
            "approach_time": 3.6,
            "land_time": 55.0,
            "land_speed": 0.5,
            "course": course,
        },
    }


def _courses() -> Iterable[tuple[str, str, Waypoints]]:
    """Return name, text and course of what can be flown."""
    yield (
        "turn_in_hover",
        "hover for two seconds each, heading by a quarter turn further, twice round.",
        [{"yaw": 0.0, "yaw_rate": 1.4, "hold": 2.0}]
        + [{"yaw": round(i * _QUARTER, 4)} for i in range(1, 9)],
    )
    yield (
        "both_ways",
        "fly the same leg there and back at one speed, along both axes, heading the same.",
        [
            {"x": -1.4, "speed": 1.4, "acceleration": 2.5, "hold": 0.3},
            *_shuttle("x", (1.4, -1.4, 1.4, -1.4, 0.0)),
            *_shuttle("y", (-1.4, 1.4, -1.4, 1.4, 0.0)),
        ],
    )
    yield (
        "three_speeds",
        "fly the same leg there and back at 0.7, 1.4 and 2.4 m/s.",
        [
            {"x": -1.6, "speed": 1.4, "acceleration": 3.0, "hold": 0.2},
            *({"x": x, "speed": v} for v in (2.4, 1.4, 0.7, 2.4) for x in (1.6, -1.6)),
        ],
    )
    yield (
        "two_heights",
        "hover low and high in turn, four seconds each, so that the voltage is nearly the same.",
        [{"z": z, "speed": 1.2, "acceleration": 1.5, "hold": 4.0} for z in (0.35, 2.2) * 2],
    )
    yield (
        "yaw_steps",
        "in hover, turn by a quarter to either side as quickly as the vehicle can.",
        [
            {"yaw": yaw, "yaw_rate": 5.0, "hold": 1.2}
            for yaw in (_QUARTER, 0.0, -_QUARTER, 0.0) * 3
        ],
    )
    yield (
        "rate_steps",
        "short quick legs ahead and sideways, so that the vehicle tilts as fast as it can.",
        [
            {"x": -0.3, "speed": 2.4, "acceleration": 5.0},
            *_shuttle("x", (0.3, -0.3) * 4 + (0.0,)),
            *_shuttle("y", (0.3, -0.3) * 4 + (0.0,)),
            *_shuttle("x", (0.6, -0.6) * 2 + (0.0,)),
            *_shuttle("y", (0.6, -0.6) * 2 + (0.0,)),
        ],
    )
    yield (
        "slow_to_quick",
        "rock ahead and sideways, slowly first, then quicker and quicker.",
        [
            {axis: place, "speed": 2.4, "acceleration": acceleration}
            for acceleration in (0.8, 1.5, 3.0, 4.0)
            for axis in ("x", "y")
            for place in (0.5, -0.5, 0.0)
        ],
    )
    yield (
        "square",
        "fly a square of 2 m, heading the same; then once more after a quarter turn.",
        [
            {"x": -1.0, "y": -1.0, "speed": 1.4, "acceleration": 2.5, "hold": 0.2},
            *_round(),
            {"yaw": _QUARTER, "yaw_rate": 1.4},
            *_round(),
        ],
    )
    yield ("long_hover", "hover in one place for 28 s.", [{"yaw": 0.0, "hold": 28.0}])
    yield (
        "climb_and_descend",
        "climb and descend between 0.6 and 2.4 m, slowly and then briskly.",
        [
            {"z": z, "speed": speed, "acceleration": acceleration, "hold": 0.3}
            for speed, acceleration in ((0.8, 1.5), (1.6, 4.0), (1.6, 4.0))
            for z in (2.4, 0.6, 2.4, 0.6)
        ],
    )


def _shuttle(axis: str, places: Iterable[float]) -> Waypoints:
    return [{axis: place} for place in places]


def _round() -> Waypoints:
    return [{"x": 1.0}, {"y": 1.0}, {"x": -1.0}, {"y": -1.0}]


_SUFFICIENT_LOG_BF = 8.0
"""The first manoeuvre that gives every pair this log Bayes factor is taken."""
_MAX_SIMULATED = 3
"""Number of the best manoeuvres that are simulated with each member."""
_AIRBORNE = 0.4
_MEMBERS = 3


EffectsTheta = Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class _DesignInput:
    """What is the same for every manoeuvre: the members as fitted, the model, the sensors."""

    fitted: EffectsTheta
    nominal: NominalModel
    imu: bool
    rpm: bool


def separate(findings: FlightAnalysis, progress: ProgressCallback) -> Experiment | None:
    """Return the manoeuvre that separates the members of a set best, or None without a set."""
    members = findings.judgement.members[:_MEMBERS]
    if len(members) < 2:
        return None
    causes = [estimate_cause(m, findings, findings.search.explaining(m)) for m in members]
    fitted = {c.effect: {f.name: f.value for f in c.theta} for c in causes}
    by_hand = _by_hand(members)
    present = _present_log_bf(findings, members)
    if findings.problem.nominal.calibrated:
        return Experiment(members, by_hand, float("nan"), present)
    imu = findings.problem.tracks[0].formulation == "imu"
    rpm = bool(findings.problem.tracks[0].speed.size)
    bench = _DesignInput(fitted, findings.problem.nominal, imu, rpm)
    flown = list(manoeuvre_catalogue().values())
    screened = []
    for number, manoeuvre in enumerate(flown):
        progress("simulating experiments", number / len(flown))
        screened.append((_expected_log_bf(manoeuvre, bench), number, manoeuvre))
    best: tuple[float, Manoeuvre] | None = None
    for _, _, manoeuvre in sorted(screened, reverse=True)[:_MAX_SIMULATED]:
        worst = _simulated_log_bf(manoeuvre, bench)
        if best is None or worst > best[0]:
            best = worst, manoeuvre
        if worst > _SUFFICIENT_LOG_BF:
            break
    if best is None or best[0] < 2.0:
        return Experiment(members, by_hand, best[0] if best else 0.0, present)
    worst, chosen = best
    text = (
        f"{capital(chosen.text)} Simulated with each of them in turn, it tells "
        f"{listed(members)} apart."
    )
    return Experiment(members, text, worst, present, chosen.scenario)


def _present_log_bf(findings: FlightAnalysis, members: Sequence[str]) -> float:
    """Return the log Bayes factor between the two closest members in the flights at hand."""
    every = [findings.search.best, *findings.search.alternatives]
    by_member = [[e.evidence for e in every if m in e.effects] for m in members]
    evidence = sorted((max(values) for values in by_member if values), reverse=True)
    return float(evidence[0] - evidence[1]) if len(evidence) > 1 else 0.0


def _by_hand(members: Sequence[str]) -> str:
    """Return the advice of the registry for the first pair that has one."""
    for a in members:
        for b, advice in REGISTRY[a].separates_from.items():
            if b in members:
                return f"To tell {listed((a, b))} apart: {advice}."
    names = listed(members)
    return f"Nothing that is flown alone tells {names} apart; change one of them by hand."


def _expected_log_bf(manoeuvre: Manoeuvre, bench: _DesignInput) -> float:
    """Return the smallest log Bayes factor to expect, by the slopes along a nominal flight."""
    try:
        problem = _flown(manoeuvre, bench.nominal.effects, 99, bench)
    except InputError:
        return 0.0
    columns = problem.columns
    matrix = problem.normal().matrix
    worst = float("inf")
    for member, theta in bench.fitted.items():
        change = np.zeros(columns.count)
        for p in columns.parameters:
            if p.effect == member and p.name in theta and p.index in columns.identifiable:
                off = theta[p.name] - float(problem.theta[p.index])
                change[columns.places([p.index])] = off
        if not change.any() and columns.draws:
            change[len(columns.indices) :] = 4.0 * columns.draw_width
        shown = NormalEquations(matrix, matrix @ change, float(change @ matrix @ change))
        worst = min(worst, _lead(problem, shown, member, bench))
    return worst


def _flown(
    manoeuvre: Manoeuvre,
    effects: Mapping[str, Mapping[str, float]],
    seed: int,
    bench: _DesignInput,
) -> FlightProblem:
    """Fly a manoeuvre with these effects and hold it against the nominal model."""
    values = {**manoeuvre.scenario, "effects": {n: dict(v) for n, v in effects.items()}}
    scenario = extended_scenario(values, manoeuvre.name)
    log = as_log(fly_scenario(scenario, seed, workspace=Workspace()), bench.imu, bench.rpm)
    return FlightProblem([track_of(log)], bench.nominal)


def _simulated_log_bf(manoeuvre: Manoeuvre, bench: _DesignInput) -> float:
    """Return the smallest log Bayes factor of a true member against another one."""
    worst = float("inf")
    for number, (member, theta) in enumerate(bench.fitted.items()):
        effects = {name: dict(values) for name, values in bench.nominal.effects.items()}
        effects[member] = {**effects.get(member, {}), **theta}
        try:
            problem = _flown(manoeuvre, effects, 100 + number, bench)
        except InputError:
            return 0.0  # a member that does not fly the manoeuvre
        worst = min(worst, _lead(problem, problem.normal(), member, bench))
    return worst


def _lead(
    problem: FlightProblem, normal: NormalEquations, member: str, bench: _DesignInput
) -> float:
    """Return the log Bayes factor of a member against the next best one."""
    evidence = {name: _evidence(problem, normal, name) for name in bench.fitted}
    return evidence.pop(member) - max(evidence.values())


def _evidence(problem: FlightProblem, normal: NormalEquations, effect: str) -> float:
    places = tuple(p.index for p in problem.columns.parameters if p.effect == effect)
    free = [i for i in places if i in problem.columns.identifiable]
    ways = [problem.columns.deviations(way) for way in [*((i,) for i in free), free] if way]
    ways = ways or [problem.columns.deviations(widths={SCATTER: 8.0})]
    return max(solve(normal, deviations, covariance=False).evidence for deviations in ways)


def sensor_series(flown: Flight, imu: bool, rpm: bool) -> dict[str, Series]:
    """Return what these sensors measured in a simulated flight."""
    t = flown.t
    series = {
        **flown["/mocap/pose"],
        "rotor_command": Series(t, flown.log["rotor_command"].copy()),
        "voltage": Series(t[::100], flown.log["battery"][::100, 2:3]),
    }
    if imu:
        series |= {name: Series(t, flown.log[name].copy()) for name in ("gyro", "accel")}
    if rpm:
        series["rotor_speed"] = Series(t, flown.log["rotor_speed"].copy())
    return series


def as_log(flown: Flight, imu: bool, rpm: bool) -> Flight:
    """Return a simulated flight as a log with these sensors."""
    series, t = sensor_series(flown, imu, rpm), flown.t
    poses = flown["/mocap/pose"]["position"]
    air = np.flatnonzero(poses.values[:, 2] > _AIRBORNE)
    if not air.size:
        raise InputError("the manoeuvre was not flown; accepted: a flight")
    begin, end = float(poses.t[air[0]]) + 0.3, float(poses.t[air[-1]])
    ground = ((-1.0, begin), (end, float(t[-1]) + 1.0))
    return Flight.measured("simulated", "simulated", series, exclude=ground)
