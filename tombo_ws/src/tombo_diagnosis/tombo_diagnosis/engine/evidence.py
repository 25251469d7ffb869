"""Evidence of a set of causes: Bayesian linear regression in closed form.

Near one theta the residuals are linear in the free parameters. With Gaussian noise and priors, the
probability of the data under "these effects are present, all else within its tolerance" then has a
closed form. It penalises free parameters: an effect with six must explain more than one with two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from tombo_dynamics.arrays import Array


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
