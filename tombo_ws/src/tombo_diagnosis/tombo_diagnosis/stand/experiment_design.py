"""The measurement that would separate a set of causes, found by simulation."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.diagnosis import Experiment
from tombo_diagnosis.engine.model import Explanation
from tombo_diagnosis.engine.model_selection import fit_hypotheses
from tombo_diagnosis.stand.analyse import StandFindings
from tombo_diagnosis.stand.operating_points import OperatingPoints
from tombo_diagnosis.stand.problem import StandProblem
from tombo_diagnosis.wording import words
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects import CHANNELS, Setup, predict

SIGMAS = {"torque": 0.005, "beta": 0.007, "reference_speed": 0.001, "thrust": 0.003}
"""Noise of what is measured besides: shares of the range; beta in rad (0.4 degrees)."""
_MOST_RIVALS = 4


@dataclass(frozen=True)
class Option:
    """Something to measure."""

    text: str
    extend: Callable[[OperatingPoints], OperatingPoints]


def separate(findings: StandFindings) -> Experiment | None:
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
    found = [
        (_separation(findings, option.extend(points), alternatives), option)
        for option in options(points)
    ]
    if not found:
        return None
    best, option = max(found, key=lambda each: each[0])
    text = f"{option.text}: it separates {', '.join(map(words, members))}"
    if best < 4.0:
        text = f"no single measurement separates them surely; most comes from this: {option.text}"
    return Experiment(members, text, best, present, {})


def options(points: OperatingPoints) -> list[Option]:
    """Return what could be measured besides."""
    found = []
    have = {CHANNELS[c] for c in points.measured}
    words = {
        "torque": "measure torque at the same speeds, to 0.5 % of its range",
        "beta": "measure the flap angle at the same speeds, to 0.4 degrees",
        "reference_speed": "measure speed with a second tachometer, to 0.1 %",
    }
    for name, text in words.items():
        if name not in have and not (name == "beta" and points.setup.plain):
            found.append(Option(text, lambda p, n=name: with_channel(p, n)))  # type: ignore[misc]
    found.append(
        Option("hang known weights on the thrust cell at standstill", lambda p: with_loads(p, 0))
    )
    if "torque" in have:
        found.append(
            Option("apply known torques at standstill, arm and weight", lambda p: with_loads(p, 1))
        )
    found.append(
        Option(
            "the same, and with a second tachometer and torque to 0.5 %",
            lambda p: with_channel(with_channel(with_loads(p, 0), "reference_speed"), "torque"),
        )
    )
    if not points.setup.plain:
        found.append(
            Option("the same propellers at speeds half as high again", with_higher_speeds)
        )
    return found


def _explanations(findings: StandFindings, members: Sequence[str]) -> list[Explanation]:
    """Return the best explanation with each member, most probable first."""
    every = (findings.search.best, *findings.search.alternatives)
    found: list[Explanation] = []
    for member in members:
        own = next((e for e in every if member in e.effects and np.isfinite(e.evidence)), None)
        if own is not None and all(own is not f for f in found):
            found.append(own)
    return found[:_MOST_RIVALS]


def _separation(
    findings: StandFindings, points: OperatingPoints, alternatives: Sequence[Explanation]
) -> float:
    """Return the expected log Bayes factor between the two that are closest."""
    worst = np.inf
    for true in alternatives[:2]:
        told = with_predicted_readings(findings.problem, points, true)
        problem = StandProblem(told)
        own = fit_hypotheses(problem, true.hypotheses).evidence
        for other in alternatives:
            if other is not true:
                worst = min(worst, own - fit_hypotheses(problem, other.hypotheses).evidence)
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
    s = points.setup
    largest = (s.largest_thrust, s.largest_torque)[which]
    return _with_points(
        points,
        np.zeros(3),
        np.zeros(3, np.int64),
        [which],
        (which, np.array([0.0, 0.5, 1.0]) * largest),
    )


def with_higher_speeds(points: OperatingPoints) -> OperatingPoints:
    """Return points with three more at speeds up to half as high again, each propeller."""
    s = points.setup
    measured = points.measured
    for p in range(len(points.propellers)):
        top = float(s.speed[s.propeller == p].max())
        points = _with_points(
            points, top * np.array([1.17, 1.33, 1.5]), np.full(3, p), measured, None
        )
    return points


def _with_points(
    points: OperatingPoints,
    speed: Array,
    propeller: NDArray[np.int64],
    channels: Sequence[int],
    load: tuple[int, Array] | None,
) -> OperatingPoints:
    s = points.setup
    n, m = s.speed.size, speed.size
    first = [int(np.flatnonzero(s.propeller == p)[0]) for p in propeller]

    def longer(values: Array, new: Array) -> Array:
        return np.concatenate([values if values.size else np.zeros(n), new])

    applied: list[Array] = [np.zeros(m), np.zeros(m)]
    if load is not None:
        applied[load[0]] = load[1]
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
    return replace(
        points, setup=setup, readings=np.concatenate([points.readings, new]), sigma=sigma
    )
