"""The set points of the AUTO modes, for a vehicle that is where it is told to be."""

import numpy as np
import pytest
from vehicle_bench import table_with

from tombo_px4.autopilot.setpoint_controller import Navigator
from tombo_px4.modes import AUTO_HOLD, AUTO_RTL, AUTO_TAKEOFF

HOME = np.array([0.5, -0.5, 0.2])
AWAY = np.array([6.0, 4.0, 2.2])
REST = np.zeros(3)


@pytest.fixture
def navigator():
    return Navigator(table_with(MIS_TAKEOFF_ALT=3.0, MPC_LAND_SPEED=0.5))


def test_take_off_rises_above_home_and_is_finished_there(navigator):
    wanted = navigator.follow(AUTO_TAKEOFF, HOME, REST, 0.7, HOME)
    assert wanted.position == pytest.approx([0.5, -0.5, 3.2]) and wanted.yaw == 0.7
    assert not navigator.finished
    navigator.follow(AUTO_TAKEOFF, wanted.position, REST, 0.7, HOME)
    assert navigator.finished


def test_a_place_in_hold_is_gone_to_once(navigator):
    navigator.follow(AUTO_HOLD, AWAY, REST, 0.7, HOME)
    navigator.go_to(np.array([5.0, 2.0, 4.0]), 1.5)
    wanted = navigator.follow(AUTO_HOLD, AWAY, REST, 0.7, HOME)
    assert wanted.position == pytest.approx([5.0, 2.0, 4.0]) and wanted.yaw == 1.5
    navigator.leave()
    assert navigator.follow(AUTO_HOLD, AWAY, REST, 0.7, HOME).position == pytest.approx(AWAY)


def test_return_goes_home_at_its_height_and_lands(navigator):
    above = np.array([0.5, -0.5, 2.2])
    assert navigator.follow(AUTO_RTL, AWAY, REST, 0.7, HOME).position == pytest.approx(above)
    assert not navigator.landing
    assert navigator.follow(AUTO_RTL, above, REST, 0.7, HOME).velocity[2] == -0.5
    assert navigator.follow(AUTO_RTL, HOME, REST, 0.7, HOME).velocity[2] == -0.5
