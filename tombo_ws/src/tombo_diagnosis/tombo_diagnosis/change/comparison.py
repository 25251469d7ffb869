"""New flights against healthy ones: how likely is each candidate, and none of them.

Healthy flights differ by day: another battery, another seat of it, other air. How much is known
from a few flights only, so their spread is fitted with a prior, and what is predicted for new
flights has the tails of Student's t. New flights of one day share one day's offset: their mean
is compared as one draw, however many they are.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.stats import f as fisher
from scipy.stats import t as student

from tombo_diagnosis.change.features import MODES, Features
from tombo_diagnosis.change.signatures import (
    ADDED_WEIGHT,
    CENTRE,
    HANGING_LOAD,
    MASS,
    UNBALANCE,
    WEAK_PROPELLER,
    ChangeCandidate,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES

DAY_DEMAND, DAY_SHAKE, DAY_SWING, DAY_TRAIL = 0.01, 0.2, 0.2, 0.01
"""Spread between days before any flight is seen, of logarithms, and of `trail` [s/m]. Demand: a
battery that sits 0.7 % of the arm off its place."""
DAY_COMMON = 0.015
"""The same of all rotors together: the density of air varies by 0.9 % with the pressure (9 hPa)
and 0.7 % with the room's temperature (2 K), a battery by 3 % of a third of the vehicle's mass."""
_PRIOR_FLIGHTS = 4.0
"""How many flights that weighs."""
_WITHIN = 0.004
"""Spread of demand between flights of one day."""

TYPICAL_SIZE: Mapping[str, float] = {
    WEAK_PROPELLER: 0.15, ADDED_WEIGHT: 0.1, HANGING_LOAD: 0.1, MASS: 0.1,
}  # fmt: skip
"""Sizes that clearly matter: shares of thrust and of mass, as in the registry."""
_CENTRE_SIZES = (0.02, 0.06, 0.2)
"""Shares of the arm; the registry's typical one is 0.04."""
_YAW_SHARE = 0.3
"""Change of a rotor's torque per thrust, as a share of the thrust lost: a cut or taped blade has
another ratio."""
_WASH = 0.1
"""Share of thrust, and of torque by the swirl, that a weight in its downwash may take from a
rotor, whatever its mass."""
_ROUGH = 0.7
"""Spread of the logarithm of shake where blades, or their air, are changed: a factor of 2."""
_DETUNED = 10.0
"""Logarithm of swing per demand: a rotor that gives less than asked for slackens the loops."""
_SWUNG = 0.7
"""Spread of the logarithm of swing with a hanging load: it may calm a vehicle or shake it, as
its controller does (the simulated one swings less by 0.2 to 0.4, whatever the thread)."""
_DRAGGED = 0.02
"""Trail of a hanging load [s/m], mean and spread, away from the side that it hangs on: 0.1 % of
the weight as drag at 0.3 m/s, at the end of an arm."""
CHANGED = 0.5
"""Probability that nothing has changed, below which something has."""
_PAIR_PRIOR = 0.1
"""Two weak propellers against one, before the data."""


@dataclass(frozen=True)
class Spread:
    """What healthy flights look like, and how certain that is."""

    mean: Features
    demand: Array
    """(4, 4) scale matrix of Student's t of one further day."""
    shake: Array
    """(2,) scale; NaN: not measured in all of them."""
    swing: float
    trail: Array
    """(2,) scale; NaN: not flown in all of them."""
    degrees: float
    """Of freedom."""
    flights: int


@dataclass(frozen=True)
class CandidateResult:
    """A candidate after the data."""

    candidate: ChangeCandidate
    probability: float
    size: float
    """The most probable one."""
    low: float
    high: float
    """95 % of the size's probability."""
    surprise: float = 1.0
    """Probability among healthy flights of a rest as large as this candidate leaves."""


@dataclass(frozen=True)
class HealthyComparison:
    """What new flights say."""

    none: float
    """Probability that nothing has changed."""
    surprise: float
    """Probability of a difference as large as this among healthy flights, in any direction."""
    found: tuple[CandidateResult, ...]
    """All candidates, most probable first."""
    shift: Features
    """New minus healthy."""


