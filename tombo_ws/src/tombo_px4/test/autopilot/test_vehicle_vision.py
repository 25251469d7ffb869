"""Flying on motion capture: late poses, wrong frames, loss and return, and refused poses."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from vehicle_bench import Flight, hovering, ready

from tombo_px4.autopilot.parameters import FLOWN_BY_POSES
from tombo_px4.modes import AUTO_LAND, MavLandedState, mode_name

AWAY = np.array([3.0, 0.0, 0.0])


def error(flight: Flight) -> float:
    return float(np.linalg.norm(flight.vehicle.estimate.position - flight.body[:3]))


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


@pytest.mark.parametrize(("control", "known"), [(1, False), (8, False), (11, True)])
def test_position_height_and_yaw_are_fused_together(control, known):
    flight = Flight(vision=True, EKF2_EV_CTRL=control, EKF2_BARO_CTRL=0)
    flight.fly(1.5)
    assert flight.vehicle.situation.local_position == known


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
    flight.vehicle.parameters.store("EKF2_NOAID_TOUT", 1_000_000)
    flight.vehicle.parameters.store("COM_OBL_RC_ACT", 4)
    flight.see = False
    lost = flight.fly_until(lambda: flight.vehicle.failsafe, 2.0)
    assert lost == pytest.approx(1.0, abs=0.1)
    assert not flight.vehicle.situation.local_position
    assert flight.vehicle.mode == AUTO_LAND and flight.heard("No valid position estimate")
    rows = []
    flight.fly_until(lambda: bool(rows.append(flight.body) or not flight.vehicle.armed), 15.0)
    down = np.array(rows)
    assert down[:, 5].min() > -2.0 and np.linalg.norm(down[-1, :2]) < 1.0
    assert flight.vehicle.landed == MavLandedState.ON_GROUND


# --- Lost, as a real PX4 1.17 without a remote control ------------------------------------------

RECORDED = yaml.safe_load((Path(__file__).parent / "recorded_losses.yaml").read_text())


@pytest.mark.slow
@pytest.mark.parametrize("recorded", RECORDED, ids=lambda r: f"{r['lost']}, {r['parameters']}")
def test_after_a_loss_it_does_what_a_real_px4_did(recorded):
    flight = hovering(vision=True)
    for name, value in {**FLOWN_BY_POSES, **recorded["parameters"]}.items():
        flight.vehicle.parameters.store(name, value)
    began, period = flight.body[:2].copy(), flight.period
    flight.see = False
    flight.period = period if recorded["lost"] == "poses" else 10**9
    modes = {}
    for tick in range(18_000):
        flight.step()
        vehicle = flight.vehicle
        modes.setdefault(mode_name(vehicle.mode) if vehicle.armed else "disarmed", tick * 1e-3)
    assert list(modes) == recorded["modes"]
    at = recorded.get("at", {})
    assert {name: modes[name] for name in at} == pytest.approx(at, abs=1.5)
    if recorded.get("on_the_ground") or "disarmed" in modes:
        assert flight.height < 0.05 and np.linalg.norm(flight.body[:2] - began) < 1.5
    flight.see, flight.period = True, period
    flight.fly(3.0)
    if "back" in recorded:
        assert mode_name(flight.vehicle.mode) == recorded["back"]
    assert flight.vehicle.armed == ("disarmed" not in modes)
