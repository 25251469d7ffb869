"""Allocation: from collective thrust and torques to rotor thrusts within their limits."""

import math

import numpy as np
import pytest
from control_bench import VEHICLE, fresh_autopilot
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from tombo_control.loops.inner_loops import allocate, inertia_torque
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN

LOW, HIGH, RATIO = 0.2, 7.0, 0.04
MAPS = RotorMaps.new()
MAPS.thrust_lowest, MAPS.thrust_highest, MAPS.torque_ratio = LOW, HIGH, RATIO
EFFECT = np.array(
    [np.ones(4), VEHICLE.arm_length * ARM_Y, -VEHICLE.arm_length * ARM_X, -RATIO * SPIN]
)
"""Rows: collective thrust, roll, pitch and yaw torque that each newton of each rotor makes."""

anything = st.floats(-20.0, 20.0)
not_numbers = st.sampled_from([math.nan, math.inf, -math.inf])


def rotor_thrusts(thrust, roll, pitch, yaw):
    a = fresh_autopilot()
    a.setpoint.thrust = thrust
    a.setpoint.torque[:] = roll, pitch, yaw
    allocate(a.setpoint, a.loops, a.nominal, MAPS)
    return a.setpoint.rotor_thrust.copy(), a.loops.saturated.copy()


@given(st.lists(st.floats(LOW + 1e-6, HIGH - 1e-6), min_size=4, max_size=4))
def test_exact_where_no_limit_is_met(given_thrusts):
    """Thrusts within the limits, with and without their share of yaw, come back from the wrench
    that they make."""
    wrench = EFFECT @ given_thrusts
    yaw_share = -SPIN * wrench[3] / (4.0 * RATIO)
    assume((given_thrusts - yaw_share).min() >= LOW)
    assume((given_thrusts - yaw_share).max() <= HIGH)
    thrusts, saturated = rotor_thrusts(*wrench)
    assert np.allclose(thrusts, given_thrusts, atol=1e-9)
    assert (saturated == 0.0).all()


@pytest.mark.slow
@settings(max_examples=300)
@given(anything, st.floats(-3.0, 3.0), st.floats(-3.0, 3.0), st.floats(-0.5, 0.5))
def test_roll_and_pitch_go_before_collective_and_collective_before_yaw(thrust, roll, pitch, yaw):
    thrusts, saturated = rotor_thrusts(4.0 * thrust, roll, pitch, yaw)
    got_thrust, got_roll, got_pitch, got_yaw = EFFECT @ thrusts
    tilting = np.linalg.lstsq(EFFECT, np.array([0.0, roll, pitch, 0.0]), rcond=None)[0]
    share = min(1.0, (HIGH - LOW) / max(np.ptp(tilting), 1e-9))
    # roll and pitch: both in full, or both less by the same factor
    assert np.allclose([got_roll, got_pitch], [share * roll, share * pitch], atol=1e-9)
    assert (saturated[:2] != 0.0).any() == (share < 1.0)
    # collective: the nearest that leaves roll and pitch alone
    lowest = LOW - share * tilting.min()
    highest = HIGH - share * tilting.max()
    assert math.isclose(got_thrust / 4.0, min(max(thrust, lowest), highest), abs_tol=1e-9)
    # yaw: at most what is asked, in its direction, and all that fits when it is cut
    assert abs(got_yaw) <= abs(yaw) + 1e-9
    assert got_yaw * yaw >= -1e-12
    cut = abs(got_yaw) < abs(yaw) - 1e-9
    assert (saturated[2] != 0.0) == cut or abs(abs(got_yaw) - abs(yaw)) < 1e-8
    if cut:
        assert min(abs(thrusts - LOW).min(), abs(thrusts - HIGH).min()) < 1e-9
        assert saturated[2] == math.copysign(1.0, yaw)


@given(st.tuples(*[st.one_of(anything, not_numbers)] * 4))
def test_a_demand_that_is_no_number_gives_no_thrust_outside_the_limits(demand):
    thrusts, _ = rotor_thrusts(*demand)
    assert (thrusts >= LOW).all()
    assert (thrusts <= HIGH).all()


@given(st.tuples(anything, anything, anything), st.tuples(anything, anything, anything))
def test_torque_gives_the_acceleration_asked_for(acceleration, rates):
    """Euler's equation of the airframe, solved for the acceleration, gives back what was asked."""
    a = fresh_autopilot()
    a.state.rates[:] = rates
    a.setpoint.angular_acceleration[:] = acceleration
    inertia_torque(a.state, a.setpoint, a.nominal)
    inertia = np.array([VEHICLE.inertia_xx, VEHICLE.inertia_yy, VEHICLE.inertia_zz])
    w = np.array(rates)
    torque = a.setpoint.torque
    assert np.allclose((torque - np.cross(w, inertia * w)) / inertia, acceleration, atol=1e-8)