def spread_of(healthy: Sequence[Features]) -> Spread:
    """Return mean and spread of healthy flights, one or more."""
    n = len(healthy)
    mean = mean_of(healthy)
    demand = np.array([f.demand for f in healthy]) - mean.demand
    shake = np.array([f.shake for f in healthy]) - mean.shake
    swing = np.array([f.swing for f in healthy]) - mean.swing
    trail = np.array([f.trail for f in healthy]) - mean.trail
    degrees = _PRIOR_FLIGHTS + n - 1.0
    grown = (1.0 + 1.0 / n) / degrees
    # directions that these few flights do not vary in: as wide as they are on the whole, but for
    # what all rotors do together
    left = demand - demand.mean(axis=1, keepdims=True)
    overall = (_PRIOR_FLIGHTS * DAY_DEMAND**2 + float(np.sum(left**2)) / 3.0) / degrees
    expected = overall * np.eye(4) + DAY_COMMON**2
    return Spread(
        mean,
        (demand.T @ demand + _PRIOR_FLIGHTS * expected) * grown,
        np.sqrt((np.sum(shake**2, axis=0) + _PRIOR_FLIGHTS * DAY_SHAKE**2) * grown),
        math.sqrt((float(np.sum(swing**2)) + _PRIOR_FLIGHTS * DAY_SWING**2) * grown),
        np.sqrt((np.sum(trail**2, axis=0) + _PRIOR_FLIGHTS * DAY_TRAIL**2) * grown),
        degrees,
        n,
    )


def mean_of(flights: Sequence[Features]) -> Features:
    """Return the mean of what flights say."""
    return Features(
        np.mean([f.demand for f in flights], axis=0),
        np.mean([f.shake for f in flights], axis=0),
        float(np.mean([f.swing for f in flights])),
        np.mean([f.trail for f in flights], axis=0),
        float(np.mean([f.supply for f in flights])),
    )


def difference(new: Features, healthy: Features) -> Features:
    """Return new minus healthy."""
    return Features(
        new.demand - healthy.demand,
        new.shake - healthy.shake,
        new.swing - healthy.swing,
        new.trail - healthy.trail,
        new.supply - healthy.supply,
    )


def compare(
    spread: Spread,
    new: Sequence[Features],
    tried: Sequence[ChangeCandidate],
    centre: Array,
    supply_doubt: float = 0.0,
    exponent_doubt: float = 0.0,
) -> HealthyComparison:
    """Weigh all candidates by the probability of the new flights' mean under each.

    Args:
        spread: of the healthy flights.
        new: flights in one new state.
        tried: candidates of `signatures.candidates`.
        centre: of `signatures.centre_directions`.
        supply_doubt: standard deviation of the drive curve's supply exponent: flights at another
            voltage than the healthy ones may have the demand of all rotors wrong by it.
        exponent_doubt: standard deviation of the curve's exponent over its value: what is asked
            for more is known to that share, but not whether it is.
    """
    now = mean_of(new)
    shift = difference(now, spread.mean)
    within = np.eye(4) * _WITHIN**2 / len(new)
    if math.isfinite(shift.supply):
        within += (supply_doubt * shift.supply) ** 2
    weigher = _Weigher(spread, spread.demand + within, shift)
    still = np.zeros((1, 4)), np.zeros((1, 4, 4)), 0.0, 0.0, np.zeros(1)
    nothing = float(weigher.log_density(*still)[0]) + weigher.log_trail(None)
    entries = [(c, *weigher.of(c), _prior(c)) for c in tried]
    moved = _centre_candidate(weigher, centre)
    entries.append((*moved, 1.0))
    total = sum(prior for *_, prior in entries)
    logs = np.array([ld + math.log(p / total) for _, ld, *_, p in entries])
    top = max(float(logs.max()), nothing)
    weights, empty = np.exp(logs - top), math.exp(nothing - top)
    whole = float(weights.sum()) + empty
    results = [
        CandidateResult(c, float(w) / whole, size, *wider, weigher.rest(c, size))
        for (c, _, size, low, high, _), w in zip(entries, weights, strict=True)
        for wider in (_wider(size, low, high, exponent_doubt),)
    ]
    results.sort(key=lambda f: -f.probability)
    return HealthyComparison(empty / whole, weigher.surprise(), tuple(results), shift)


