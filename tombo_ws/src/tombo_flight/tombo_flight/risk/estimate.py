"""The probability of a crash and its interval, from few flights.

The limit state is the margin of a flight; it is random even for fixed inputs, since each flight
has a seed of its own. Importance sampling over the inputs alone, with seeds drawn independently,
is unbiased for such a limit state: the estimate is the mean over both.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtri

from tombo_dynamics.arrays import Array
from tombo_flight.campaign.statistics import exact_interval
from tombo_flight.risk.proposal import (
    AS_GIVEN,
    Proposal,
    first_proposal,
    fitted_proposal,
    normal_density,
)

METHODS = ("adaptive", "monte-carlo")
_SEARCHES = 4
"""Searches at most, each with a tenth of the flights."""
_WORST = 0.1
"""Share of a search's flights that the next one goes to."""
_SOME = 10.0
"""Effective crashes from which the next search goes to crashes alone, not to the worst flights."""
_ENOUGH = 50.0
"""Effective crashes after which the search ends."""
_OFTEN = 0.05
"""Crashes are so frequent that plain Monte Carlo is as good."""
_UNSEEN = 0.5
"""Share that is drawn as given where no search found a crash."""
_MISS = 0.025
"""Probability of an error on each side of the interval."""

Fly = Callable[[int, Array, Array], Array]
"""(number of the first flight, inputs (n, d), seeds (n,)) → margins (n,)."""


@dataclass(frozen=True)
class Sample:
    """Flights, one a row, in their order."""

    points: Array
    """(N, d), standard normal numbers."""
    seeds: Array
    """(N,)."""
    margins: Array
    """(N,)."""
    weights: Array
    """(N,), density as given over that of all stages together: for questions to all flights."""
    as_given: NDArray[np.bool_]
    """(N,), whether drawn from the inputs as given."""
    first: int
    """First flight of the estimate; those before searched."""


@dataclass(frozen=True)
class Estimate:
    """The probability of a crash."""

    probability: float | None
    """None: no crash was found, only `high` is known."""
    low: float
    high: float
    """95 % interval."""
    method: str
    """How the flights of the estimate were drawn: one of `METHODS`."""
    share: float
    """Of the flights of the estimate that crashed."""


def flight_draw(
    seed: int, flight: int, proposal: Proposal, dimension: int
) -> tuple[Array, bool, int]:
    """Return inputs (d,), whether they are drawn as given, and the seed of a flight."""
    rng = np.random.default_rng((seed, flight))
    own = int(rng.integers(10**9))
    point, as_given = proposal.draw(dimension, rng)
    return point, as_given, own


