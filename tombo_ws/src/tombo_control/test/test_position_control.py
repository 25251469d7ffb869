"""The 50 Hz loop: limits, anti-windup, derivative, feed-forward, and set points of attitude."""

import math
from dataclasses import replace

import numpy as np
import pytest
from control_bench import VEHICLE, body_z, fresh_autopilot, quaternion
from hypothesis import given
from hypothesis import strategies as st

from tombo_control.loops.position_control import attitude_from_thrust, position_control
from tombo_control.params import ControlParams
from tombo_dynamics.rotation import tilt, yaw_pitch_roll
from tombo_dynamics.vehicle import GRAVITY

MASS = VEHICLE.mass
HIGHEST = 27.0
C = ControlParams()
PERIOD = 0.02
vector = st.tuples(*[st.floats(-20.0, 20.0)] * 3).map(np.array)
directions = vector.filter(lambda v: np.linalg.norm(v) > 0.1)


def run(a, times=1):
    """Run the loop with the velocity feed-forward that the memory holds at the start."""
    ahead = a.setpoint.velocity.copy()
    for _ in range(times):
        a.setpoint.velocity[:] = ahead
        position_control(a.state, a.setpoint, a.loops, a.gains, MASS, HIGHEST, False)


@pytest.mark.slow
@given(vector, vector, vector, vector, directions, st.floats(-3.1, 3.1), st.floats(0.0, 3.1))
def test_set_points_stay_within_their_limits(goal, ahead, velocity, integral, axis, yaw, turn):
    a = fresh_autopilot(attitude=quaternion(axis, turn))
    a.setpoint.position[:] = goal
    a.setpoint.velocity[:] = ahead
    a.state.velocity[:] = velocity
    a.loops.velocity_integral[:] = np.clip(integral, -C.velocity_i_max, C.velocity_i_max)
    a.setpoint.yaw = yaw
    run(a)
    asked_velocity = a.setpoint.velocity
    assert math.hypot(asked_velocity[0], asked_velocity[1]) <= C.velocity_max_xy * (1 + 1e-9)
    assert abs(asked_velocity[2]) <= C.velocity_max_z
    q = a.setpoint.attitude
    assert np.linalg.norm(q) == pytest.approx(1.0)
    assert tilt(q) <= C.tilt_max + 1e-6
    assert C.thrust_min * HIGHEST <= a.setpoint.thrust <= HIGHEST
    assert np.abs(a.loops.velocity_integral).max() <= C.velocity_i_max


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_force_is_mass_times_gain_times_error(ex, ey, ez):
    """With the attitude reached, the thrust vector is m (g + velocity_p position_p error)."""
    a = fresh_autopilot(replace(C, velocity_i=0.0))
    error = np.array([ex, ey, ez])
    a.setpoint.position[:] = a.state.position + error
    run(a)
    a.state.attitude[:] = a.setpoint.attitude
    a.setpoint.velocity[:] = 0.0
    run(a)
    force = a.setpoint.thrust * body_z(a.setpoint.attitude)
    expected = MASS * (C.velocity_p * C.position_p * error + [0.0, 0.0, GRAVITY])
    assert np.allclose(force, expected, atol=1e-9)


def test_flies_on_the_feed_forward_without_an_error():
    """On its way along the reference, with its speed, it asks for the reference's acceleration."""
    a = fresh_autopilot()
    speed, acceleration = np.array([0.6, -0.3, 0.2]), np.array([0.8, 0.4, -0.3])
    a.setpoint.acceleration[:] = acceleration
    for k in range(5):
        a.setpoint.velocity[:] = speed + k * PERIOD * acceleration
        a.state.velocity[:] = speed + k * PERIOD * acceleration
        position_control(a.state, a.setpoint, a.loops, a.gains, MASS, HIGHEST, False)
    z = body_z(a.setpoint.attitude)
    force = acceleration + np.array([0.0, 0.0, GRAVITY])
    assert np.allclose(z, force / np.linalg.norm(force), atol=1e-6)


def test_derivative_brakes_a_measured_acceleration():
    a = fresh_autopilot(replace(C, velocity_p=0.0, velocity_i=0.0, velocity_d=0.5))
    for k in range(4):
        a.state.velocity[0] = 0.02 * k  # 1 m/s^2
        run(a)
    z = body_z(a.setpoint.attitude)
    assert z[0] / z[2] == pytest.approx(-0.5 / GRAVITY, rel=1e-9)


def test_integral_cancels_a_constant_disturbance_up_to_its_limit():
    a = fresh_autopilot()
    a.state.velocity[:] = -0.3, 0.0, -0.1
    run(a, 50)
    assert a.loops.velocity_integral[0] == pytest.approx(C.velocity_i * 0.3 * 1.0, rel=1e-6)
    assert a.loops.velocity_integral[2] == pytest.approx(C.velocity_i * 0.1 * 1.0, rel=1e-6)
    run(a, 5000)
    assert a.loops.velocity_integral[0] == C.velocity_i_max


@pytest.mark.parametrize(("axis", "error"), [(0, 30.0), (1, -30.0), (2, 30.0), (2, -30.0)])
def test_integral_does_not_wind_up_while_a_limit_holds(axis, error):
    a = fresh_autopilot(replace(C, velocity_max_xy=15.0, velocity_max_z=8.0))
    a.setpoint.position[axis] += error
    run(a, 500)
    assert a.loops.velocity_integral[axis] == 0.0


@given(directions.filter(lambda v: v[2] / np.linalg.norm(v) > -0.9), st.floats(-3.1, 3.1))
def test_attitude_points_body_z_along_the_force_by_the_shortest_turn(force, yaw):
    q = np.zeros(4)
    attitude_from_thrust(*force, yaw, q)
    assert np.allclose(body_z(q), force / np.linalg.norm(force), atol=1e-9)
    level = np.zeros(4)
    attitude_from_thrust(0.0, 0.0, 1.0, yaw, level)
    assert np.allclose(yaw_pitch_roll(level), [yaw, 0.0, 0.0], atol=1e-9)
    # tilting does not turn: from level to tilted, the turn has no component about map z
    x0, y0, z0, w0 = level
    x, y, z, w = q
    about_map_z = w * (-z0) + z * w0 + x * (-y0) - y * (-x0)
    assert abs(about_map_z) < 1e-9
