"""The probability of a crash and its interval, from few flights.

The limit state is the margin of a flight; it is random even for fixed inputs, since each flight
has a seed of its own. Importance sampling over the inputs alone, with seeds drawn independently,
is unbiased for such a limit state: the estimate is the mean over both.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq
from scipy.special import chdtri

from tombo_dynamics.arrays import Array
from tombo_flight.campaign.statistics import exact_interval

AS_GIVEN = 0.1
HALFWAY = 0.2
"""Shares of the mixture, once crashes are found."""
_WIDE = 2.5
"""Standard deviation of the first search."""
_MOST_CENTRES = 300
_BLOCK = 10_000
"""Points whose distances to all centres are in memory at once."""
_INFLATION = 1.3
"""Of the kernels' variance: too wide costs little, too narrow spoils the estimate."""
_TRUST = 5.0
"""Effective flights for each input at which half of their own covariance is taken."""


@dataclass(frozen=True)
class Kernels:
    """A mixture of normal distributions with one covariance."""

    centres: Array
    """(M, d)."""
    weights: Array
    """(M,), sum 1."""
    root: Array
    """(d, d), Cholesky factor of the covariance."""

    def density(self, points: Array) -> Array:
        """Return the density at points (N, d)."""
        starts = range(0, len(points), _BLOCK)
        return np.concatenate([self._block_density(points[i : i + _BLOCK]) for i in starts])

    def _block_density(self, points: Array) -> Array:
        a = np.linalg.solve(self.root, points.T).T
        b = np.linalg.solve(self.root, self.centres.T).T
        square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
        scale = (2.0 * math.pi) ** (-0.5 * a.shape[1]) / np.prod(np.diag(self.root))
        found: Array = np.exp(-0.5 * square) @ self.weights * scale
        return found


@dataclass(frozen=True)
class DrawProposal:
    """A mixture of the inputs as given and of others."""

    as_given: float = 1.0
    """Share that is drawn as given."""
    others: tuple[tuple[float, Kernels], ...] = ()
    """Share and distribution of the rest."""

    def density(self, points: Array) -> Array:
        """Return the density at points (N, d)."""
        found = self.as_given * normal_density(points)
        for share, kernels in self.others:
            found = found + share * kernels.density(points)
        return found

    def draw(self, dimension: int, rng: np.random.Generator) -> tuple[Array, bool]:
        """Return a point (d,), and whether it was drawn as given."""
        share = rng.random() - self.as_given
        normal: Array = rng.standard_normal(dimension)
        if share < 0.0 or not self.others:
            return normal, True
        for part, kernels in self.others:  # noqa: B007
            share -= part
            if share < 0.0:
                break
        centre = rng.choice(len(kernels.weights), p=kernels.weights)
        return kernels.centres[centre] + kernels.root @ normal, False


def normal_density(points: Array) -> Array:
    """Return the density of the inputs as given at points (N, d)."""
    scale = (2.0 * math.pi) ** (-0.5 * points.shape[1])
    found: Array = np.exp(-0.5 * (points**2).sum(1)) * scale
    return found


def first_proposal(dimension: int) -> DrawProposal:
    """Return the one of the first search: half as given, half wide on all sides."""
    kernels = Kernels(np.zeros((1, dimension)), np.ones(1), _WIDE * np.eye(dimension))
    return DrawProposal(0.5, ((0.5, kernels),))


def fitted_proposal(points: Array, weights: Array, as_given: float) -> DrawProposal:
    """Return the mixture for flights (N, d) that are to be seen more often.

    Args:
        points: their inputs, at least one.
        weights: (N,), density as given over density with which they were drawn.
        as_given: share that is drawn as given.
    """
    dimension = points.shape[1]
    weights = weights / weights.sum()
    effective = 1.0 / float((weights**2).sum())
    mean = weights @ points
    away = points - mean
    own = effective / (effective + _TRUST * dimension)
    covariance = own * (away * weights[:, None]).T @ away + (1.0 - own) * np.eye(dimension)
    width = (4.0 / ((dimension + 2.0) * effective)) ** (2.0 / (dimension + 4.0))
    width = min(width, 1.0)  # Silverman's, squared
    heaviest = np.argsort(-weights, kind="stable")[:_MOST_CENTRES]
    centres = mean + math.sqrt(1.0 - width) * away[heaviest]
    kept = weights[heaviest] / weights[heaviest].sum()
    near = Kernels(centres, kept, np.linalg.cholesky(_INFLATION * width * covariance))
    half = Kernels(0.5 * centres, kept, np.eye(dimension))
    rest = 1.0 - as_given
    return DrawProposal(as_given, ((rest * (1.0 - HALFWAY), near), (rest * HALFWAY, half)))


METHODS = ("adaptive", "monte-carlo")
_SEARCHES = 4
"""Searches, each with a tenth of the flights."""
_MORE_SEARCHES = 2
"""That follow at most where these have found fewer crashes than `_FEW`."""
_FEW = 10
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

Fly = Callable[[int, Array, NDArray[np.int64]], Array]
"""(number of the first flight, inputs (n, d), seeds (n,)) → margins (n,)."""


@dataclass(frozen=True)
class FlightSample:
    """Flights, one a row, in their order."""

    points: Array
    """(N, d), standard normal numbers."""
    seeds: NDArray[np.int64]
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
class RiskEstimate:
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
    seed: int, flight: int, proposal: DrawProposal, dimension: int
) -> tuple[Array, bool, int]:
    """Return inputs (d,), whether they are drawn as given, and the seed of a flight."""
    rng = np.random.default_rng((seed, flight))
    own = int(rng.integers(10**9))
    point, as_given = proposal.draw(dimension, rng)
    return point, as_given, own


