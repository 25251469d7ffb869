"""Probability and interval against closed forms, and draws that depend on the seed alone."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import multivariate_normal, norm

from tombo_flight.campaign.statistics import exact_interval
from tombo_flight.risk.estimate import Kernels, RiskEstimate, agree, estimate, weighted_interval
from tombo_flight.risk.result import influence

FLIGHTS = 4000
Limit = Callable[[np.ndarray, np.ndarray], np.ndarray]


def linear(p: float, dimension: int) -> Limit:
    return lambda u, _: norm.isf(p) - u.sum(axis=1) / np.sqrt(dimension)


def two_modes(p: float) -> Limit:
    return lambda u, _: norm.isf(0.5 * p) - np.abs(u[:, 0])


def noisy(p: float, width: float) -> Limit:
    """Random for fixed inputs: as flights are, by their seed."""

    def limit(u: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        own = [np.random.default_rng(int(seed)).standard_normal() for seed in seeds]
        return norm.isf(p) * np.hypot(1.0, width) - u[:, 0] - width * np.array(own)

    return limit


def answers(limit: Limit, dimension: int, repeats: int, method: str = "adaptive"):
    return [
        estimate(dimension, FLIGHTS, method, seed, lambda _, u, seeds: limit(u, seeds))[0]
        for seed in range(repeats)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("limit", "dimension", "p", "error"),
    [
        pytest.param(linear(1e-3, 2), 2, 1e-3, 0.1, id="linear, 1e-3"),
        pytest.param(linear(1e-5, 4), 4, 1e-5, 0.1, id="linear, 1e-5"),
        pytest.param(linear(1e-4, 10), 10, 1e-4, 0.2, id="linear, ten inputs"),
        pytest.param(two_modes(1e-4), 2, 1e-4, 0.2, id="two ways to crash"),
        pytest.param(noisy(1e-3, 0.5), 2, 1e-3, 0.3, id="noisy"),
        pytest.param(noisy(1e-3, 1.0), 2, 1e-3, 0.8, id="as much noise as inputs"),
    ],
)
def test_intervals_cover_the_probability(limit: Limit, dimension: int, p: float, error: float):
    found = answers(limit, dimension, 12)
    assert all(one.method == "adaptive" and one.probability is not None for one in found)
    # of 12 intervals of 95 %, 4 or more miss with a chance of 0.2 %
    assert sum(not one.low <= p <= one.high for one in found) <= 3
    values = np.array([one.probability for one in found])
    assert abs(values.mean() / p - 1.0) < error
    assert values.std() / p < error


@pytest.mark.slow
def test_frequent_crashes_are_counted():
    found = answers(linear(0.2, 2), 2, 10)
    assert {one.method for one in found} == {"monte-carlo"}
    assert sum(one.low <= 0.2 <= one.high for one in found) >= 8


def test_monte_carlo_has_the_exact_interval_of_a_count():
    (found,) = answers(linear(0.01, 2), 2, 1, "monte-carlo")
    crashed = round(found.probability * FLIGHTS)
    assert (found.low, found.high) == exact_interval(crashed, FLIGHTS)
    assert found.low < 0.01 < found.high


@pytest.mark.slow
def test_no_crash_gives_a_bound_and_no_zero():
    (plain,) = answers(lambda u, _: np.ones(len(u)), 2, 1, "monte-carlo")
    assert plain.probability is None and plain.low == 0.0
    assert plain.high == pytest.approx(exact_interval(0, FLIGHTS)[1], rel=1e-9)
    (searched,) = answers(lambda u, _: 2.0 + np.tanh(u[:, 0]), 2, 1)
    assert searched.probability is None
    assert plain.high < searched.high < 4.0 * plain.high  # a part is drawn as given


@pytest.mark.slow
def test_a_crash_that_the_search_has_missed_widens_the_interval():
    """Most crashes are on the side that the margin does not lead to."""
    hidden = norm.isf(0.004)

    def limit(u: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        near = norm.isf(1e-4) - u[:, 0]
        return np.where(u[:, 0] < -hidden, -1.0, near)

    found = answers(limit, 1, 10)
    assert sum(one.low <= 0.0041 <= one.high for one in found) >= 8


def test_equal_weights_give_the_interval_of_a_poisson_count():
    low, high = weighted_interval(np.full(10, 0.001))
    assert (low, high) == pytest.approx((0.004795, 0.018390), rel=1e-3)  # Garwood, of 10


def counted(crashes: int, flights: int) -> RiskEstimate:
    share = crashes / flights
    return RiskEstimate(share or None, *exact_interval(crashes, flights), "monte-carlo", share)


def test_estimates_agree_where_they_are_of_one_probability():
    rng = np.random.default_rng(0)

    def share(p: float, q: float) -> float:
        pairs = zip(rng.binomial(3000, p, 400), rng.binomial(9000, q, 400), strict=True)
        answers = [agree(counted(a, 3000), counted(b, 9000)) for a, b in pairs]
        return sum(answers) / len(answers)

    for p in (1e-4, 1e-3, 1e-2):  # 1e-4: none crashes in most of the shorter ones
        assert share(p, p) > 0.93
    assert share(1e-2, 2e-2) < 0.1 and share(1e-2, 2.5e-3) < 0.1
    assert agree(counted(0, 3000), counted(1, 9000)) and agree(counted(1, 9000), counted(0, 3000))
    assert not agree(counted(0, 9000), counted(30, 3000))
    assert not agree(counted(30, 3000), counted(0, 9000))


def test_the_density_of_many_points_is_that_of_the_mixture():
    root = np.array([[1.0, 0.0], [0.5, 0.8]])
    centres = np.array([[0.0, 0.0], [1.0, -2.0]])
    points = np.random.default_rng(0).standard_normal((10_001, 2))
    found = Kernels(centres, np.array([0.3, 0.7]), root).density(points)
    one, other = (multivariate_normal(centre, root @ root.T).pdf(points) for centre in centres)
    assert found == pytest.approx(0.3 * one + 0.7 * other)


def test_the_same_flights_follow_from_the_seed_alone():
    limit = linear(1e-3, 2)
    flown: list[int] = []

    def fly(first: int, u: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        flown.append(first)
        return limit(u, seeds)

    once, again = (estimate(2, 500, "adaptive", 3, fly) for _ in range(2))
    assert once[0] == again[0]
    assert np.array_equal(once[1].points, again[1].points)
    assert len(set(once[1].seeds)) == 500
    assert flown[: len(flown) // 2] == flown[len(flown) // 2 :]
    other = estimate(2, 500, "adaptive", 4, fly)
    assert other[0] != once[0]


@pytest.mark.slow
def test_sobol_indices_of_a_linear_margin_are_the_shares_of_variance():
    def fly(_: int, u: np.ndarray, seeds: np.ndarray) -> np.ndarray:
        own = [np.random.default_rng(int(seed)).standard_normal() for seed in seeds]
        return 10.0 + u @ (2.0, 1.0, 0.0) + np.array(own)

    sample = estimate(3, 4000, "monte-carlo", 0, fly)[1]
    found = influence(("a", "b", "c"), sample)
    assert [row["key"] for row in found["indices"]] == ["a", "b", "c"]
    assert [row["first"] for row in found["indices"]] == pytest.approx((0.8, 0.2, 0.0), abs=0.03)
    assert [row["total"] for row in found["indices"]] == pytest.approx((0.8, 0.2, 0.0), abs=0.03)
    assert found["r2"] == pytest.approx(5.0 / 6.0, abs=0.02)  # the rest is the flights' own noise
