"""Whether what an explanation leaves unexplained is what noise leaves: by channel and time scale.

This is the test against unknown causes. The best candidate always explains something; it is the
cause only if nothing but noise remains.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from tombo_diagnosis.engine.regression import Fit
from tombo_diagnosis.flight.fit.problem import FlightProblem
from tombo_diagnosis.flight.fit.sensitivity import map_flights
from tombo_diagnosis.flight.noise.noise_variance import (
    SCALES_S,
    block_variances,
    floors_of,
    pooled,
    simulated_noise,
)
from tombo_dynamics.arrays import Array
from tombo_flight.vehicle_file import HealthyFlights

_STANDARD_ERRORS = 2.0
"""Standard errors of the logarithm of a variance that are subtracted from an excess."""


@dataclass(frozen=True)
class ResidualExcess:
    """One channel's remainder at its worst time scale."""

    channel: str
    unit: str
    scale_s: float
    measured: float
    """Root mean square at that scale."""
    expected: float
    excess: float
    """Logarithm of the ratio of variances, less what sampling may give; above 0: too much."""


@dataclass(frozen=True)
class ScaleVariances:
    """Variances by time scale of every channel, all flights together."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    variances: Array
    """(scales, channels)"""
    counts: Array
    """(scales, channels)"""


def residual_variances(
    problem: FlightProblem, fit: Fit, flights: Sequence[int] | None = None
) -> ScaleVariances:
    """Return what a fit, tolerances used, leaves unexplained of all flights, or of some."""
    chosen = range(len(problem.tracks)) if flights is None else flights
    return _powers(problem, {f: problem.residual(fit, f) for f in chosen})


def noise_variances(problem: FlightProblem, theta: Array) -> ScaleVariances:
    """Return the variances that noise alone would leave, by one draw a flight."""
    drawn = map_flights(
        lambda track: simulated_noise(track, problem.nominal, theta, 1), problem.tracks
    )
    return _powers(problem, dict(enumerate(drawn)))


def with_healthy(expected: ScaleVariances, healthy: HealthyFlights | None) -> ScaleVariances:
    """Return the variances that noise leaves, or what healthy flights left where that is more."""
    if healthy is None:
        return expected
    variances = expected.variances.copy()
    for j, name in enumerate(expected.names):
        left = healthy.residuals.get(name, ())
        if len(left) == len(variances):
            variances[:, j] = np.maximum(variances[:, j], left)
    return replace(expected, variances=variances)


def _powers(problem: FlightProblem, rows: Mapping[int, dict[str, Array]]) -> ScaleVariances:
    """Return the variances of flights, number of the flight -> group -> rows."""
    found: dict[str, list[tuple[Array, Array]]] = {}
    units: dict[str, str] = {}
    for f, groups in rows.items():
        for group, residual in groups.items():
            variances, counts = block_variances(residual, 1.0 / problem.per_second(group))
            for j, c in enumerate(problem.channels[f][group]):
                found.setdefault(c.name, []).append((variances[:, j : j + 1], counts))
                units[c.name] = c.unit
    means, numbers = [], []
    for parts in found.values():
        mean, count = pooled(parts)
        means.append(mean[:, 0])
        numbers.append(count)
    return ScaleVariances(
        tuple(found), tuple(units.values()), np.column_stack(means), np.column_stack(numbers)
    )


def residual_excesses(measured: ScaleVariances, expected: ScaleVariances) -> list[ResidualExcess]:
    """Return every channel's remainder, the largest excess first."""
    result = []
    for j, name in enumerate(measured.names):
        floor = floors_of(name)[1] ** 2
        ratio = np.log(
            np.maximum(measured.variances[:, j], 1e-30) / (expected.variances[:, j] + floor)
        )
        error = np.sqrt(4.0 / np.maximum(measured.counts[:, j], 1.0))
        excess = ratio - _STANDARD_ERRORS * error
        excess[~np.isfinite(excess)] = -np.inf
        worst = int(np.argmax(excess))
        found = float(np.sqrt(max(measured.variances[worst, j], 0.0)))
        usual = float(np.sqrt(expected.variances[worst, j] + floor))
        result.append(
            ResidualExcess(
                name, measured.units[j], SCALES_S[worst], found, usual, float(excess[worst])
            )
        )
    return sorted(result, key=lambda each: -each.excess)
