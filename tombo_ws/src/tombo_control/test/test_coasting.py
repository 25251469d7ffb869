"""Between estimates the controller's own gyro carries the attitude; a late estimate fits in."""

from __future__ import annotations

import numpy as np
import pytest
from control_bench import fresh_autopilot, quaternion
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tombo_control.autopilot import Autopilot
from tombo_control.estimator import correct_with_estimate, propagate
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import quaternion_multiply

_BEFORE = 40
_rates = arrays(float, 3, elements=st.floats(-8.0, 8.0))
_velocity = arrays(float, 3, elements=st.floats(-3.0, 3.0))
_small = arrays(float, 3, elements=st.floats(-0.1, 0.1))
_late = st.integers(0, 10)


def _angle(q: Array, p: Array) -> float:
    return 2.0 * float(np.arccos(min(abs(float(q @ p)), 1.0)))


def _turn(vector: Array) -> Array:
    length = float(np.linalg.norm(vector))
    return quaternion(vector, length) if length > 0.0 else np.array([0.0, 0.0, 0.0, 1.0])


class _Truth:
    """A vehicle that turns and moves evenly."""

    def __init__(self, rates: Array, velocity: Array) -> None:
        self.rates, self.velocity = rates, velocity
        self.begin = quaternion([1.0, -2.0, 3.0], 0.7)

    def attitude(self, tick: int) -> Array:
        return quaternion_multiply(self.begin, _turn(self.rates * tick * 1e-3))

    def position(self, tick: int) -> Array:
        return np.array([1.0, 2.0, 3.0]) + self.velocity * tick * 1e-3

    def correct(self, a: Autopilot, captured: int, now: int, sign: float = 1.0) -> None:
        """Hand the truth at tick `captured` to an autopilot at tick `now`."""
        position, attitude = self.position(captured), sign * self.attitude(captured)
        correct_with_estimate(a.state, a.history, position, self.velocity, attitude, captured, now)


def _coasting(truth: _Truth, error: Array, ticks: int = _BEFORE) -> Autopilot:
    """An autopilot at tick `ticks`, off by a rotation `error` and with position unknown."""
    a = fresh_autopilot(attitude=quaternion_multiply(truth.attitude(0), _turn(error)))
    a.state.rates[:] = truth.rates
    propagate(a.state, a.history, ticks, ticks)
    return a


@pytest.mark.slow
@given(_rates, _velocity, st.integers(1, 60))
def test_coasting_turns_with_the_gyro_and_moves_with_the_velocity(
    rates: Array, velocity: Array, ticks: int
) -> None:
    truth = _Truth(rates, velocity)
    a = fresh_autopilot(position=truth.position(0), attitude=truth.attitude(0))
    a.state.rates[:], a.state.velocity[:] = rates, velocity
    propagate(a.state, a.history, ticks, ticks)
    assert _angle(a.state.attitude, truth.attitude(ticks)) < 1e-7
    assert np.allclose(a.state.position, truth.position(ticks), atol=1e-12)


@pytest.mark.slow
@given(_rates, _velocity, _late)
def test_a_late_estimate_equals_integrating_from_it(
    rates: Array, velocity: Array, late: int
) -> None:
    truth = _Truth(rates, velocity)
    a = _coasting(truth, np.zeros(3))
    truth.correct(a, _BEFORE - late, _BEFORE)
    assert _angle(a.state.attitude, truth.attitude(_BEFORE)) < 1e-7
    assert np.allclose(a.state.position, truth.position(_BEFORE), atol=1e-12)
    assert np.array_equal(a.state.velocity, velocity)


@given(_rates, _small, _late, st.integers(1, 8))
def test_estimates_in_a_row_do_not_correct_twice(
    rates: Array, error: Array, late: int, period: int
) -> None:
    truth = _Truth(rates, np.zeros(3))
    a = _coasting(truth, error)
    tick = _BEFORE
    size = float(np.linalg.norm(error))
    for _ in range(6):
        truth.correct(a, tick - late, tick)
        turned = float(np.linalg.norm(rates)) * late * 1e-3
        assert _angle(a.state.attitude, truth.attitude(tick)) < 1.1 * size * turned + 1e-7
        tick += period
        propagate(a.state, a.history, tick, period)


@given(_rates, _velocity, st.integers(1, 5))
def test_an_estimate_ahead_of_the_gyro_is_carried_back(
    rates: Array, velocity: Array, ahead: int
) -> None:
    truth = _Truth(rates, velocity)
    a = _coasting(truth, np.array([0.05, 0.0, 0.0]))
    truth.correct(a, _BEFORE + ahead, _BEFORE)
    assert _angle(a.state.attitude, truth.attitude(_BEFORE)) < 1e-7
    assert np.allclose(a.state.position, truth.position(_BEFORE), atol=1e-12)
    propagate(a.state, a.history, _BEFORE + ahead, ahead)
    assert _angle(a.state.attitude, truth.attitude(_BEFORE + ahead)) < 1e-7
