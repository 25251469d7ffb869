"""The unknowns of a diagnosis, and the evidence of a set of causes: Bayesian linear regression.

A lab knows its nominal parameters only to a *tolerance*: such an error is not reported. Each
effect states in its registration how much of it healthy vehicles have (`Effect.healthy_spread`).
It also keeps a cause from being named for the small change of another parameter.

Near one theta the residuals are linear in the free parameters. With Gaussian noise and priors, the
probability of the data under "these effects are present, all else within its tolerance" then has a
closed form. It penalises free parameters: an effect with six must explain more than one with two.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType
from typing import Any

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tombo_dynamics.arrays import Array
from tombo_dynamics.effect_registry import HEALTHY_SPREAD


@dataclass(frozen=True)
class NormalEquations:
    """Whitened normal equations: cost(d) = square - 2 vector.d + d.matrix.d."""

    matrix: Array
    """(K, K)"""
    vector: Array
    """(K,)"""
    square: float

    def __add__(self, other: NormalEquations) -> NormalEquations:
        """Return the equations of both sets of data."""
        return NormalEquations(
            self.matrix + other.matrix, self.vector + other.vector, self.square + other.square
        )


@dataclass(frozen=True)
class Posterior:
    """Gaussian posterior of the unknowns."""

    mean: Array
    """(K,)"""
    covariance: Array
    """(K, K)"""
    evidence: float
    """Logarithm of the probability of the data, up to a constant of the data."""


def solve(
    normal: NormalEquations,
    deviations: Array,
    prior_mean: Array | None = None,
    covariance: bool = True,
) -> Posterior:
    """Return mean and covariance of the unknowns, and the evidence of the prior.

    Args:
        normal: equations about the present point.
        deviations: (K,) prior standard deviations.
        prior_mean: (K,) prior means against the present point; None: zeros.
        covariance: False: leave it out (its diagonal is then the prior's).
    """
    prior_mean = np.zeros(deviations.size) if prior_mean is None else prior_mean
    scaled = deviations[:, None] * normal.matrix * deviations
    scaled[np.diag_indices_from(scaled)] += 1.0
    factor = cho_factor(scaled, lower=True, check_finite=False)
    # About the prior's centre the unknowns are deviations * z, z standard normal.
    about = normal.vector - normal.matrix @ prior_mean
    square = normal.square - float((2.0 * normal.vector - normal.matrix @ prior_mean) @ prior_mean)
    inner = deviations * about
    z = cho_solve(factor, inner, check_finite=False)
    logdet = 2.0 * float(np.log(np.diag(factor[0])).sum())
    spread: Array = np.diag(deviations**2)
    if covariance:
        inverse = cho_solve(factor, np.eye(z.size), check_finite=False)
        spread = deviations[:, None] * inverse * deviations
    return Posterior(
        prior_mean + deviations * z, spread, -0.5 * (square - float(inner @ z)) - 0.5 * logdet
    )


TIGHT = 0.2
"""Factor on the tolerances for tight priors."""
NOMINAL_WIDTHS: Mapping[str, float] = MappingProxyType({})
"""All stochastic effects as wide as in the nominal model."""
_PINNED = 1e-3
_MAX_BOUND_EXCESS_SIGMAS = 3.0
"""A fit that is further beyond a parameter's bound than this is rejected."""


@dataclass(frozen=True)
class FreeParameter:
    """One parameter of an effect."""

    index: int
    """Place in theta."""
    effect: str
    name: str
    unit: str
    null: float
    low: float
    high: float
    scale: float
    """A change of this size clearly matters; the prior's standard deviation of a cause."""
    stochastic: bool = False
    """Of a stochastic effect, which is fitted by its width and has no place in theta."""
    healthy_spread: float = HEALTHY_SPREAD
    """Standard deviation between healthy vehicles, as a share of `scale`."""
    known_to: float | None = None
    """Standard deviation with which this vehicle's own value is known; None: as usual."""
    tolerance_inflation: float = 1.0
    """Factor by which the tolerance itself may be too small, as few healthy flights leave it."""

    @property
    def label(self) -> str:
        """effect.name."""
        return f"{self.effect}.{self.name}"

    @property
    def tolerance(self) -> float:
        """Standard deviation of what counts as healthy; 0: exactly the nominal value is."""
        return self.healthy_spread * self.scale if self.known_to is None else self.known_to

    @property
    def resolution(self) -> float:
        """A change that is small for a fit: the tolerance, a usual one where there is none."""
        return self.tolerance or HEALTHY_SPREAD * self.scale

    @property
    def step(self) -> float:
        """Step of a numerical derivative."""
        return 0.1 * self.scale


@dataclass(frozen=True)
class Unknowns:
    """The unknowns: parameters of theta, then random draws."""

    parameters: tuple[FreeParameter, ...]
    """All of theta."""
    indices: tuple[int, ...]
    """Places in theta of the parameters that these data can show."""
    draws: tuple[str, ...] = ()
    """Of each draw the stochastic effect that it belongs to."""
    draw_width: float = 1.0
    """Standard deviation of a draw's unknown in the nominal model."""
    draw_inflation: float = 1.0
    """Factor by which that itself may be too small."""
    absorbed: frozenset[int] = frozenset()
    """Places in theta that the nominal model's own fit has absorbed: always free."""
    unobservable: frozenset[int] = frozenset()
    """Places in theta of parameters far below the noise even at the size that matters."""

    refused: frozenset[str] = frozenset()
    """Effects that other data contradict: they are not named."""

    @cached_property
    def identifiable(self) -> tuple[int, ...]:
        """Places in theta of the parameters of possible causes."""
        return tuple(
            i
            for i in self.indices
            if i not in self.absorbed
            and i not in self.unobservable
            and self.parameters[i].effect not in self.refused
        )

    @cached_property
    def effects(self) -> tuple[str, ...]:
        """Effects with a mean, in the order of the registry."""
        return tuple(dict.fromkeys(p.effect for p in self.parameters))

    @property
    def count(self) -> int:
        """All unknowns."""
        return len(self.indices) + len(self.draws)

    @cached_property
    def variants(self) -> dict[str, list[tuple[int, ...]]]:
        """Effect -> the ways in which it can be present: one parameter, those of a unit, all.

        Each way is a tuple of places in theta.
        """
        table: dict[str, list[tuple[int, ...]]] = {}
        for effect in self.effects:
            parameters = [self.parameters[i] for i in self.identifiable]
            parameters = sorted(
                (p for p in parameters if p.effect == effect), key=lambda p: p.index
            )
            units = dict.fromkeys(p.unit for p in parameters)
            ways: list[tuple[int, ...]] = [(p.index,) for p in parameters]
            ways += [tuple(p.index for p in parameters if p.unit == unit) for unit in units]
            ways.append(tuple(p.index for p in parameters))
            table[effect] = list(dict.fromkeys(way for way in ways if way))
        return table

    def deviations(
        self,
        free: Sequence[int] = (),
        prior_std_scale: Mapping[str, float] = NOMINAL_WIDTHS,
        tight: float = 1.0,
        pinned: Sequence[int] = (),
        doubted: Collection[int] = (),
    ) -> Array:
        """Return (count) prior standard deviations.

        Args:
            free: places in theta of the parameters with a wide prior: as wide as the size that
            clearly matters.
            prior_std_scale: stochastic effect -> factor on its draws' width; absent effects have
            1.
            tight: factor on the tolerances of everything else.
            pinned: columns that stay at a bound of their parameter.
            doubted: places in theta of healthy parameters whose tolerance is in doubt.
        """
        values = [
            p.scale
            if p.index in free or p.index in self.absorbed
            else tight * p.tolerance * (p.tolerance_inflation if p.index in doubted else 1.0)
            for p in (self.parameters[i] for i in self.indices)
        ]
        values += [self.draw_width * prior_std_scale.get(effect, 1.0) for effect in self.draws]
        deviations = np.array(values)
        deviations[list(pinned)] *= _PINNED
        return deviations

    def places(self, indices: Sequence[int]) -> list[int]:
        """Return the columns of parameters that can be seen."""
        return [self.indices.index(i) for i in indices if i in self.indices]

    def outside(self, theta: Array, free: Sequence[int], mean: Array) -> bool:
        """Return whether a step from theta ends beyond a bound of its free parameters."""
        return any(
            not self.parameters[i].low <= theta[i] + mean[place] <= self.parameters[i].high
            for i, place in zip(free, self.places(free), strict=True)
        )

    def bounds_penalty(
        self, theta: Array, free: Sequence[int], solution: Posterior, fitted: bool = False
    ) -> float:
        """Return the cost in log evidence of a fit beyond its parameters' bounds.

        The linearised model may end far beyond them; `fitted`: it is a fit of the model itself.
        """
        cost = 0.0
        for index, place in zip(free, self.places(free), strict=True):
            p = self.parameters[index]
            value = theta[index] + solution.mean[place]
            over = max(p.low - value, value - p.high, 0.0)
            variance = max(float(solution.covariance[place, place]), 1e-18)
            deviation = math.sqrt(variance) + p.resolution
            if fitted and over > _MAX_BOUND_EXCESS_SIGMAS * deviation:
                return math.inf
            cost += 0.5 * (over / deviation) ** 2
        return min(cost, 1e6)


@dataclass(frozen=True, eq=False)
class Fit:
    """A set of freed parameters, fitted; all else within its tolerance."""

    free: tuple[int, ...]
    """Places in theta."""
    prior_std_scale: Mapping[str, float]
    """Stochastic effect -> factor on its width in the nominal model."""
    theta: Array
    """All parameters, about which the equations are."""
    prior_mean: Array
    """(count) means of the prior, about theta."""
    solution: Posterior
    """About theta, so that its mean is what is left to do: nearly nothing for free ones."""
    normal: NormalEquations
    """Of all data, about theta."""
    evidence: float
    """Logarithm of the probability of the data."""
    tangent: Any
    """The model's own state to continue from here."""
    pinned: tuple[int, ...] = ()
    """Columns held at a bound, because the data would move them beyond it."""
