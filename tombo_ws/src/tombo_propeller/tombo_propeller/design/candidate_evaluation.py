"""Evaluation of the candidates: figures, intervals, and how each figure is known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM, Configuration, evaluate
from tombo_dynamics.vehicle import VehicleParams
from tombo_propeller.design.candidates import TestedRange
from tombo_propeller.design.operating_points import FlightPerformance
from tombo_propeller.design.request import MEASURED, NAMES, Limit, Request
from tombo_propeller.design.response_regression import ResponseModel

MEASURED_HERE: Final = "measured"
MODELLED: Final = "modelled"
EXTRAPOLATED: Final = "extrapolated"
_BENCH_SPEED = 2000.0 * RPM


@dataclass(frozen=True, eq=False)
class CandidateEvaluation:
    """All candidates with their figures; columns as in QUANTITIES."""

    configurations: Sequence[Configuration]
    operating: FlightPerformance
    value: Array
    """(n, 5) what is measured or the best prediction."""
    low: Array
    """(n, 5) lower end of the interval: of `confidence` to each side."""
    high: Array
    """(n, 5) upper end."""
    counted: Array
    """(n, 5) what is compared with the limits: measured values, the worse end of predictions, NaN
    for predictions that may not be used."""
    labels: Sequence[tuple[str, ...]]
    """For each candidate, how each figure is known: measured, modelled or extrapolated."""
    outside: Sequence[tuple[str, ...]]
    """For each candidate, its properties outside of the tested range, in words."""
    tier: NDArray[np.int64]
    """0: measured in all three; 1: within what was tested; 2: outside."""
    distance: Array
    """(n,) how far outside of what was tested, see `TestedRange.distance`."""


def judge(
    configurations: Sequence[Configuration],
    operating: FlightPerformance,
    readings: Mapping[str, ResponseModel],
    tested: TestedRange,
    request: Request,
    vehicle: VehicleParams,
) -> CandidateEvaluation:
    """Return the figures of all candidates.

    Thrust margin and lift over drag are the model's: extrapolated in speed, as nobody measured
    beyond 3200 rpm, so their interval is not known and stands at the value. The other three are
    readings, or predictions with an interval.
    """
    count = len(configurations)
    value = np.full((count, len(NAMES)), np.nan)
    margin = operating.usable_thrust / vehicle.hover_thrust()
    value[:, 0] = np.where(np.isfinite(margin), margin, 0.0)
    value[:, 4] = operating.hover_lift_over_drag
    low, high = value.copy(), value.copy()
    counted = value.copy()
    labels: list[tuple[str, ...]] = []
    outside: list[tuple[str, ...]] = []
    tier = np.zeros(count, dtype=np.int64)
    distance = np.zeros(count)
    reaches = {n: readings[n].quantile(request.confidence) for n in MEASURED}
    for i, configuration in enumerate(configurations):
        beyond = tested.outside(configuration)
        distance[i] = tested.distance(configuration) if beyond else 0.0
        label = {NAMES[0]: EXTRAPOLATED, NAMES[4]: EXTRAPOLATED}
        for name in MEASURED:
            column = NAMES.index(name)
            taken = getattr(configuration.measured, name, None)
            if taken is not None:
                low[i, column] = high[i, column] = counted[i, column] = taken
                value[i, column] = taken
                label[name] = MEASURED_HERE
                continue
            best, error = readings[name].predict(configuration)
            reach = error * reaches[name]
            value[i, column] = best
            low[i, column], high[i, column] = max(best - reach, 0.0), best + reach
            label[name] = EXTRAPOLATED if beyond else MODELLED
            usable = not beyond or request.extrapolate
            counted[i, column] = high[i, column] if usable else np.nan
        labels.append(tuple(label[name] for name in NAMES))
        outside.append(beyond)
        all_measured = all(label[name] == MEASURED_HERE for name in MEASURED)
        tier[i] = 0 if all_measured else 2 if beyond else 1
    return CandidateEvaluation(
        configurations, operating, value, low, high, counted, labels, outside, tier, distance
    )


def slack(counted: Array, limits: Sequence[Limit]) -> Array:
    """Return how far each figure is on the right side of its limit, (n, number of limits).

    A share: of a least value, 1 - limit / value; of a highest one, 1 - value / limit; of noise
    the same in sound power. Below 0 the limit is broken; NaN, nothing is known, is -inf.
    """
    found = np.empty((counted.shape[0], len(limits)))
    for k, limit in enumerate(limits):
        x = counted[:, NAMES.index(limit.quantity.name)]
        with np.errstate(divide="ignore", over="ignore"):
            if limit.quantity.unit == "dB":
                share = 1.0 - 10.0 ** (0.1 * (x - limit.value))
            elif limit.quantity.more_is_better:
                share = np.where(x > 0.0, 1.0 - limit.value / x, -np.inf)
            else:
                share = 1.0 - x / limit.value
        found[:, k] = np.where(np.isfinite(x), share, -np.inf)
    return found


def costs(counted: Array) -> Array:
    """Return the figures with less being better, for the Pareto front."""
    sign = np.array([-1.0, 1.0, 1.0, 1.0, -1.0])
    return np.asarray(counted * sign)


def thrust_error(measured: Sequence[Configuration], law: str) -> float:
    """Return the model's RMS error of thrust at 2000 rpm, as a share of what was measured."""
    shares = [
        float(evaluate(c, _BENCH_SPEED, law).thrust_N) / c.measured.thrust_N - 1.0
        for c in measured
        if c.measured is not None and c.measured.thrust_N > 0.0
    ]
    return math.sqrt(sum(s * s for s in shares) / len(shares)) if shares else math.nan
