"""From a request and a library to a design: all candidates, evaluated and ranked."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.propeller import RPM, Blade, Configuration, Library, evaluate, rotor_inertia
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_propeller.design.candidates import TestedRange, candidates, measured_soft, tested
from tombo_propeller.design.operating_points import FlightPerformance, flight_performance
from tombo_propeller.design.request import MEASURED, NAMES, DesignLimit, DesignRequest, vehicle_for
from tombo_propeller.design.response_regression import ResponseModel, read

MEASURED_HERE: Final = "measured"
MODELLED: Final = "modelled"
EXTRAPOLATED: Final = "extrapolated"
_BENCH_SPEED = 2000.0 * RPM
_NEAREST = 3
_FORCE = "collision_force_N"
"""Candidates that break a limit and are named."""


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
    request: DesignRequest,
    vehicle: VehicleParams,
    blade: Blade,
    measured_blade: Blade | None = None,
) -> CandidateEvaluation:
    """Return the figures of all candidates.

    `measured_blade` is the blade of the readings where the candidates have another one: then
    nothing is within what was tested, and force goes with `strike_share`.

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
    strike = 1.0 if measured_blade is None else strike_share(blade, measured_blade)
    for i, configuration in enumerate(configurations):
        beyond = tested.outside(configuration)
        if measured_blade is not None:
            beyond = (f"blade, tested {measured_blade.name}", *beyond)
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
            if name == _FORCE:
                best, error = best * strike, error * strike
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


def strike_share(blade: Blade, measured_blade: Blade) -> float:
    """Return how hard a blade strikes over a measured one at the same rotor speed.

    As in the simulator, a strike goes with the rotor's spin momentum over its radius.
    """
    heavy = rotor_inertia(blade).total / rotor_inertia(measured_blade).total
    return heavy * measured_blade.tip_radius_m / blade.tip_radius_m


def slack(counted: Array, limits: Sequence[DesignLimit]) -> Array:
    """Return how far each figure is on the right side of its limit, (n, number of limits).

    A share: of a least value, 1 - limit / value; of a highest one, 1 - value / limit; of noise
    the same in sound power. Below 0 the limit is broken; NaN, nothing is known, is -inf.
    """
    shares = np.empty((counted.shape[0], len(limits)))
    for k, limit in enumerate(limits):
        x = counted[:, NAMES.index(limit.quantity.name)]
        with np.errstate(divide="ignore", over="ignore"):
            if limit.quantity.unit == "dB":
                share = 1.0 - 10.0 ** (0.1 * (x - limit.value))
            elif limit.quantity.more_is_better:
                share = np.where(x > 0.0, 1.0 - limit.value / x, -np.inf)
            else:
                share = 1.0 - x / limit.value
        shares[:, k] = np.where(np.isfinite(x), share, -np.inf)
    return shares


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


@dataclass(frozen=True, eq=False)
class Choice:
    """Which candidates keep to the limits, and in which order they come."""

    limits: tuple[DesignLimit, ...]
    slack: Array
    """(n, limits), see `slack`."""
    feasible: NDArray[np.bool_]
    front: NDArray[np.bool_]
    """Feasible and not beaten by another one of as good evidence; less far outside of what was
    tested is better, too."""
    order: tuple[int, ...]
    """Feasible candidates, the recommended one first."""
    relief: tuple[float | None, ...]
    """For each limit, the value at which one candidate would keep to all, the other limits as they
    are; None: none would, however far this one gives."""
    nearest: tuple[int, ...]
    """Candidates that break the limits least."""


def choose(judged: CandidateEvaluation, limits: Sequence[DesignLimit], gain: float) -> Choice:
    """Order the candidates that keep the limits, and find how far the others are from them.

    Evidence comes first: what was measured before what is predicted within the tested range, that
    before what is extrapolated. Within each, the candidate whose smallest slack is largest, of
    those on the front; of what is extrapolated the one that is least so. A prediction within the
    tested range overtakes a measurement only if its smallest slack is larger by more than `gain`.

    Args:
        judged: the candidates.
        limits: what to keep to.
        gain: share that the model must gain to be believed over a measurement: its own error.
    """
    left = slack(judged.counted, limits)
    worst = left.min(axis=1)
    feasible = worst >= 0.0
    front = np.zeros_like(feasible)
    for tier in range(3):
        here = feasible & (judged.tier == tier)
        front[here] = _front(judged, here)
    return Choice(
        tuple(limits),
        left,
        feasible,
        front,
        _order(judged, worst, feasible, front, gain),
        tuple(_relief(judged, left, k, limits) for k in range(len(limits))),
        tuple(int(i) for i in _by_slack(worst, ~feasible, judged.tier)[:_NEAREST]),
    )


