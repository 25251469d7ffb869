"""Evidence in closed form, against its integral."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_diagnosis.engine.regression import NormalEquations, solve

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.floats(0.05, 3.0)


def equations(design, left):
    return NormalEquations(design.T @ design, design.T @ left, float(left @ left))


def data(seed, unknowns, rows=12):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((rows, unknowns)), rng.standard_normal(rows)


@given(SEEDS, SIZES, SIZES)
def test_two_unknowns_are_integrated(seed, one, two):
    design, left = data(seed, 2)
    wide = np.array([one, two])
    solution = solve(equations(design, left), wide)
    reach = 8.0 * np.sqrt(np.diag(solution.covariance))
    axes = [np.linspace(m - r, m + r, 121) for m, r in zip(solution.mean, reach, strict=True)]
    x, y = np.meshgrid(*axes, indexing="ij")
    at = np.stack([x.ravel(), y.ravel()])
    misfit = left[:, None] - design @ at
    logs = -0.5 * np.sum(misfit**2, 0) - 0.5 * np.sum((at / wide[:, None]) ** 2, 0)
    density = np.exp(logs - solution.evidence) / (2.0 * np.pi * one * two)
    cell = (axes[0][1] - axes[0][0]) * (axes[1][1] - axes[1][0])
    assert density.sum() * cell == pytest.approx(1.0, rel=1e-4)
    mixed = (density * (at[0] - solution.mean[0]) * (at[1] - solution.mean[1])).sum() * cell
    assert mixed == pytest.approx(solution.covariance[0, 1], abs=1e-4)


@given(SEEDS)
def test_equations_moved_to_another_point_say_the_same(seed):
    """About d the prior's centre is at -d and the residuals are what is left there."""
    design, left = data(seed, 2)
    wide, d = np.array([0.7, 1.9]), np.array([0.4, -0.8])
    here = solve(equations(design, left), wide)
    there = solve(equations(design, left - design @ d), wide, -d)
    assert there.mean + d == pytest.approx(here.mean)
    assert there.covariance == pytest.approx(here.covariance)
    assert there.evidence == pytest.approx(here.evidence)
