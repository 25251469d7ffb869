"""From a request and a library to a design: the table of all candidates, and their order."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.propeller import RPM, Blade, Configuration, Library, evaluate, rotor_inertia
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.progress import ProgressCallback, no_progress
from tombo_propeller.design.candidates import PROPERTIES, candidates, measured_soft, properties
from tombo_propeller.design.operating_points import FlightPerformance, flight_performance
from tombo_propeller.design.readings import MeanReading, read
from tombo_propeller.design.request import MEASURED, NAMES, DesignLimit, DesignRequest, vehicle_for

MEASURED_HERE: Final = "measured"
MODELLED: Final = "modelled"
EXTRAPOLATED: Final = "extrapolated"
_BENCH_SPEED = 2000.0 * RPM
_NEAREST = 3
"""Candidates that break a limit and are named."""


@dataclass(frozen=True, eq=False)
class CandidateTable:
    """All candidates, a row each; columns of figures as in QUANTITIES."""

    configurations: Sequence[Configuration]
    operating: FlightPerformance
    readings: Mapping[str, MeanReading]
    """Quantity of MEASURED → its prediction."""
    properties: Array
    """(n, 5) of each nodus, columns as in PROPERTIES."""
    tested: Array
    """(2, 5) lowest and highest of them that were measured (Table III)."""
    other_blade: str | None
    """The blade of the readings where the candidates have another one."""
    value: Array
    """(n, 5) what is measured or the best prediction."""
    low: Array
    """(n, 5) lower end of the interval: of `confidence` to each side."""
    high: Array
    """(n, 5) upper end."""
    counted: Array
    """(n, 5) what is compared with the limits: measured values, the worse end of predictions, NaN
    for predictions that may not be used."""
    labels: NDArray[Any]
    """(n, 5) how each figure is known: measured, modelled or extrapolated."""
    tier: NDArray[np.int64]
    """0: measured in all three; 1: within what was tested; 2: outside."""
    distance: Array
    """(n,) how far outside: shares beyond the nearer end, summed; 0 inside."""

    def outside(self, index: int) -> tuple[str, ...]:
        """Return the quantities of a candidate outside of the tested range, as text."""
        words = [] if self.other_blade is None else [f"blade, tested {self.other_blade}"]
        beyond = _beyond(self.properties[index], self.tested) > 0.0
        for name, value, (low, high), out in zip(
            PROPERTIES.values(), self.properties[index], self.tested.T, beyond, strict=True
        ):
            span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
            words += [f"{name} {value:.4g}, tested {span}"] if out else []
        return tuple(words)


def _beyond(rows: Array, tested: Array) -> Array:
    """Return how far properties (.., 5) are beyond the nearer end, as a share of the highest."""
    low, high = tested
    beyond = np.maximum(low - rows, rows - high)
    return np.asarray(np.where(beyond > 1e-9 * np.abs(high), beyond / high, 0.0))


def candidate_table(
    configurations: Sequence[Configuration],
    measured: Sequence[Configuration],
    blade: Blade,
    request: DesignRequest,
    vehicle: VehicleParams,
) -> CandidateTable:
    """Return the figures of all candidates.

    Thrust margin and lift over drag are the model's: extrapolated in speed, because measurements
    end at 3200 rpm. Their interval is not known and has zero width. The other three are readings,
    or predictions with an interval. Where the readings are of another blade, nothing is within
    what was tested, and force goes with `strike_share`.

    Args:
        configurations: the candidates.
        measured: soft propellers with readings.
        blade: of the candidates, before the nodus was put elsewhere.
        request: the law, and what counts.
        vehicle: that they fly.
    """
    operating = flight_performance(configurations, vehicle, request.law)
    readings = {name: read(name, measured) for name in MEASURED}
    bench = measured[0].blade
    other = None if bench.name == blade.name else bench.name
    rows = _rows(configurations)
    known = _rows(measured)
    tested = np.array([known.min(axis=0), known.max(axis=0)])
    beyond = _beyond(rows, tested)
    outside = (beyond > 0.0).any(axis=1) | (other is not None)
    margin = operating.usable_thrust / vehicle.hover_thrust()
    value = np.empty((len(configurations), len(NAMES)))
    value[:, 0] = np.where(np.isfinite(margin), margin, 0.0)
    value[:, 4] = operating.hover_lift_over_drag
    low, high, counted = value.copy(), value.copy(), value.copy()
    labels = np.full(value.shape, EXTRAPOLATED, dtype=object)
    for name in MEASURED:
        k = NAMES.index(name)
        taken = np.array([getattr(c.measured, name, None) for c in configurations], dtype=float)
        has = np.isfinite(taken)
        struck = name == "collision_force_N" and other is not None
        share = strike_share(blade, bench) if struck else 1.0
        mean, reach = share * readings[name].mean, share * readings[name].reach(request.confidence)
        value[:, k] = np.where(has, taken, mean)
        low[:, k] = np.where(has, taken, max(mean - reach, 0.0))
        high[:, k] = np.where(has, taken, mean + reach)
        usable = has | ~outside | request.extrapolate
        counted[:, k] = np.where(usable, high[:, k], np.nan)
        labels[:, k] = np.where(has, MEASURED_HERE, np.where(outside, EXTRAPOLATED, MODELLED))
    whole = (labels[:, [NAMES.index(name) for name in MEASURED]] == MEASURED_HERE).all(axis=1)
    tier = np.where(whole, 0, np.where(outside, 2, 1))
    return CandidateTable(
        configurations, operating, readings, rows, tested, other,
        value, low, high, counted, labels, tier, beyond.sum(axis=1),
    )  # fmt: skip


def _rows(configurations: Sequence[Configuration]) -> Array:
    """Return the properties of nodi, (n, 5)."""
    return np.array([list(properties(c).values()) for c in configurations])


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


@lru_cache(maxsize=16)
def thrust_error(measured: tuple[Configuration, ...], law: str) -> float:
    """Return the model's RMS error of thrust at 2000 rpm, as a share of the measured thrust."""
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
    order: tuple[int, ...]
    """Feasible candidates, the recommended one first."""
    relief: tuple[float | None, ...]
    """For each limit, the value at which one candidate would keep to all, the other limits as they
    are; None: none would, however far this one gives."""
    nearest: tuple[int, ...]
    """Candidates that break the limits least."""