def _front(judged: CandidateEvaluation, here: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return which candidates `here` are on their Pareto front; unknown figures are left out."""
    figures = np.column_stack([costs(judged.counted[here]), judged.distance[here]])
    known = np.isfinite(figures).any(axis=0)
    return nondominated(figures[:, known]) if here.any() else np.zeros(0, dtype=bool)


def _order(
    judged: CandidateEvaluation,
    worst: Array,
    feasible: NDArray[np.bool_],
    front: NDArray[np.bool_],
    gain: float,
) -> tuple[int, ...]:
    indices = np.flatnonzero(feasible)
    if not indices.size:
        return ()
    keys = (-judged.counted[indices, 0], -worst[indices], judged.distance[indices],
            ~front[indices], judged.tier[indices])  # fmt: skip
    ordered = [int(i) for i in indices[np.lexsort(keys)]]
    first = ordered[0]
    within = [i for i in ordered if judged.tier[i] == 1]
    if within and judged.tier[first] == 0 and worst[within[0]] > worst[first] + gain:
        first = within[0]
    ordered.remove(first)
    return (first, *ordered)


def _by_slack(worst: Array, among: NDArray[np.bool_], tier: NDArray[np.int64]) -> Array:
    indices = np.flatnonzero(among & np.isfinite(worst))
    return np.asarray(indices[np.lexsort((tier[indices], -worst[indices]))])


def _relief(
    judged: CandidateEvaluation, left: Array, k: int, limits: Sequence[DesignLimit]
) -> float | None:
    others = np.delete(left, k, axis=1)
    able = (others >= 0.0).all(axis=1)
    figures = judged.counted[able, NAMES.index(limits[k].quantity.name)]
    figures = figures[np.isfinite(figures)]
    if not figures.size:
        return None
    return float(figures.max() if limits[k].quantity.more_is_better else figures.min())


def nondominated(costs: Array) -> NDArray[np.bool_]:
    """Return which rows no other row dominates.

    A row dominates another one if it is nowhere worse and somewhere better. Rows that are equal
    don't dominate each other; a row with a NaN is never in the set and dominates nothing.

    Args:
        costs: (n, k), less is better.
    """
    kept: NDArray[np.bool_] = np.asarray(np.isfinite(costs).all(axis=1))
    order = np.flatnonzero(kept)
    order = order[np.lexsort(costs[order].T[::-1])]
    front: Array = np.empty((0, costs.shape[1]))
    for row in order:  # whatever dominates a row comes before it in the order
        cost = costs[row]
        if ((front <= cost).all(axis=1) & (front < cost).any(axis=1)).any():
            kept[row] = False
        else:
            front = np.vstack([front, cost])
    return kept


@dataclass(frozen=True, eq=False)
class Design:
    """All candidates with their evaluation and ranking."""

    request: DesignRequest
    vehicle: VehicleParams
    """As it flies with the blade's own nodus."""
    blade: Blade
    measured: tuple[Configuration, ...]
    tested: TestedRange
    readings: Mapping[str, ResponseModel]
    thrust_error: float
    """RMS error of the model's thrust at 2000 rpm, as a share."""
    judged: CandidateEvaluation
    choice: Choice

    @property
    def feasible(self) -> bool:
        """Whether anything keeps to the limits."""
        return bool(self.choice.order)


def blade_of(library: Library, name: str) -> Blade:
    """Return a blade of a library.

    Raises:
        InputError: there is no such blade.
    """
    if name not in library.blades:
        raise unknown_name("blade", name, library.blades)
    return library.blades[name]


def design(
    request: DesignRequest,
    library: Library,
    blade: Blade,
    on_progress: ProgressCallback = no_progress,
) -> Design:
    """Evaluate and rank all candidates.

    Args:
        request: what is asked for.
        library: materials, configurations and measurements.
        blade: that the propeller is made with; a nodus may be put anywhere on it.
        on_progress: called with the progress.

    Raises:
        InputError: the library has no measured soft propeller with this blade and the request
            does not extrapolate, or the vehicle is outside of what the simulator takes.
    """
    vehicle = vehicle_for(request, blade)
    measured = measured_soft(library, blade, request.extrapolate)
    other_blade = None if measured[0].blade.name == blade.name else measured[0].blade
    readings = {name: read(name, measured) for name in MEASURED}
    span = tested(measured)
    on_progress("candidates", 0.0)
    every = candidates(library, blade)
    on_progress(f"{len(every)} candidates", 0.1)
    operating = flight_performance(every, vehicle, request.law)
    on_progress("judging", 0.9)
    judged = judge(every, operating, readings, span, request, vehicle, blade, other_blade)
    error = thrust_error(measured, request.law)
    if not judged.value[:, 0].max() > 0.0:
        raise InputError(f"blade {blade.name}: no nodus gives thrust; accepted: another blade")
    choice = choose(judged, request.limits, error)
    return Design(request, vehicle, blade, measured, span, readings, error, judged, choice)