def smallest_seen(
    spread: Spread,
    new: Sequence[Features],
    tried: Sequence[ChangeCandidate],
    centre: Array,
    supply_doubt: float,
    asked: Sequence[str],
) -> dict[str, float]:
    """Return label of each candidate asked about -> the smallest of its sizes that would be seen.

    That is the size at which so many flights, at their voltage and otherwise as the healthy ones
    are, leave less than one half for "nothing has changed". A size that is not tried is infinite.
    """
    supply = mean_of(new).supply

    def is_seen(demand: Array) -> bool:
        shown = replace(spread.mean, demand=spread.mean.demand + demand, supply=supply)
        return compare(spread, [shown] * len(new), tried, centre, supply_doubt).none <= CHANGED

    sizes = {}
    for candidate in tried:
        if candidate.label not in asked:
            continue
        rows = np.flatnonzero(candidate.sizes > 0.0)
        k = bisect_left(rows, True, key=lambda row: is_seen(candidate.demand[row]))
        sizes[candidate.label] = float(candidate.sizes[rows[k]]) if k < rows.size else math.inf
    return sizes


def _wider(size: float, low: float, high: float, share: float) -> tuple[float, float]:
    """Return an interval with a standard deviation of that share of the size besides."""
    more = 1.96 * share * size
    return size - math.hypot(size - low, more), size + math.hypot(high - size, more)


def _prior(candidate: ChangeCandidate) -> float:
    """Return the weight of a candidate before the data: effects alike, then rotors."""
    if "+" in candidate.rotor:
        return _PAIR_PRIOR / 6.0
    return 0.25 if candidate.rotor else 1.0


@dataclass(frozen=True)
class _Weigher:
    spread: Spread
    scale: Array
    shift: Features

    def of(self, candidate: ChangeCandidate) -> tuple[float, float, float, float]:
        """Return log density over all sizes; the best size and its 95 % interval."""
        size = candidate.sizes
        extra, rough, swung = _nuisance(candidate)
        mean, loose = swung
        log = self.log_density(candidate.demand, extra, rough, mean, loose)
        log = log + self.log_trail(candidate)
        if size.size == 1:
            return float(log[0]), float("nan"), float("nan"), float("nan")
        prior = np.exp(-0.5 * (size / TYPICAL_SIZE[candidate.effect]) ** 2) * np.abs(
            np.gradient(size)
        )
        return _summed(log, prior / prior.sum(), size)

    def log_density(
        self, demand: Array, extra: Array, rough: float, swung: float, loose: Array
    ) -> Array:
        """Return the log density (S,) of the shift under candidates' shifts and their slack.

        Args:
            demand: (S, 4) shift that the candidate asks for.
            extra: (S, 4, 4) covariance of what it leaves open.
            rough: standard deviation of the shake that it leaves open.
            swung: mean of the swing's shift.
            loose: (S,) its standard deviation.
        """
        nu = self.spread.degrees
        gap = self.shift.demand - demand
        scale = self.scale + extra
        square = np.einsum("si,si->s", gap, np.linalg.solve(scale, gap[..., None])[..., 0])
        log = -0.5 * np.linalg.slogdet(scale)[1] - 0.5 * (nu + 4.0) * np.log1p(square / nu)
        for j in range(2):
            if np.isfinite(self.shift.shake[j]):
                log = log + _log_t(self.shift.shake[j], self.spread.shake[j], rough, nu)
        if math.isfinite(self.shift.swing):
            log = log + _log_t(self.shift.swing - swung, self.spread.swing, loose, nu)
        return np.asarray(log)

    def log_trail(self, candidate: ChangeCandidate | None) -> float:
        """Return the log density of the trail: only a hanging load drags."""
        mean, loose = _dragged(candidate)
        log = 0.0
        for gap, scale, m in zip(self.shift.trail, self.spread.trail, mean, strict=True):
            if math.isfinite(gap) and math.isfinite(scale):
                log += float(_log_t(gap - m, scale, loose, self.spread.degrees))
        return log

    def rest(self, candidate: ChangeCandidate, size: float) -> float:
        """Return the surprise at what a candidate of that size leaves."""
        if candidate.effect == CENTRE:
            return self.surprise(candidate.demand[0])
        k = 0 if math.isnan(size) else int(np.abs(candidate.sizes - size).argmin())
        extra, rough, (mean, loose) = _nuisance(candidate)
        return self.surprise(candidate.demand[k], extra[k], rough, mean, float(loose[k]))

    def surprise(
        self,
        demand: Array | None = None,
        extra: Array | float = 0.0,
        rough: float = 0.0,
        swung: float = 0.0,
        loose: float = 0.0,
    ) -> float:
        """Return the smallest p-value of demand, shake and swing, times their number."""
        nu, scale = self.spread.degrees, self.scale + extra
        gap = self.shift.demand - (0.0 if demand is None else demand)
        values = [float(fisher.sf(float(gap @ np.linalg.solve(scale, gap)) / 4.0, 4, nu))]
        ratios = [
            *(self.shift.shake / np.hypot(self.spread.shake, rough)),
            (self.shift.swing - swung) / math.hypot(self.spread.swing, loose),
        ]
        values += [2.0 * float(student.sf(abs(r), nu)) for r in ratios if math.isfinite(r)]
        return min(1.0, len(values) * min(values))


