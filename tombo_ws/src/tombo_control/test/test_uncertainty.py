"""The covariance of the estimate: against a Lyapunov equation, and where nothing is known."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from tombo_control.estimator import attitude_gains, observer_gains
from tombo_control.params import EstimatorParams
from tombo_control.uncertainty import (
    Uncertainty,
    begin_uncertainty,
    fill_covariance,
    take_gyro,
    take_innovation,
)
from tombo_dynamics.message_records import OdometryRecord

STEP = 1.0 / 30.0
PARAMS = EstimatorParams()
PLACE = observer_gains(PARAMS.position_bandwidth, STEP)
TURN = attitude_gains(PARAMS.attitude_bandwidth, STEP)


def steady(gains: tuple[float, ...]) -> np.ndarray:
    """Covariance right after a pose of unit noise, from the equation that it solves."""
    n = len(gains)
    ahead = np.array(
        [[STEP ** (k - i) / math.factorial(k - i) if k >= i else 0.0 for k in range(n)]
         for i in range(n)]
    )  # fmt: skip
    gain, take = np.array(gains)[:, None], np.eye(n)[:1]
    closed = (np.eye(n) - gain @ take) @ ahead
    return solve_discrete_lyapunov(closed, gain @ gain.T)


@pytest.fixture
def memory():
    made = Uncertainty.new()
    begin_uncertainty(made, 2.0 * STEP)
    return made


def covariances(memory, age=0.0, airborne=True):
    out = OdometryRecord.new()
    fill_covariance(memory, age, airborne, out)
    return np.array([np.diag(np.reshape(out[n], (6, 6))) for n in out.dtype.names[-2:]])


def test_it_comes_to_the_solution_of_the_lyapunov_equation(memory):
    for _ in range(300):
        take_innovation(memory, PLACE, TURN, STEP, True, 4e-6, 9e-6)
    assert memory.place == pytest.approx(steady(PLACE), rel=1e-6)
    assert memory.turn == pytest.approx(steady(TURN), rel=1e-6)


def test_nothing_is_known_before_the_first_innovation_and_less_without_poses(memory):
    assert not covariances(memory).any()
    for _ in range(100):
        take_innovation(memory, PLACE, TURN, STEP, True, 4e-6, 9e-6)
    fresh, old = covariances(memory), covariances(memory, age=0.5)
    assert (fresh[:, :3] > 0.0).all()
    assert (old[:, :3] > 2.0 * fresh[:, :3]).all()
    assert not covariances(memory, 0.5, airborne=False)[1, :3].any()


def test_the_gyro_s_noise_is_found_under_a_turn_and_a_sample_that_is_none(memory):
    rng = np.random.default_rng(3)
    for k in range(6000):
        turn = np.array([3.0, -1.0, 2.0]) * math.sin(0.02 * k)
        take_gyro(memory, turn + 0.01 * rng.normal(size=3))
        if k == 3000:
            take_gyro(memory, np.array([math.nan, 0.0, 0.0]))
    assert math.sqrt(memory.gyro_noise) == pytest.approx(0.01, rel=0.05)
    take_innovation(memory, PLACE, TURN, STEP, True, 4e-6, 9e-6)
    assert (covariances(memory)[1, 3:] >= memory.gyro_noise).all()  # rates are those of the gyro