def estimate(
    dimension: int, flights: int, method: str, seed: int, fly: Fly
) -> tuple[Estimate, Sample]:
    """Fly, and return the probability of a crash with the flights that it is from.

    Args:
        dimension: number of inputs; with none it is plain Monte Carlo.
        flights: all that may be flown.
        method: one of `METHODS`.
        seed: all draws follow from it, so that the same flights give the same figures.
        fly: flies the flights of one stage.
    """
    flown = _Flown(dimension, seed, fly)
    proposal = Proposal()
    if method == "adaptive" and dimension:
        proposal = _search(flown, flights // 10)
    first = flown.count
    flown.fly(proposal, flights - first)
    sample = flown.sample(first)
    return _estimate(sample, proposal, flown.stages), sample


class _Flown:
    """The stages that are flown so far."""

    def __init__(self, dimension: int, seed: int, fly: Fly) -> None:
        self._dimension, self._seed, self._fly = dimension, seed, fly
        self.stages: list[tuple[Proposal, int]] = []
        self.points: Array = np.zeros((0, dimension))
        self.seeds: Array = np.zeros(0, dtype=np.int64)
        self.as_given: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self.margins: Array = np.zeros(0)

    @property
    def count(self) -> int:
        return self.margins.size

    def fly(self, proposal: Proposal, count: int) -> None:
        """Fly a stage."""
        first = self.count
        points, as_given, seeds = zip(
            *(flight_draw(self._seed, first + i, proposal, self._dimension) for i in range(count)),
            strict=True,
        )
        new, own = np.array(points).reshape(count, self._dimension), np.array(seeds)
        margins = self._fly(first, new, own)
        self.points = np.concatenate([self.points, new])
        self.seeds = np.concatenate([self.seeds, own])
        self.as_given = np.concatenate([self.as_given, as_given])
        self.margins = np.concatenate([self.margins, margins])
        self.stages.append((proposal, count))

    def weights(self) -> Array:
        """Return the density as given over that of all stages together."""
        drawn = sum(count * proposal.density(self.points) for proposal, count in self.stages)
        found: Array = normal_density(self.points) * self.count / drawn
        return found

    def sample(self, first: int) -> Sample:
        """Return all flights."""
        return Sample(self.points, self.seeds, self.margins, self.weights(), self.as_given, first)


def _search(flown: _Flown, count: int) -> Proposal:
    """Search crashes, level by level, and return the proposal for the estimate."""
    proposal = first_proposal(flown.points.shape[1])
    for number in range(_SEARCHES):
        flown.fly(proposal, count)
        weights, crashed = flown.weights(), flown.margins < 0.0
        if number == 0 and (weights * crashed).mean() >= _OFTEN:
            return Proposal()
        found = weights[crashed]
        effective = found.sum() ** 2 / (found**2).sum() if found.size else 0.0
        level = max(0.0, float(np.quantile(flown.margins[-count:], _WORST)))
        worst = crashed if effective > _SOME else flown.margins <= level
        as_given = AS_GIVEN if crashed.any() or number < _SEARCHES - 1 else _UNSEEN
        proposal = fitted_proposal(flown.points[worst], weights[worst], as_given)
        if effective > _ENOUGH:
            break
    return proposal


def _estimate(sample: Sample, proposal: Proposal, stages: list[tuple[Proposal, int]]) -> Estimate:
    points, crashed = sample.points[sample.first :], sample.margins[sample.first :] < 0.0
    number, flights = int(crashed.sum()), crashed.size
    method = METHODS[0] if proposal.others else METHODS[1]
    if not number:
        unseen = stages if not (sample.margins < 0.0).any() else stages[-1:]
        high = _unseen([(one.as_given, count) for one, count in unseen])
        return Estimate(None, 0.0, high, method, 0.0)
    if not proposal.others:
        low, high = exact_interval(number, flights)
        return Estimate(number / flights, low, high, method, number / flights)
    hits = points[crashed]
    weights = normal_density(hits) / proposal.density(hits) / flights
    low, high = weighted_interval(weights)
    return Estimate(float(weights.sum()), low, min(high, 1.0), method, number / flights)


def weighted_interval(weights: Array) -> tuple[float, float]:
    """Return the 95 % interval of a sum of weights of rare events (Fay and Feuer 1997).

    With equal weights it is the exact interval of a Poisson count.
    """
    total, variance, largest = weights.sum(), (weights**2).sum(), weights.max()
    low = variance / total / 2.0 * chdtri(2.0 * total**2 / variance, 1.0 - _MISS)
    total, variance = total + largest, variance + largest**2
    high = variance / total / 2.0 * chdtri(2.0 * total**2 / variance, _MISS)
    return float(low), float(high)


def _unseen(stages: list[tuple[float, int]]) -> float:
    """Return the probability at which flights without any crash have a chance of 2.5 %.

    Of a stage's flights a share is drawn as given, so each crashes with that share of the
    probability at least. With all drawn as given it is Clopper and Pearson's bound.

    Args:
        stages: share that is drawn as given, and number of flights, of each.
    """

    def excess(p: float) -> float:
        chance = sum(count * np.log1p(-share * p) for share, count in stages)
        return float(chance - np.log(_MISS))

    return 1.0 if excess(1.0 - 1e-12) > 0.0 else float(brentq(excess, 0.0, 1.0 - 1e-12))
