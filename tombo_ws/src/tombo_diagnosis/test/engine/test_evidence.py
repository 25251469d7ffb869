"""Evidence in closed form, against its integral."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import integrate

from tombo_diagnosis.engine.regression import NormalEquations, solve

SEEDS = st.integers(0, 2**32 - 1)
SIZES = st.floats(0.05, 3.0)


def equations(design, left):
    return NormalEquations(design.T @ design, design.T @ left, float(left @ left))


def data(seed, unknowns, rows=12):
    rng = np.random.default_rng(seed)
    return rng.standard_normal((rows, unknowns)), rng.standard_normal(rows)


@pytest.mark.slow
@given(SEEDS, SIZES, st.floats(-1.0, 1.0))
def test_one_unknown_is_integrated(seed, deviation, middle):
    design, left = data(seed, 1)
    solution = solve(equations(design, left), np.array([deviation]), np.array([middle]))

    def density(x):
        misfit, prior = left - design[:, 0] * x, ((x - middle) / deviation) ** 2
        log = -0.5 * (misfit @ misfit + prior) - np.log(deviation * np.sqrt(2 * np.pi))
        return np.exp(log - solution.evidence)

    m, s = solution.mean[0], np.sqrt(solution.covariance[0, 0])
    total, _ = integrate.quad(density, m - 12 * s, m + 12 * s)
    first, _ = integrate.quad(lambda x: x * density(x), m - 12 * s, m + 12 * s)
    second, _ = integrate.quad(lambda x: (x - m) ** 2 * density(x), m - 12 * s, m + 12 * s)
    assert total == pytest.approx(1.0, rel=1e-6)
    assert first == pytest.approx(m, abs=1e-6)
    assert second == pytest.approx(s * s, rel=1e-5)


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


@given(SEEDS, SIZES)
def test_freedom_that_explains_nothing_costs(seed, wide):
    """Its best fit is zero, so that all that it brings is choice."""
    design, left = data(seed, 1)
    across = design - np.outer(left, left @ design) / (left @ left)
    with_it = solve(equations(across, left), np.array([wide])).evidence
    narrow = solve(equations(across, left), np.array([0.01 * wide])).evidence
    assert with_it < narrow <= -0.5 * (left @ left)


def test_freedom_that_is_needed_pays():
    design, _ = data(5, 1, rows=200)
    left = design[:, 0] * 2.0 + 0.1
    wide = solve(equations(design, left), np.array([2.0])).evidence
    assert wide > solve(equations(design, left), np.array([0.01])).evidence + 50.0


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


@given(SEEDS)
def test_flights_add_up(seed):
    design, left = data(seed, 2, rows=20)
    halves = equations(design[:10], left[:10]) + equations(design[10:], left[10:])
    wide = np.array([1.0, 2.0])
    whole = solve(equations(design, left), wide)
    assert solve(halves, wide).evidence == pytest.approx(whole.evidence)
    assert solve(halves, wide, covariance=False).mean == pytest.approx(whole.mean)
