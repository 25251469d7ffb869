"""Attitude control: from anywhere, by the shortest way, whatever the quaternion's sign."""

import math

import numpy as np
import pytest
from control_bench import UPRIGHT, body_z, fresh_autopilot, quaternion
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_control.loops.inner_loops import attitude_control
from tombo_control.params import ControlParams
from tombo_dynamics.rotation import quaternion_multiply, relative_rotation, rotate_by_vector

STEP = 4e-3
LIMITS = ControlParams()
component = st.floats(-1.0, 1.0)
attitudes = (
    st.tuples(component, component, component, component)
    .map(np.array)
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)


def rates_for(setpoint, attitude):
    a = fresh_autopilot()
    a.setpoint.attitude[:] = setpoint
    a.state.attitude[:] = attitude
    attitude_control(a.state, a.setpoint, a.gains)
    return a.setpoint.rates.copy()


def tilt_between(p, q):
    return math.acos(min(max(float(body_z(p) @ body_z(q)), -1.0), 1.0))


def rotate(q, rates):
    out = q.copy()
    rotate_by_vector(out, rates * STEP)
    return out


def angle_between(p, q):
    x, y, z, w = relative_rotation(p, q)
    return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), w)


@pytest.mark.slow
@settings(max_examples=60)
@given(attitudes, attitudes)
def test_converges_while_the_sign_of_the_quaternion_flips(setpoint, start):
    """PX4's test: tilt error falls in every step, and all error is gone in the end."""
    q = start.copy()
    error = tilt_between(setpoint, q)
    for k in range(1600):
        sign = -1.0 if k % 2 else 1.0
        q = rotate(q, rates_for(sign * setpoint, (-sign if k % 3 else sign) * q))
        now = tilt_between(setpoint, q)
        assert now <= error + 1e-7
        assert now < error or error < 1e-3
        error = now
    assert angle_between(setpoint, q) < 2e-3


@pytest.mark.slow
@given(st.floats(-math.pi + 0.01, math.pi - 0.01), st.floats(0.05, 3.0), st.floats(-3.1, 3.1))
def test_a_yaw_error_never_bends_the_way_to_level(yaw, tilt, direction):
    """Body z stays on the great circle through where it is and where it shall be."""
    start = quaternion_multiply(
        quaternion((math.cos(direction), math.sin(direction), 0.0), tilt),
        quaternion((0, 0, 1), yaw),
    )
    across = np.cross(body_z(start), body_z(UPRIGHT))
    across /= np.linalg.norm(across)
    q = start
    for _ in range(250):
        q = rotate(q, rates_for(UPRIGHT, q))
        # rates are held for a step, in which the body turns on by its yaw rate
        assert abs(float(body_z(q) @ across)) < 0.5 * STEP * LIMITS.yaw_rate_max * tilt
    assert tilt_between(UPRIGHT, q) < tilt


@given(attitudes, attitudes)
def test_rates_stay_within_their_limits(setpoint, attitude):
    rates = rates_for(setpoint, attitude)
    assert np.hypot(rates[0], rates[1]) <= LIMITS.rate_max * (1.0 + 1e-9)
    assert abs(rates[2]) <= LIMITS.yaw_rate_max


@given(st.floats(1e-6, 0.3), st.floats(-3.1, 3.1))
def test_rate_is_the_gain_times_the_angle(angle, direction):
    axis = np.array([math.cos(direction), math.sin(direction), 0.0])
    rates = rates_for(quaternion(axis, angle), UPRIGHT)
    assert np.allclose(rates, LIMITS.attitude_p * angle * axis, rtol=1e-6, atol=1e-12)
    about_z = rates_for(quaternion((0, 0, 1), angle), UPRIGHT)
    assert np.allclose(about_z, [0.0, 0.0, LIMITS.yaw_p * angle], rtol=1e-6, atol=1e-12)
