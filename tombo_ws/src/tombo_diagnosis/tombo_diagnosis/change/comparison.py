"""New flights against healthy ones: how likely is each candidate, and none of them.

Flights come in sessions. Between sessions, battery, seat and air change the common part of all
rotors, and its roll, pitch and yaw parts, more than single rotors; flights of one session differ
less. A vehicle has few sessions, so both spreads are pooled with those of other vehicles. The
prediction for a further session has the tails of Student's t.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy import stats
from scipy.special import logsumexp

from tombo_diagnosis.change.features import Features, mean_of
from tombo_diagnosis.change.signatures import (
    ADDED_WEIGHT,
    CENTRE,
    HANGING_LOAD,
    MASS,
    OTHER,
    UNBALANCE,
    WEAK_PROPELLER,
    ChangeCandidate,
)
from tombo_diagnosis.rotor_demand import MODES, SESSION_DEGREES, SESSION_MODES, SESSION_ROTOR
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES

_SESSION_OTHERS = (0.13, 0.15, 0.2, 0.01, 0.01)
"""Spread between sessions of shake, swing (logarithms) and trail [s/m]."""
_FLIGHT = (0.007, 0.007, 0.007, 0.007, 0.1, 0.1, 0.2, 0.01, 0.01)
"""Spread between flights of one session, of demand of each rotor, shake, swing, trail."""
_FLIGHT_COMMON = 0.01
"""The same of all rotors together: batteries differ in mass by 3 % of a third of the vehicle."""
_PRIOR_SESSIONS, _PRIOR_FLIGHTS = 4.0, 4.0
"""How many of each that weighs."""
NONE = 0.3
"""Probability that nothing has changed before the data: who asks has a reason."""
_PRIOR: Mapping[str, float] = {
    WEAK_PROPELLER: 1.5, ADDED_WEIGHT: 1.0, HANGING_LOAD: 0.7, MASS: 0.5, CENTRE: 0.3,
    UNBALANCE: 0.3, OTHER: 0.2,
}  # fmt: skip
"""Weight of an effect before the data, shared by its rotors."""
_PAIR_PRIOR = 0.7
"""Two weak propellers, any, against one before the data: what hits one may hit another."""
CHANGED = 0.2
"""Probability that nothing has changed, below which something has."""
_SIZES: Mapping[str, tuple[float, float]] = {
    WEAK_PROPELLER: (0.1, 0.8), ADDED_WEIGHT: (0.07, 1.0), HANGING_LOAD: (0.07, 1.0),
    MASS: (0.1, 0.8), CENTRE: (0.06, 0.8),
}  # fmt: skip
"""Sizes before the data, shares of thrust, of mass and of the arm: their median, and the spread of
their logarithms. A small vehicle carries from a hundredth of its mass to half of it."""

# How far real changes are from what candidates predict: the most probable values after the ten
# conditions of CrazyPAD, vehicle E9, each log-normal before them.
_YAW_SHARE: Final = 0.38
"""Change of a rotor's torque per thrust, as a share of the thrust lost: a cut or taped blade has
another ratio."""
_WASH: Final = 0.058
"""Share of thrust, and of torque by the swirl, that a weight in its downwash may take from a
rotor, whatever its mass."""
_MISFIT: Final = 0.077
"""Share of the demand of the rotor that changes most by which a prediction may be off at each:
motors are not linear, and not alike."""
_ROUGH: Final = 0.43
"""Spread of the logarithm of shake where blades, or their air, are changed."""
_WEIGHED: Final = 0.14
"""The same with a weight near a rotor."""
_DETUNED: Final = 5.3
"""Logarithm of swing per demand: a rotor that gives less than asked for slackens the loops."""
_SWUNG: Final = 0.51
"""Spread of the logarithm of swing with a hanging load: it may calm a vehicle or shake it, as its
controller does (the simulated one swings less by 0.2 to 0.4, whatever the thread)."""
_DRAGGED: Final = 0.062
"""Trail of a hanging load [s/m], mean and spread, away from the side that it hangs on: 0.25 % of
the weight as drag at 0.3 m/s, at the end of an arm."""


@dataclass(frozen=True)
class Spread:
    """Mean and covariances of healthy flights. Vectors as `Features.vector`."""

    mean: Features
    session: Array
    """(9, 9) covariance between sessions."""
    flight: Array
    """(9, 9) covariance between flights of a session."""
    degrees: float
    """Degrees of freedom."""
    flights: int
    """Number of flights of `mean`."""
    sessions: int
    left_out: int = 0
    """Number of sessions compared with the others; flights, if all are of one session."""
    false_alarms: int = 0
    """Number of these sessions that the others call changed."""

    @property
    def days_unknown(self) -> bool:
        """True: new flights are of a further session, and the healthy ones of a single one."""
        return self.sessions == 1 and bool(self.session.any())

    def scale(self, new: int) -> Array:
        """Return the scale matrix (9, 9) of the mean of `new` flights of one further session."""
        sessions = self.session * (1.0 + 1.0 / self.sessions)
        return sessions + self.flight * (1.0 / new + 1.0 / self.flights)


@dataclass(frozen=True)
class CandidateResult:
    """A candidate after the data."""

    candidate: ChangeCandidate
    probability: float
    size: Array
    """(k,) the median of each of its sizes, any size being as probable before."""
    low: Array
    high: Array
    """(k,) 95 % of the size's probability."""


