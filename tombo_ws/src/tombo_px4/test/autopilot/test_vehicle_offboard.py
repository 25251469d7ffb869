"""Set points from outside: the vehicle's answer to each kind, and without them."""

import math

import numpy as np
import pytest
from vehicle_bench import GROUND, NAN, hovering, motion, ready

from tombo_dynamics.rotation import quaternion_multiply, yaw_pitch_roll
from tombo_px4.autopilot.commander import TakeoffState
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.modes import AUTO_HOLD, OFFBOARD, MavLandedState, Result


def tilted(pitch_deg: float = 0.0, roll_deg: float = 0.0) -> np.ndarray:
    """Quaternion of a pitch (nose down: positive, FLU) or a roll (to the right: positive)."""
    p, r = 0.5 * math.radians(pitch_deg), 0.5 * math.radians(roll_deg)
    return quaternion_multiply(
        np.array([0.0, math.sin(p), 0.0, math.cos(p)]),
        np.array([math.sin(r), 0.0, 0.0, math.cos(r)]),
    )


@pytest.mark.slow
def test_height_is_held_while_only_the_velocity_across_is_commanded():
    flight = hovering(vision=True)
    flight.fly(3.0, motion([NAN, NAN, 2.0], [0.8, 0.4, NAN], yaw=0.0))
    rows = flight.fly(1.0)
    np.testing.assert_allclose(rows[:, 3:5].mean(axis=0), [0.8, 0.4], atol=0.06)
    assert np.abs(rows[:, 2] - 2.0).max() < 0.1


@pytest.mark.parametrize(
    ("pitch", "roll", "axis", "sign"),
    [(5.0, 0.0, 0, 1.0), (-5.0, 0.0, 0, -1.0), (0.0, 5.0, 1, -1.0), (0.0, -5.0, 1, 1.0)],
)
def test_attitude_is_taken_and_accelerates_that_way(pitch, roll, axis, sign):
    flight = hovering(vision=True)
    hover = flight.vehicle.parameters.get("MPC_THR_HOVER")
    flight.fly(0.8, OffboardSetpoint(attitude=tilted(pitch, roll), thrust=hover))
    rows = flight.fly(0.4)
    _, p, r = np.rad2deg(yaw_pitch_roll(rows[:, 6:10])).T
    assert p.mean() == pytest.approx(pitch, abs=0.5) and r.mean() == pytest.approx(roll, abs=0.5)
    assert sign * rows[-1, 3 + axis] > 0.5
    assert abs(rows[-1, 5]) < 0.2  # the hover's thrust keeps the height, about


def test_limits_of_speed():
    flight = hovering(vision=True)
    table = flight.vehicle.parameters
    limits = {"MPC_XY_VEL_MAX": 0.5, "MPC_Z_VEL_MAX_UP": 0.6, "MPC_Z_VEL_MAX_DN": 0.5}
    assert [table.set(*limit) for limit in limits.items()] == 3 * [""]
    rows = flight.fly(5.0, motion([0.0, 8.0, 6.0], yaw=0.0))
    assert rows[-1, 4] == pytest.approx(0.5, abs=0.07)
    assert rows[-1, 5] == pytest.approx(0.6, abs=0.07)
    flight.target = motion([0.0, 8.0, 0.5], yaw=0.0)
    assert flight.fly(3.0)[-1, 5] == pytest.approx(-0.5, abs=0.07)


def test_a_take_off_by_set_points_begins_gently():
    flight = ready(vision=True)
    flight.vehicle.parameters.set("MPC_TKO_SPEED", 0.4)
    flight.arm_offboard(motion([0.0, 0.0, 9.0], yaw=0.0))
    rows = flight.fly(4.05)
    assert flight.vehicle.takeoff_state == TakeoffState.FLIGHT
    assert 0.2 < rows[:, 5].max() < 0.6
    assert flight.fly(2.0)[:, 5].max() > 1.5


# --- The stream ------------------------------------------------------------------------------


def test_the_takeoff_ramp_goes_on_without_setpoints():
    flight = ready(vision=True)
    flight.arm_offboard(motion([0.0, 0.0, 1.5]))
    assert flight.fly(1.2)[:, 2].max() < GROUND
    flight.fly(1.5, motion([*flight.body[:3]]))  # as a plan that begins again from the ground
    assert flight.vehicle.takeoff_state == TakeoffState.READY
    flight.fly(0.5)
    assert flight.vehicle.takeoff_state == TakeoffState.RAMPUP


@pytest.mark.slow
def test_set_points_are_followed_only_while_the_mode_is_flown():
    flight = hovering()
    flight.vehicle.set_mode(AUTO_HOLD)
    flight.fly(3.0, motion([3.0, 0.0, 2.0]))
    assert abs(flight.body[0]) < 0.2
    flight.vehicle.reposition(np.array([-1.0, 0.0, NAN]))
    flight.fly(4.0)
    flight.vehicle.target(flight.target)
    flight.target = None
    flight.vehicle.set_mode(OFFBOARD)  # earlier set points are not used
    flight.fly(0.8)
    assert flight.vehicle.mode == OFFBOARD and abs(flight.body[0] + 1.0) < 0.2
    flight.fly(4.0, motion([1.0, 0.0, 2.0]))
    assert flight.body[0] > 0.8


@pytest.mark.slow
def test_two_seconds_after_arming_for_a_take_off_it_is_not_disarmed():
    flight = ready(vision=True)
    flight.fly(1.0, motion([0.0, 0.0, 2.0]))
    assert flight.vehicle.set_mode(OFFBOARD) == Result.ACCEPTED
    assert flight.vehicle.arm() == Result.ACCEPTED
    flight.fly(1.0)
    assert flight.vehicle.landed == MavLandedState.ON_GROUND
    flight.fly(1.0)
    assert flight.vehicle.disarm() == Result.TEMPORARILY_REJECTED
    assert "Takeoff detected" in flight.texts and flight.height < 0.01
