"""Vehicles other than the suite's own fly, with the gains that follow from their files."""

import math

import numpy as np
import pytest

from tombo_dynamics.vehicle import GRAVITY
from tombo_flight.builtin_files import builtin_vehicles
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario

CALM = ("effects.gusts.deviation=0", "effects.thrust_scatter.deviation=0")


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 3])
@pytest.mark.parametrize("name", builtin_vehicles())
def test_a_preset_takes_off_hovers_and_lands(name, seed):
    # The transient of a small vehicle's take-off fades with the slowest loop: here up to 10 s.
    scenario = load_scenario("hover", ["mission.land_time=50", "duration=70"], vehicle=name)
    flight = fly_scenario(scenario, seed)
    position, vehicle = flight.log["position"], scenario.vehicle
    hovering = (flight.t > 35.0) & (flight.t < 49.0)
    target = np.array([*position[0, :2], 2.0])
    assert np.linalg.norm(position[hovering] - target, axis=1).max() < 0.1
    assert not flight.summary["crashed"]
    assert position[-1, 2] == pytest.approx(vehicle.leg_height, abs=0.005)


@pytest.mark.slow
def test_a_plain_propeller_hovers_at_the_speed_of_a_hand_calculation():
    """m g = 4 k omega^2, in flight and not in the table alone."""
    k, mass = 8.54858e-6, 2.0643
    scenario = load_scenario("hover", CALM, vehicle="px4_x500")
    flight = fly_scenario(scenario, 0)
    hovering = (flight.t > 15.0) & (flight.t < 29.0)
    speed = math.sqrt(float(np.mean(flight.log["rotor_speed"][hovering] ** 2)))
    assert speed == pytest.approx(math.sqrt(mass * GRAVITY / (4.0 * k)), rel=0.003)


def strike(on_impact, seed=1):
    """Fly the paper's collision with a propeller of the Tombo's thrust and size."""
    settings = [
        "propeller.k_thrust=1.213e-5", "propeller.k_torque=4.86e-7",
        f"propeller.on_impact={on_impact}", "propeller.matched=0.02",
    ]  # fmt: skip
    return fly_scenario(load_scenario("paper_collision", settings), seed)


@pytest.mark.slow
def test_a_propeller_does_on_impact_what_its_file_says():
    rigid, breaks, folds = (strike(what) for what in ("rigid", "breaks", "folds"))
    for flight in (rigid, breaks, folds):
        assert flight.summary["collided"]
    assert breaks.log["damage"].max() >= 1.0 and breaks.summary["crashed"]
    assert rigid.log["damage"].max() == 0.0
    assert 0.0 < folds.log["damage"].max() < 1.0
    short, long = ((f.log["fold"].max(axis=1) > 0.1).sum() for f in (rigid, folds))
    assert short < 0.2 * long