@dataclass(frozen=True)
class HealthyComparison:
    """Comparison of new flights with healthy ones."""

    none: float
    """Probability that nothing has changed."""
    results: tuple[CandidateResult, ...]
    """All candidates, most probable first."""
    shift: Features
    """New minus healthy."""
    usual: float
    """Share of healthy sessions of which the demand of the four rotors together is as far off."""


def spread_of(
    healthy: Sequence[Features],
    sessions: Sequence[str],
    same: str = "",
    tried: Sequence[ChangeCandidate] = (),
) -> Spread:
    """Return mean and spread of healthy flights, one or more, each with its session.

    Args:
        healthy: features of the flights.
        sessions: session of each.
        same: the session of these that new flights are of, too; empty: they are of a further one.
        tried: candidates of which the others may accuse a session; none: this is not counted.
    """
    false_alarms, left_out = _count_false_alarms(healthy, sessions, tried) if tried else (0, 0)
    values = np.array([f.vector for f in healthy])
    names = list(dict.fromkeys(sessions))
    member = np.array([[s == name for s in sessions] for name in names])
    means = np.array([values[rows].mean(axis=0) for rows in member])
    inside = values - means[member.argmax(axis=0)]
    middle = means.mean(axis=0)
    n, count = len(names), len(healthy)
    prior = np.diag(np.square([0.0] * 4 + list(_SESSION_OTHERS)))
    modes = 4.0 * MODES.T  # (4, 4): effect of one unit of a part on each rotor
    prior[:4, :4] = (modes * np.square(SESSION_MODES)) @ modes.T + SESSION_ROTOR**2 * np.eye(4)
    moved = means - middle
    apart = moved[:, :4]
    # a vehicle that varies more, or less, in some directions does so in those not yet seen
    loose = float(np.sum(apart * np.linalg.solve(prior[:4, :4], apart.T).T))
    prior[:4, :4] *= (SESSION_DEGREES + loose) / (SESSION_DEGREES + 4.0 * (n - 1.0))
    alike = np.diag(np.square(_FLIGHT))
    alike[:4, :4] += _FLIGHT_COMMON**2
    degrees = _PRIOR_FLIGHTS + count - n
    flight = (inside.T @ inside + _PRIOR_FLIGHTS * alike) / degrees
    if same:
        near = [f for f, name in zip(healthy, sessions, strict=True) if name == same]
        none = np.zeros_like(flight)
        return Spread(mean_of(near), none, flight, degrees, len(near), n, left_out, false_alarms)
    session = (moved.T @ moved + _PRIOR_SESSIONS * prior) / (_PRIOR_SESSIONS + n - 1.0)
    mean = Features(middle, mean_of(healthy).supply)
    degrees = SESSION_DEGREES + n - 1.0
    return Spread(mean, session, flight, degrees, count, n, left_out, false_alarms)


