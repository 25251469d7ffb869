"""Where inputs are drawn from, in the space in which each is a standard normal number.

Importance sampling: a mixture of the inputs as given, of a kernel density over the worst flights
so far (nonparametric adaptive importance sampling, Zhang 1996; kernels shrunk to their mean as
West 1993), and of the same moved halfway to the middle, which keeps weights small on the way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array

AS_GIVEN = 0.1
HALFWAY = 0.2
"""Shares of the mixture, once crashes are found."""
_WIDE = 2.5
"""Standard deviation of the first search."""
_MOST_CENTRES = 300
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
        a = np.linalg.solve(self.root, points.T).T
        b = np.linalg.solve(self.root, self.centres.T).T
        square = (a**2).sum(1)[:, None] + (b**2).sum(1) - 2.0 * a @ b.T
        scale = (2.0 * math.pi) ** (-0.5 * a.shape[1]) / np.prod(np.diag(self.root))
        found: Array = np.exp(-0.5 * square) @ self.weights * scale
        return found


@dataclass(frozen=True)
class Proposal:
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


def first_proposal(dimension: int) -> Proposal:
    """Return the one of the first search: half as given, half wide on all sides."""
    kernels = Kernels(np.zeros((1, dimension)), np.ones(1), _WIDE * np.eye(dimension))
    return Proposal(0.5, ((0.5, kernels),))


def fitted_proposal(points: Array, weights: Array, as_given: float) -> Proposal:
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
    return Proposal(as_given, ((rest * (1.0 - HALFWAY), near), (rest * HALFWAY, half)))
