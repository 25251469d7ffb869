"""Flying on motion capture: late poses, wrong frames, lost and found, and what is refused."""

import math

import numpy as np
import pytest
from vehicle_bench import Flight, hovering, ready

from tombo_px4.bridge.vehicle_parameters import SAFE_PARAMETERS
from tombo_px4.link.decoded_messages import MavLandedState, Result
from tombo_px4.modes import ALTCTL, AUTO_LAND, AUTO_TAKEOFF, OFFBOARD, STABILIZED

AWAY = np.array([3.0, 0.0, 0.0])


def error(flight: Flight) -> float:
    return float(np.linalg.norm(flight.vehicle.estimate.position - flight.body[:3]))


@pytest.mark.slow
@pytest.mark.parametrize("late", [150])
def test_late_poses_with_right_stamps_cost_little(late):
    flight = Flight(vision=True)
    flight.late_ticks = late
    flight.fly(1.5)
    flight.offboard()
    assert set(flight.words) == {""}
    rows = flight.fly(4.0)
    assert rows[:, :3].std(axis=0).max() < 0.03 and error(flight) < 0.01


@pytest.mark.parametrize(
    ("boot_us", "position", "attitude", "word"),
    [
        (0, [0, 0, 0], [0, 0, 0, 1], ""),
        (6_000, [0, 0, 0], [0, 0, 0, 1], "future"),
        (-1_000_000, [0, 0, 0], [0, 0, 0, 1], "late"),
        (-40_000, [0, 0, 0], [0, 0, 0, 1], "out_of_order"),
        (0, [math.nan, 0, 0], [0, 0, 0, 1], "not_finite"),
        (0, [0, 0, 0], [0, math.inf, 0, 1], "not_finite"),
        (0, [1e9, 0, 0], [0, 0, 0, 1], "out_of_range"),
    ],
)
def test_bad_vision_samples_are_refused_with_the_reason(boot_us, position, attitude, word):
    flight = ready(vision=True)
    flight.see = False
    flight.fly(0.1)
    vehicle = flight.vehicle
    flight.vehicle.vision(vehicle.boot_us - 20_000, flight.body[:3], flight.body[6:10])
    flight.fly(0.01)
    if word == "late":
        flight.fly(0.6)
        boot_us += 450_000  # newer than the last one, older than what is remembered
    before = vehicle.ekf2_model.fused_tick
    answer = vehicle.vision(
        vehicle.boot_us + boot_us, np.array(position, float), np.array(attitude, float)
    )
    assert answer == word
    if word:
        flight.fly(0.01)
        assert vehicle.ekf2_model.fused_tick == before


@pytest.mark.parametrize(("control", "known"), [(1, False), (3, True), (8, False), (11, True)])
def test_position_needs_horizontal_and_vertical_aiding(control, known):
    flight = Flight(vision=True, EKF2_HGT_REF=0, EKF2_EV_CTRL=control, EKF2_BARO_CTRL=0)
    flight.fly(1.5)
    assert flight.vehicle.health.local_position == known


def test_a_motion_capture_that_stays_elsewhere_is_believed():
    flight = hovering(vision=True)
    flight.mangle = lambda p, q: (p + AWAY, q)
    flight.fly(0.9)
    assert flight.ekf2.resets == 1
    flight.fly(0.4)
    assert flight.ekf2.resets == 2
    assert flight.vehicle.estimate.position[0] == pytest.approx(flight.body[0] + 3.0, abs=0.1)


# --- Lost ------------------------------------------------------------------------------------


def test_after_the_time_that_is_set_it_descends_level_and_stops():
    flight = hovering(vision=True)
    flight.vehicle.parameters.set("EKF2_NOAID_TOUT", 1_000_000)
    flight.vehicle.parameters.set("COM_OBL_RC_ACT", 4)
    flight.see = False
    lost = flight.fly_until(lambda: flight.vehicle.failsafe, 2.0)
    assert lost == pytest.approx(1.0, abs=0.1)
    assert not flight.vehicle.health.local_position
    assert flight.vehicle.mode == AUTO_LAND and flight.heard("No valid position estimate")
    rows = []
    flight.fly_until(lambda: bool(rows.append(flight.body) or not flight.vehicle.armed), 15.0)
    down = np.array(rows)
    assert down[:, 5].min() > -2.0 and np.linalg.norm(down[-1, :2]) < 1.0
    assert flight.vehicle.landed == MavLandedState.ON_GROUND


def test_take_off_without_a_global_position_stays_at_the_top():
    flight = ready(vision=True)
    flight.vehicle.takeoff(1.5)
    assert flight.vehicle.arm() == Result.ACCEPTED
    flight.fly(9.0)
    assert flight.vehicle.mode == AUTO_TAKEOFF and flight.height == pytest.approx(1.5, abs=0.05)
    assert not flight.heard("not available")


# --- Lost, as a real PX4 1.17 without a remote control ------------------------------------------


def modes_after_the_loss(flight, seconds):
    """Take vision away for some seconds; return the modes, and whether it is armed at the end."""
    flight.see = False
    modes = []
    for _ in range(round(seconds * 1000)):
        flight.step()
        if not modes or modes[-1] != flight.vehicle.mode:
            modes.append(flight.vehicle.mode)
    return modes


@pytest.mark.slow
def test_with_px4s_default_a_lost_position_ends_in_a_mode_that_nobody_steers():
    """As measured: OFFBOARD, 4.9 s later altitude, 5.4 s stabilized, and back when poses come."""
    flight = hovering(vision=True)
    assert flight.vehicle.parameters.set("COM_OBL_RC_ACT", 0) == ""
    assert flight.vehicle.parameters.set("EKF2_BARO_CTRL", 0) == ""
    assert modes_after_the_loss(flight, 12.0) == [OFFBOARD, ALTCTL, STABILIZED]
    assert flight.vehicle.armed
    flight.see = True
    flight.fly(3.0)
    assert flight.vehicle.mode == OFFBOARD


@pytest.mark.slow
def test_with_px4s_default_a_dead_bridge_ends_in_a_mode_that_nobody_steers():
    flight = hovering(vision=True)
    assert flight.vehicle.parameters.set("COM_OBL_RC_ACT", 0) == ""
    assert flight.vehicle.parameters.set("EKF2_BARO_CTRL", 0) == ""
    flight.period = 10**9
    assert modes_after_the_loss(flight, 12.0) == [OFFBOARD, AUTO_LAND, ALTCTL, STABILIZED]
    assert flight.vehicle.armed


@pytest.mark.slow
@pytest.mark.parametrize("streams", [True, False])
def test_with_the_parameters_that_are_demanded_it_lands_and_disarms(streams):
    flight = hovering(vision=True)
    for name, value in SAFE_PARAMETERS.items():
        assert flight.vehicle.parameters.set(name, value) == ""
    flight.period = flight.period if streams else 10**9
    began = flight.body[:2].copy()
    assert modes_after_the_loss(flight, 18.0)[:2] == [OFFBOARD, AUTO_LAND]
    assert not flight.vehicle.armed
    assert np.linalg.norm(flight.body[:2] - began) < 1.5
    flight.see, flight.period = True, 50
    flight.fly(5.0)
    assert not flight.vehicle.armed


@pytest.mark.slow
def test_without_a_height_px4_does_not_notice_the_ground():
    flight = hovering(vision=True)
    for name, value in {**SAFE_PARAMETERS, "EKF2_BARO_CTRL": 0}.items():
        assert flight.vehicle.parameters.set(name, value) == ""
    modes_after_the_loss(flight, 20.0)
    assert flight.vehicle.armed and flight.height < 0.05