def compare(
    spread: Spread,
    new: Sequence[Features],
    tried: Sequence[ChangeCandidate],
    supply_doubt: float = 0.0,
    exponent_doubt: float = 0.0,
) -> HealthyComparison:
    """Weigh all candidates by the probability of the new flights' mean under each.

    Args:
        spread: of the healthy flights.
        new: flights in one new state.
        tried: candidates of `signatures.candidates`.
        supply_doubt: standard deviation of the drive curve's supply exponent: flights at another
            voltage than the healthy ones may have the demand of all rotors wrong by it.
        exponent_doubt: standard deviation of the curve's exponent over its value: the size of a
        larger demand is known to that share, its presence is not.
    """
    now = mean_of(new)
    shift = Features(now.vector - spread.mean.vector, now.supply - spread.mean.supply)
    scale = spread.scale(len(new))
    if math.isfinite(shift.supply):
        scale[:4, :4] += (supply_doubt * shift.supply) ** 2
    demand = shift.demand
    distance = float(demand @ np.linalg.solve(scale[:4, :4], demand)) / demand.size
    usual = float(stats.f.sf(distance, demand.size, spread.degrees))
    nothing = float(_log_density(scale, spread.degrees, shift.vector, None)[0]) + math.log(
        NONE / (1.0 - NONE)
    )
    total = sum(_prior(c) for c in tried)
    logs, parts = [], []
    for candidate in tried:
        density = _log_density(scale, spread.degrees, shift.vector, candidate)
        log = float(logsumexp(density, b=_size_prior(candidate)))
        logs.append(log + math.log(_prior(candidate) / total))
        # the usual size weighs candidates; the size is what these flights say
        part = np.exp(density - density.max()) * candidate.volume
        parts.append(part / part.sum())
    highest = max(*logs, nothing)
    whole = float(np.exp(np.array(logs) - highest).sum()) + math.exp(nothing - highest)
    results = [
        CandidateResult(
            c, math.exp(log - highest) / whole, *_interval(c.sizes, part, exponent_doubt)
        )
        for c, log, part in zip(tried, logs, parts, strict=True)
    ]
    results.sort(key=lambda r: -r.probability)
    return HealthyComparison(math.exp(nothing - highest) / whole, tuple(results), shift, usual)


def smallest_seen(
    spread: Spread,
    new: Sequence[Features],
    tried: Sequence[ChangeCandidate],
    supply_doubt: float,
    asked: Sequence[str],
) -> dict[str, float]:
    """Return label of each candidate asked about -> the smallest of its sizes that would be seen.

    At that size the same number of flights, at their voltage, leave a probability of "no change"
    below one half. A size that is not tried is infinite.
    """
    supply = mean_of(new).supply

    def is_seen(demand: Array) -> bool:
        shown = Features(spread.mean.vector + np.append(demand, np.zeros(5)), supply)
        return compare(spread, [shown] * len(new), tried, supply_doubt).none <= CHANGED

    sizes = {}
    for candidate in tried:
        if candidate.label not in asked:
            continue
        size = candidate.sizes[:, 0]
        rows = np.flatnonzero(size > 0.0)
        k = bisect_left(rows, True, key=lambda row: is_seen(candidate.demand[row]))
        sizes[candidate.label] = float(size[rows[k]]) if k < rows.size else math.inf
    return sizes


def _count_false_alarms(
    healthy: Sequence[Features], sessions: Sequence[str], tried: Sequence[ChangeCandidate]
) -> tuple[int, int]:
    """Return the number of healthy sessions that the others call changed, and of how many.

    Where all are of one session, flights take the place of sessions.
    """
    alone = len(set(sessions)) == 1
    units = [str(k) for k in range(len(healthy))] if alone else list(sessions)
    names = sorted(set(units)) if len(healthy) > 1 else []
    false_alarms = 0
    for name in names:
        rest = [k for k, unit in enumerate(units) if unit != name]
        spread = spread_of(
            [healthy[k] for k in rest], [sessions[k] for k in rest], sessions[0] if alone else ""
        )
        left_out = [f for f, unit in zip(healthy, units, strict=True) if unit == name]
        false_alarms += compare(spread, left_out, tried).none <= CHANGED
    return false_alarms, len(names)


def _prior(candidate: ChangeCandidate) -> float:
    """Return the weight of a candidate before the data: effects alike, then rotors."""
    weight = _PRIOR[candidate.effect]
    if "+" in candidate.rotor:
        return _PAIR_PRIOR * weight / 6.0
    return weight / 4.0 if candidate.rotor else weight


