"""The measurement that would separate a set of causes, found by simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.diagnosis import Experiment
from tombo_diagnosis.engine.model import Explanation
from tombo_diagnosis.engine.model_selection import fit_hypotheses
from tombo_diagnosis.stand.analyse import StandAnalysis
from tombo_diagnosis.stand.problem import StandProblem
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.wording import display_name
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS, Setup, predict

SIGMAS = {"torque": 0.005, "beta": 0.007, "reference_speed": 0.001, "thrust": 0.003}
"""Noise of what is measured besides: shares of the range; beta in rad (0.4 degrees)."""
_MOST_RIVALS = 4


Option = tuple[str, Callable[[OperatingPoints], OperatingPoints]]
"""Something to measure, and the points with it."""


def separate(findings: StandAnalysis) -> Experiment | None:
    """Return the measurement that separates the members of a set best, or None.

    Each member in turn is taken for true; its readings are predicted without noise, the old points
    and the new ones, and the other members are fitted to them. What counts is the worst pair.
    """
    members = findings.judgement.members
    if not members:
        return None
    alternatives = _explanations(findings, members)
    if len(alternatives) < 2:
        return None
    points = findings.problem.points
    present = _separation(findings, points, alternatives)
    expected = [
        (_separation(findings, extend(points), alternatives), text)
        for text, extend in options(points)
    ]
    best, option = max(expected, key=lambda each: each[0])
    text = f"{option}: it separates {', '.join(map(display_name, members))}"
    if best < 4.0:
        text = f"no single measurement separates them surely; most comes from this: {option}"
    return Experiment(members, text, best, present, {})


def options(points: OperatingPoints) -> list[Option]:
    """Return what could be measured besides."""
    possible: list[Option] = []
    have = {CHANNELS[c] for c in points.measured}
    besides = {
        "torque": "measure torque at the same speeds, to 0.5 % of its range",
        "beta": "measure the flap angle at the same speeds, to 0.4 degrees",
        "reference_speed": "measure speed with a second tachometer, to 0.1 %",
    }
    for name, text in besides.items():
        if name not in have and not (name == "beta" and points.setup.plain):
            possible.append((text, partial(with_channel, name=name)))
    weights = partial(with_loads, which=0)
    possible.append(("hang known weights on the thrust cell at standstill", weights))
    if "torque" in have:
        torques = partial(with_loads, which=1)
        possible.append(("apply known torques at standstill, arm and weight", torques))
    text = "the same, and with a second tachometer and torque to 0.5 %"
    possible.append(
        (text, lambda p: with_channel(with_channel(weights(p), "reference_speed"), "torque"))
    )
    if not points.setup.plain:
        possible.append(("the same propellers at speeds half as high again", with_higher_speeds))
    return possible


def _explanations(findings: StandAnalysis, members: Sequence[str]) -> list[Explanation]:
    """Return the best explanation with each member, in the order of members."""
    every = (findings.search.best, *findings.search.alternatives)
    chosen: dict[int, Explanation] = {}
    for member in members:
        for explanation in [e for e in every if member in e.effects and np.isfinite(e.evidence)][
            :1
        ]:
            chosen[id(explanation)] = explanation
    return list(chosen.values())[:_MOST_RIVALS]


def _separation(
    findings: StandAnalysis, points: OperatingPoints, alternatives: Sequence[Explanation]
) -> float:
    """Return the expected log Bayes factor between the two that are closest."""
    worst = np.inf
    for true in alternatives[:2]:
        extended = with_predicted_readings(findings.problem, points, true)
        problem = StandProblem(extended)
        evidence = fit_hypotheses(problem, true.hypotheses).evidence
        for other in alternatives:
            if other is not true:
                worst = min(worst, evidence - fit_hypotheses(problem, other.hypotheses).evidence)
    return float(worst)


def with_predicted_readings(
    problem: StandProblem, points: OperatingPoints, true: Explanation
) -> OperatingPoints:
    """Return points with the readings that an explanation predicts, without noise."""
    values = problem.values(problem.final(true.fit))
    readings = predict(points.setup, values)
    return replace(points, readings=np.where(np.isfinite(points.readings), readings, np.nan))


def with_channel(points: OperatingPoints, name: str) -> OperatingPoints:
    """Return points at which one more channel is measured."""
    c = CHANNELS.index(name)
    base = predict(points.setup, {})
    readings, sigma = points.readings.copy(), points.sigma.copy()
    turning = points.setup.speed > 0.0
    readings[turning, c] = base[turning, c]
    largest = float(np.nanmax(np.abs(base[:, c]), initial=0.0))
    sigma[:, c] = SIGMAS[name] * (1.0 if name == "beta" else max(largest, 1e-9))
    return replace(points, readings=readings, sigma=sigma)


def with_loads(points: OperatingPoints, which: int) -> OperatingPoints:
    """Return points with known loads at standstill before them: half and all of the range."""
    largest = (points.setup.largest_thrust, points.setup.largest_torque)[which]
    applied: list[Array] = [np.zeros(3), np.zeros(3)]
    applied[which] = np.array([0.0, 0.5, 1.0]) * largest
    return _with_points(points, np.zeros(3), np.zeros(3, np.int64), [which], applied)


def with_higher_speeds(points: OperatingPoints) -> OperatingPoints:
    """Return points with three more at speeds up to half as high again, each propeller."""
    s = points.setup
    measured, none = points.measured, [np.zeros(3), np.zeros(3)]
    for p in range(len(points.propellers)):
        speed = float(s.speed[s.propeller == p].max()) * np.array([1.17, 1.33, 1.5])
        points = _with_points(points, speed, np.full(3, p), measured, none)
    return points


def _with_points(
    points: OperatingPoints,
    speed: Array,
    propeller: NDArray[np.int64],
    channels: Sequence[int],
    applied: Sequence[Array],
) -> OperatingPoints:
    """Return points with more at these speeds (M,), under known thrust and torque (M,)."""
    s = points.setup
    n, m = s.speed.size, speed.size
    first = [int(np.flatnonzero(s.propeller == p)[0]) for p in propeller]

    def longer(values: Array, new: Array) -> Array:
        return np.concatenate([values if values.size else np.zeros(n), new])

    setup = Setup(
        np.concatenate([s.speed, speed]), np.concatenate([s.rows, s.rows[first]]),
        np.concatenate([s.propeller, propeller]), np.concatenate([s.run, s.run[first]]),
        np.concatenate([s.elapsed, np.zeros(m)]), s.law, s.plain, s.tip_radius_m,
        longer(s.applied_thrust, applied[0]), longer(s.applied_torque, applied[1]),
        s.largest_thrust, s.largest_torque,
    )  # fmt: skip
    new = np.full((m, len(CHANNELS)), np.nan)
    new[:, list(channels)] = 0.0
    sigma = np.concatenate([points.sigma, np.tile(np.median(points.sigma, axis=0), (m, 1))])
    readings = np.concatenate([points.readings, new])
    return replace(points, setup=setup, readings=readings, sigma=sigma)
