"""Set points from outside: the vehicle's answer to each kind, and without them."""

import math

import numpy as np
import pytest
from vehicle_bench import NAN, hovering, motion

from tombo_dynamics.rotation import quaternion_multiply, yaw_pitch_roll
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.modes import AUTO_HOLD, OFFBOARD


def tilted(pitch_deg: float = 0.0, roll_deg: float = 0.0) -> np.ndarray:
    """Quaternion of a pitch (nose down: positive, FLU) or a roll (to the right: positive)."""
    p, r = 0.5 * math.radians(pitch_deg), 0.5 * math.radians(roll_deg)
    return quaternion_multiply(
        np.array([0.0, math.sin(p), 0.0, math.cos(p)]),
        np.array([math.sin(r), 0.0, 0.0, math.cos(r)]),
    )


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


# --- The stream ------------------------------------------------------------------------------


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