def _interval(sizes: Array, weight: Array, share: float) -> tuple[Array, Array, Array]:
    """Return median and both ends of the 95 % interval (k,) of each size.

    The interval is widened by a standard deviation of that share of the size.
    """
    rows = np.zeros((sizes.shape[1], 3))
    for row, size in zip(rows, sizes.T, strict=True):
        values, cell = np.unique(size, return_inverse=True)
        edges = np.concatenate([values[:1], 0.5 * (values[1:] + values[:-1]), values[-1:]])
        steps = np.concatenate([[0.0], np.cumsum(np.bincount(cell, weight))])
        low, middle, high = np.interp([0.025, 0.5, 0.975], steps, edges)
        more = 1.96 * share * middle
        row[:] = (
            middle,
            middle - np.hypot(middle - low, more),
            middle + np.hypot(high - middle, more),
        )
    return rows[:, 0], rows[:, 1], rows[:, 2]


def _log_density(
    scale: Array, degrees: float, shift: Array, candidate: ChangeCandidate | None
) -> Array:
    """Return the log density (S,) of the shift (9,) under each size of a candidate, or under none.

    Demand is one draw of four; shake, swing and trail are draws by themselves.
    """
    demand, (mean, loose), extra = _predicted(candidate)
    gap = shift[:4] - demand
    wide = scale[:4, :4] + extra
    square = np.einsum("si,si->s", gap, np.linalg.solve(wide, gap[..., None])[..., 0])
    log = -0.5 * np.linalg.slogdet(wide)[1] - 0.5 * (degrees + 4.0) * np.log1p(square / degrees)
    for k in range(5):
        if math.isfinite(shift[4 + k]) and math.isfinite(scale[4 + k, 4 + k]):
            variance = scale[4 + k, 4 + k] + loose[:, k] ** 2
            square = (shift[4 + k] - mean[k]) ** 2 / variance
            log = log - 0.5 * np.log(variance) - 0.5 * (degrees + 1.0) * np.log1p(square / degrees)
    return np.asarray(log)


def _predicted(candidate: ChangeCandidate | None) -> tuple[Array, tuple[Array, Array], Array]:
    """Return the shift of a candidate.

    Of demand (S, 4); of shake, swing and trail the mean (5,) and standard deviation (S, 5);
    covariance of the demand that it leaves open (S, 4, 4).
    """
    if candidate is None:
        return np.zeros((1, 4)), (np.zeros(5), np.zeros((1, 5))), np.zeros((1, 4, 4))
    demand, effect = candidate.demand, candidate.effect
    largest = np.abs(demand).max(axis=1)
    mean, loose = np.zeros(5), np.zeros((len(demand), 5))
    extra = (_MISFIT * largest)[:, None, None] ** 2 * np.eye(4)
    yaw = np.outer(MODES[3], MODES[3])  # the torque of one rotor, shared by all
    if effect in (WEAK_PROPELLER, UNBALANCE, HANGING_LOAD, OTHER):
        loose[:, :2] = _ROUGH
    if effect == ADDED_WEIGHT:
        loose[:, :2] = _WEIGHED
    if effect in (WEAK_PROPELLER, ADDED_WEIGHT):
        loose[:, 2] = _DETUNED * largest
    if effect in (HANGING_LOAD, OTHER):
        loose[:, 2] = _SWUNG
    if effect == WEAK_PROPELLER:
        share = np.sum((_YAW_SHARE * candidate.sizes) ** 2, axis=1)
        extra = extra + share[:, None, None] * yaw
    if effect in (ADDED_WEIGHT, HANGING_LOAD):
        rotors = np.diag((demand[0] == demand[0].max()).astype(float))
        extra = extra + _WASH**2 * (rotors + yaw)
    if effect == HANGING_LOAD:
        k = ROTOR_NAMES.index(candidate.rotor)
        mean[3:] = _DRAGGED * np.sign([ARM_Y[k], -ARM_X[k]])
    if effect in (HANGING_LOAD, OTHER):
        loose[:, 3:] = _DRAGGED
    if effect == OTHER:
        extra = extra + candidate.sizes[:, :, None] ** 2 * np.eye(4)
    return demand, (mean, loose), extra


def _size_prior(candidate: ChangeCandidate) -> Array:
    """Return the probability of each row of sizes before the data (S,)."""
    usual = _SIZES.get(candidate.effect)
    weight = candidate.volume.copy()
    if usual is not None:
        size = np.abs(candidate.sizes)
        if candidate.effect == CENTRE:
            size = np.linalg.norm(size, axis=1, keepdims=True)
            weight = weight / (size[:, 0] + 1e-6)
        size = size + 1e-6
        weight = weight * np.prod(
            np.exp(-0.5 * (np.log(size / usual[0]) / usual[1]) ** 2) / size, axis=1
        )
    return np.asarray(weight / weight.sum())
