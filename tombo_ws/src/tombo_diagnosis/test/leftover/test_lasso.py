"""The lasso against what can be derived by hand, and the choice of terms."""

import numpy as np
import pytest
from scipy.signal import lfilter

from tombo_diagnosis.leftover.sparse_fit import (
    Rows,
    lasso,
    lasso_path,
    sparse_fit,
    without_tolerances,
)


def test_with_orthogonal_columns_each_coefficient_is_shrunk_by_the_penalty():
    rng = np.random.default_rng(3)
    x = np.linalg.qr(rng.standard_normal((50, 6)))[0]
    y = x @ np.array([3.0, -2.0, 0.5, 0.0, 0.0, 1.0]) + 0.01 * rng.standard_normal(50)
    b = x.T @ y
    by_hand = np.sign(b) * np.maximum(np.abs(b) - 0.8, 0.0)
    assert lasso(x.T @ x, b, 0.8) == pytest.approx(by_hand, abs=1e-6)


def test_correlated_columns_meet_the_optimality_conditions():
    rng = np.random.default_rng(4)
    x = rng.standard_normal((80, 12)) @ rng.standard_normal((12, 12))
    y = x[:, 2] - 2.0 * x[:, 5] + rng.standard_normal(80)
    b, penalty = x.T @ y, 0.1 * np.abs(x.T @ y).max()
    c = lasso(x.T @ x, b, penalty)
    slope = b - x.T @ x @ c
    assert 0 < np.count_nonzero(c) < 12
    assert slope[c != 0] == pytest.approx(penalty * np.sign(c[c != 0]), rel=1e-3)
    assert np.abs(slope[c == 0]).max() <= penalty * (1.0 + 1e-3)


def test_the_path_begins_with_nothing_and_ends_before_there_are_too_many():
    rng = np.random.default_rng(5)
    x = rng.standard_normal((60, 20))
    y = x @ rng.standard_normal(20)
    supports = lasso_path(x.T @ x, x.T @ y, np.geomspace(1.0, 1e-3, 30), 6)
    assert supports[0] == () and len(supports) == 30
    assert 0 < len(supports[-1]) <= 6


def flights(hidden, seed, count=3):
    """Regressors as slow as a flight's place, noise as slow as gusts."""
    rng = np.random.default_rng(seed)
    result = []
    for _ in range(count):
        x = np.cumsum(rng.standard_normal((300, 40)), axis=0) / 10.0
        x -= x.mean(axis=0)
        gusts = lfilter([1.0], [1.0, -0.8], rng.standard_normal(300))
        result.append(Rows(x, x @ hidden + gusts, np.arange(300) // 10))
    return result


@pytest.mark.slow
def test_slow_noise_has_no_terms():
    alone = [()] * 40
    result = [sparse_fit(flights(np.zeros(40), seed), alone) for seed in range(20)]
    assert sum(bool(f.chosen) for f in result) <= 1


@pytest.mark.slow
def test_two_of_forty_terms_are_found_with_their_size_and_their_partner():
    hidden = np.zeros(40)
    hidden[[7, 31]] = 2.0, -3.0
    partners = [(12,) if k == 7 else () for k in range(40)]
    result = sparse_fit(flights(hidden, 1), partners)
    assert result.chosen == (7, 12, 31)
    off = np.abs(result.value - hidden[list(result.chosen)])
    assert (off < 3.0 * result.deviation).all()
    assert (np.abs(result.value) > 4.0 * result.deviation).tolist() == [True, False, True]
    assert 0.5 < result.r2 < 1.0


def test_what_a_tolerance_may_be_is_no_leftover():
    rng = np.random.default_rng(6)
    shape = rng.standard_normal((200, 1))
    y = 5.0 * shape[:, 0] + rng.standard_normal(200)
    _, left = without_tolerances(np.zeros((200, 1)), y, 10.0 * shape)
    assert float(np.var(y)) > 20.0 and float(np.var(left)) == pytest.approx(1.0, abs=0.2)