def choose(evaluated: CandidateTable, limits: Sequence[DesignLimit], gain: float) -> Choice:
    """Order the candidates that keep the limits, and find how far the others are from them.

    Evidence comes first: measured candidates before predictions within the tested range, and these
    before extrapolations. Within each, the candidate whose smallest slack is largest, of those on
    the front; of extrapolations, the nearest to the tested range. A prediction within the tested
    range overtakes a measurement only if its smallest slack is larger by more than `gain`.

    Args:
        evaluated: the candidates.
        limits: what to keep to.
        gain: share that the model must gain to be believed over a measurement: its own error.
    """
    left = slack(evaluated.counted, limits)
    worst = left.min(axis=1)
    feasible = worst >= 0.0
    keys = (-evaluated.counted[:, 0], -worst, evaluated.distance, evaluated.tier)
    order = [int(i) for i in np.lexsort(keys) if feasible[i]]
    overtake = [i for i in order if evaluated.tier[i] == 1 and worst[i] > worst[order[0]] + gain]
    if overtake and evaluated.tier[order[0]] == 0:
        order.remove(overtake[0])
        order.insert(0, overtake[0])
    misses = [int(i) for i in np.lexsort((evaluated.tier, -worst)) if -np.inf < worst[i] < 0.0]
    relief = tuple(_relief(evaluated, left, k, limits) for k in range(len(limits)))
    return Choice(tuple(limits), left, feasible, tuple(order), relief, tuple(misses[:_NEAREST]))


def _relief(
    evaluated: CandidateTable, left: Array, k: int, limits: Sequence[DesignLimit]
) -> float | None:
    others = np.delete(left, k, axis=1)
    able = (others >= 0.0).all(axis=1)
    figures = evaluated.counted[able, NAMES.index(limits[k].quantity.name)]
    figures = figures[np.isfinite(figures)]
    if not figures.size:
        return None
    return float(figures.max() if limits[k].quantity.more_is_better else figures.min())


@dataclass(frozen=True, eq=False)
class Design:
    """All candidates with their evaluation and ranking."""

    request: DesignRequest
    vehicle: VehicleParams
    """As it flies with the blade's own nodus."""
    thrust_error: float
    """RMS error of the model's thrust at 2000 rpm, as a share."""
    evaluated: CandidateTable
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
        request: vehicle and limits.
        library: materials, configurations and measurements.
        blade: that the propeller is made with; a nodus may be put anywhere on it.
        on_progress: called with the progress.

    Raises:
        InputError: the library has no measured soft propeller with this blade and the request does
        not extrapolate; or the simulator does not accept the vehicle.
    """
    vehicle = vehicle_for(request, blade)
    measured = measured_soft(library, blade, request.extrapolate)
    on_progress("candidates", 0.0)
    every = candidates(library, blade)
    on_progress(f"{len(every)} candidates", 0.1)
    evaluated = candidate_table(every, measured, blade, request, vehicle)
    if not evaluated.value[:, 0].max() > 0.0:
        raise InputError(f"blade {blade.name}: no nodus gives thrust; accepted: another blade")
    error = thrust_error(measured, request.law)
    return Design(request, vehicle, error, evaluated, choose(evaluated, request.limits, error))