def _dragged(candidate: ChangeCandidate | None) -> tuple[Array, float]:
    """Return the trail of a candidate: mean (2,) and spread."""
    if candidate is None or candidate.effect != HANGING_LOAD:
        return np.zeros(2), 0.0
    k = ROTOR_NAMES.index(candidate.rotor)
    return _DRAGGED * np.sign([ARM_Y[k], -ARM_X[k]]), _DRAGGED


def _nuisance(candidate: ChangeCandidate) -> tuple[Array, float, tuple[float, Array]]:
    """Return what a candidate leaves open: of demand, shake and swing."""
    size, effect = np.abs(candidate.sizes), candidate.effect
    yaw = np.outer(MODES[3], MODES[3])  # the torque of one rotor, shared by all
    extra = np.zeros((size.size, 4, 4))
    if effect == WEAK_PROPELLER:
        extra += (_YAW_SHARE * size)[:, None, None] ** 2 * yaw
    if effect == ADDED_WEIGHT:
        rotors = np.diag((candidate.demand[0] == candidate.demand[0].max()).astype(float))
        extra += _WASH**2 * (rotors + yaw)
    if effect == HANGING_LOAD:
        return extra, _ROUGH, (0.0, np.full(size.size, _SWUNG))
    if effect == UNBALANCE:
        return extra, _ROUGH, (0.0, np.zeros(size.size))
    if effect in (WEAK_PROPELLER, ADDED_WEIGHT):
        demand = np.abs(candidate.demand).max(axis=1)
        return extra, _ROUGH, (0.0, _DETUNED * demand)
    return extra, 0.0, (0.0, np.zeros(size.size))


def _centre_candidate(
    weigher: _Weigher, centre: Array
) -> tuple[ChangeCandidate, float, float, float, float]:
    """Return the moved centre of gravity in any direction; its size is a share of the arm."""
    scales = np.array(_CENTRE_SIZES)
    spread = centre.T @ centre
    extra = scales[:, None, None] ** 2 * spread
    log = weigher.log_density(np.zeros((3, 4)), extra, 0.0, 0.0, np.zeros(3))
    log = log + weigher.log_trail(None)
    density, *_ = _summed(log, np.full(3, 1.0 / 3.0), scales)
    gain = np.linalg.solve(
        centre @ np.linalg.solve(weigher.scale, centre.T) + np.eye(2) / scales[-1] ** 2,
        centre @ np.linalg.solve(weigher.scale, weigher.shift.demand),
    )
    error = 1.96 / math.sqrt(
        float(np.linalg.eigvalsh(centre @ np.linalg.solve(weigher.scale, centre.T))[0])
    )
    size = float(np.linalg.norm(gain))
    candidate = ChangeCandidate(CENTRE, "", gain, (gain @ centre)[None])
    return candidate, density, size, max(size - error, 0.0), size + error


def _summed(log: Array, prior: Array, size: Array) -> tuple[float, float, float, float]:
    top = float(log.max())
    weight = np.exp(log - top) * prior
    total = float(weight.sum())
    order = np.argsort(size)
    steps = np.cumsum(weight[order]) / total
    low, middle, high = (float(np.interp(q, steps, size[order])) for q in (0.025, 0.5, 0.975))
    return top + math.log(total), middle, low, high


def _log_t(gap: Array | float, scale: float, loose: Array | float, nu: float) -> Array:
    """Return the log density of Student's t, widened by what is left open; constants left out."""
    wide = scale**2 + np.asarray(loose) ** 2
    return np.asarray(-0.5 * np.log(wide) - 0.5 * (nu + 1.0) * np.log1p(gap**2 / wide / nu))