def estimate(
    dimension: int, flights: int, method: str, seed: int, fly: Fly, number: int = 0
) -> tuple[RiskEstimate, FlightSample]:
    """Fly, and return the probability of a crash with the flights that it is from.

    Args:
        dimension: number of inputs; with none it is plain Monte Carlo.
        flights: all that may be flown.
        method: one of `METHODS`.
        seed: all draws follow from it, so that the same flights give the same figures.
        fly: flies the flights of one stage.
        number: of the first flight; those of another number are drawn independently.
    """
    flown = _FlownStages(dimension, seed, fly, number)
    proposal = DrawProposal()
    if method == "adaptive" and dimension:
        proposal = _search(flown, flights // 10)
    first = flown.count
    flown.fly(proposal, flights - first)
    sample = flown.sample(first)
    return _estimate(sample, proposal, flown.stages), sample


class _FlownStages:
    """The stages that are flown so far."""

    def __init__(self, dimension: int, seed: int, fly: Fly, number: int) -> None:
        self._dimension, self._seed, self._fly, self._number = dimension, seed, fly, number
        self.stages: list[tuple[DrawProposal, int]] = []
        self.points: Array = np.zeros((0, dimension))
        self.seeds: NDArray[np.int64] = np.zeros(0, dtype=np.int64)
        self.as_given: NDArray[np.bool_] = np.zeros(0, dtype=bool)
        self.margins: Array = np.zeros(0)

    @property
    def count(self) -> int:
        return self.margins.size

    def fly(self, proposal: DrawProposal, count: int) -> None:
        """Fly a stage."""
        first = self._number + self.count
        points = np.empty((count, self._dimension))
        as_given, seeds = np.empty(count, dtype=bool), np.empty(count, dtype=np.int64)
        for i in range(count):
            points[i], as_given[i], seeds[i] = flight_draw(
                self._seed, first + i, proposal, self._dimension
            )
        margins = self._fly(first, points, seeds)
        self.points = np.concatenate([self.points, points])
        self.seeds = np.concatenate([self.seeds, seeds])
        self.as_given = np.concatenate([self.as_given, as_given])
        self.margins = np.concatenate([self.margins, margins])
        self.stages.append((proposal, count))

    def weights(self) -> Array:
        """Return the density as given over that of all stages together."""
        drawn = sum(count * proposal.density(self.points) for proposal, count in self.stages)
        found: Array = normal_density(self.points) * self.count / drawn
        return found

    def sample(self, first: int) -> FlightSample:
        """Return all flights."""
        return FlightSample(
            self.points, self.seeds, self.margins, self.weights(), self.as_given, first
        )


def _search(flown: _FlownStages, count: int) -> DrawProposal:
    """Search crashes, level by level, and return the proposal for the estimate."""
    proposal = first_proposal(flown.points.shape[1])
    most = _SEARCHES + _MORE_SEARCHES
    for number in range(1, most + 1):
        flown.fly(proposal, count)
        weights, crashed = flown.weights(), flown.margins < 0.0
        if number == 1 and (weights * crashed).mean() >= _OFTEN:
            return DrawProposal()
        found = weights[crashed]
        effective = found.sum() ** 2 / (found**2).sum() if found.size else 0.0
        level = max(0.0, float(np.quantile(flown.margins[-count:], _WORST)))
        worst = crashed if effective > _SOME else flown.margins <= level
        as_given = AS_GIVEN if crashed.any() or number < most else _UNSEEN
        proposal = fitted_proposal(flown.points[worst], weights[worst], as_given)
        if effective > _ENOUGH or (number >= _SEARCHES and found.size >= _FEW):
            break
    return proposal


def _estimate(
    sample: FlightSample, proposal: DrawProposal, stages: list[tuple[DrawProposal, int]]
) -> RiskEstimate:
    points, crashed = sample.points[sample.first :], sample.margins[sample.first :] < 0.0
    number, flights = int(crashed.sum()), crashed.size
    method = METHODS[0] if proposal.others else METHODS[1]
    if not number:
        unseen = stages if not (sample.margins < 0.0).any() else stages[-1:]
        high = _unseen([(stage.as_given, count) for stage, count in unseen])
        return RiskEstimate(None, 0.0, high, method, 0.0)
    if not proposal.others:
        low, high = exact_interval(number, flights)
        return RiskEstimate(number / flights, low, high, method, number / flights)
    hits = points[crashed]
    weights = normal_density(hits) / proposal.density(hits) / flights
    low, high = weighted_interval(weights)
    return RiskEstimate(float(weights.sum()), low, min(high, 1.0), method, number / flights)


def weighted_interval(weights: Array) -> tuple[float, float]:
    """Return the 95 % interval of a sum of weights of rare events (Fay and Feuer 1997).

    With equal weights it is the exact interval of a Poisson count.
    """
    total, variance, largest = weights.sum(), (weights**2).sum(), weights.max()
    low = variance / total / 2.0 * chdtri(2.0 * total**2 / variance, 1.0 - _MISS)
    total, variance = total + largest, variance + largest**2
    high = variance / total / 2.0 * chdtri(2.0 * total**2 / variance, _MISS)
    return float(low), float(high)


def agree(one: RiskEstimate, other: RiskEstimate) -> bool:
    """Return whether two independent estimates may be of the same probability.

    They may where 0 is in the 95 % interval of their difference, which is put together from
    theirs (Newcombe 1998, square and add).
    """
    lower, higher = sorted((one, other), key=lambda each: each.probability or 0.0)
    difference = (higher.probability or 0.0) - (lower.probability or 0.0)
    reach = math.hypot(
        (higher.probability or 0.0) - higher.low, lower.high - (lower.probability or 0.0)
    )
    return difference <= reach


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
