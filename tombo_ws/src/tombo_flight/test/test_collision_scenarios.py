"""The built-in collisions: which rotor touches what, flying which way."""

import math

import numpy as np
import pytest

from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario, with_settings

SOONER = ("mission.approach_time=6", "duration=11")


def fly_named(name, *settings):
    """Return a flight that is over soon after the contact, and the tick of the contact."""
    record = fly_scenario(load_scenario(name, (*SOONER, *settings)), 5000)
    return record, round(record.summary["collision_time_s"] / 1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("speed", [0.7, 1.2])
@pytest.mark.parametrize(
    ("name", "rotor", "to_nose"),
    [
        ("paper_collision", "front_left", 0.0),
        ("pole", "front_left", 0.0),
        ("pillar_right", "front_left", 0.0),
        ("pillar_wide", "front_left", 0.0),
        ("short_strike", "front_left", 0.0),
        ("side_hit", "rear_left", 0.5 * math.pi),
        ("rear_hit", "rear_right", math.pi),
    ],
)
def test_a_collision_is_the_one_that_its_name_says(name, rotor, to_nose, speed):
    record, contact = fly_named(name, f"mission.approach_speed={speed}")
    assert record.summary["contact_rotor"] == rotor
    velocity = record.log["velocity"][contact - 1]
    course = math.atan2(velocity[1], velocity[0])
    yaw = yaw_pitch_roll(record.log["attitude"][contact - 1 : contact])[0, 0]
    off = (course - yaw - to_nose + math.pi) % (2.0 * math.pi) - math.pi
    assert abs(off) < 0.1
    assert np.hypot(velocity[0], velocity[1]) == pytest.approx(speed, abs=0.1)
    x, y, _ = record.summary["contact_position_m"]
    assert math.hypot(x, y) == pytest.approx(1.7, abs=0.04)  # the paper's x_c, on every course


@pytest.mark.slow
@pytest.mark.parametrize("conf", ["propeller.conf=13", "propeller.conf=0"])
def test_the_obstacle_of_a_scenario_from_scratch_is_solid(conf):
    own = {"obstacle": {"x": 2.0, "y": 0.0, "radius": 0.1}, "reaction": {"name": "none"}}
    scenario = with_settings(own, (*SOONER, "mission.approach_speed=1.5", conf), "mine")
    record = fly_scenario(scenario, 0)
    assert record.summary["collided"]
    axis = [record.scenario["obstacle"][key] for key in ("x_m", "y_m")]
    off = np.linalg.norm(record.log["position"][:, :2] - axis, axis=1)
    assert off.min() > 0.1  # the centre of the vehicle was never inside
