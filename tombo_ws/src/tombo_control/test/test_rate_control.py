"""Rate control: derivative on the measurement, filter, integral and its limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from control_bench import bench, fresh_autopilot, quaternion, rotor_table
from hypothesis import given
from hypothesis import strategies as st

from tombo_control.loops.cascade import cascade
from tombo_control.loops.inner_loops import rate_control
from tombo_control.params import ControlParams
from tombo_dynamics.rotation import tilt

TICK = 1e-3
C = ControlParams()


def commanded(a, setpoint, rates, saturated=(0.0, 0.0, 0.0)):
    a.setpoint.rates[:] = setpoint
    a.state.rates[:] = rates
    a.loops.saturated[:] = saturated
    rate_control(a.state, a.setpoint, a.loops, a.gains)
    return a.setpoint.angular_acceleration.copy()


def test_a_jump_of_the_set_point_gives_no_derivative_kick():
    a = fresh_autopilot()
    for _ in range(500):
        before = commanded(a, np.zeros(3), np.zeros(3))
    jump = commanded(a, np.array([2.0, -1.0, 0.5]), np.zeros(3)) - before
    step = np.array([2.0, -1.0, 0.5])
    p = np.array([C.rate_p, C.rate_p, C.yaw_rate_p])
    i = np.array([C.rate_i, C.rate_i, C.yaw_rate_i])
    assert np.allclose(jump, (p + i * TICK) * step)


def test_derivative_is_that_of_the_filtered_rate():
    """On a ramp it ends at rate_d times the slope; half-way there in the filter's time."""
    a = fresh_autopilot(replace(C, rate_p=0.0, rate_i=0.0))
    slope = 3.0
    out = [commanded(a, np.zeros(3), [slope * k * TICK, 0.0, 0.0])[0] for k in range(200)]
    assert out[-1] == pytest.approx(-C.rate_d * slope, rel=1e-6)
    half = next(k for k, v in enumerate(out) if v < -0.5 * C.rate_d * slope)
    assert half * TICK == pytest.approx(math.log(2.0) / C.rate_cutoff, abs=1.5 * TICK)


@pytest.mark.slow
@given(st.sampled_from([-1.0, 1.0]), st.integers(0, 2), st.floats(0.1, 5.0))
def test_the_integral_stops_only_in_the_direction_that_is_used_up(direction, axis, error):
    a = fresh_autopilot()
    full = np.zeros(3)
    full[axis] = direction
    towards = np.zeros(3)
    towards[axis] = direction * error
    commanded(a, towards, np.zeros(3), full)
    assert a.loops.rate_integral[axis] == 0.0
    commanded(a, -towards, np.zeros(3), full)
    assert a.loops.rate_integral[axis] * direction < 0.0


@pytest.mark.slow
@given(st.floats(-100.0, 100.0))
def test_the_integral_is_bounded(error):
    a = fresh_autopilot()
    for _ in range(3000):
        commanded(a, [error, 0.0, error], np.zeros(3))
    assert np.abs(a.loops.rate_integral).max() <= C.rate_i_max


def overshoot(control, held_s):
    """Hold the vehicle down level while 0.4 rad is asked for, let go: how far does it go over?"""
    b = bench(replace(control, position_p=0.0, velocity_p=0.0, velocity_i=0.0, velocity_d=0.0))
    goal = quaternion((1, 0, 0), 0.4)

    def towards_goal(a, tick):
        cascade(a, maps, tick)
        a.setpoint.attitude[:] = goal

    maps = rotor_table()
    b.a.setpoint.attitude[:] = goal
    ticks = round(held_s * 1000)
    for tick in range(ticks):  # in a vice: the state does not move
        towards_goal(b.a, tick)
    b.tick = ticks
    flown = b.fly_ticks(2.0, towards_goal)
    return tilt(flown[:, 6:10]).max() - 0.4


@pytest.mark.slow
def test_long_saturation_does_not_blow_the_overshoot_up():
    fresh = overshoot(C, 0.0)
    held = overshoot(C, 5.0)
    unlimited = overshoot(replace(C, rate_i_max=1e6), 5.0)
    assert fresh < 0.05
    assert held < 0.25
    assert unlimited > held + 0.3
