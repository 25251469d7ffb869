"""The flight volume over PX4: set points stay inside, a vehicle outside lands."""

import numpy as np
import pytest
from bridge_flight import hovering

from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_dynamics.messages import Phase, PositionSetpoint
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.bridge.setpoint_stream import FlightLimits
from tombo_px4.modes import AUTO_LAND

LIMITS = FlightLimits(FlightVolume(x_max=1.0, z_max=2.0, margin=0.4), SafetyParams(speed_max=3.0))


def setpoint(x, y, z):
    moving = np.array([1.0, 0.0, 0.0])
    return PositionSetpoint(0, np.array([x, y, z]), moving, moving, 0.0, Phase.HOVER)


def test_a_set_point_outside_is_moved_to_the_border_and_rests_there():
    inside, moved = LIMITS.inside(setpoint(5.0, 1.0, 9.0))
    assert moved and inside.position == pytest.approx([1.0, 1.0, 2.0])
    assert not inside.velocity.any() and not inside.acceleration.any()
    same = setpoint(0.5, 1.0, 1.0)
    assert LIMITS.inside(same) == (same, False)


@pytest.mark.slow
def test_px4_gets_no_set_point_outside_and_the_fault_says_so():
    flight = hovering(LIMITS)
    flight.goal = np.array([4.0, 0.0, 1.5])
    flight.run(6.0)
    assert flight.px4.place[0] == pytest.approx(1.0, abs=0.05)
    assert "moved to its border" in flight.out.faults["setpoint_outside"]


@pytest.mark.slow
def test_a_vehicle_outside_by_more_than_the_margin_lands():
    flight = hovering(LIMITS)

    flight.px4.deaf = lambda message: message.get_type().startswith("SET_")
    away = OffboardSetpoint(velocity=np.array([0.8, 0.0, 0.0]), yaw=0.0)

    def lands(flight):
        flight.px4.vehicle.target(away)
        return flight.px4.mode == AUTO_LAND

    flight.until(lands, 8.0)
    assert any("outside of the flight volume" in text for _, text in flight.events)
