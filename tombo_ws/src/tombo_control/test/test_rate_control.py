"""Rate control: derivative on the measurement, filter, integral and its limits."""

import math
from dataclasses import replace

import numpy as np
import pytest
from control_bench import fresh_autopilot
from hypothesis import given
from hypothesis import strategies as st

from tombo_control.loops.inner_loops import rate_control
from tombo_control.params import ControlParams

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
