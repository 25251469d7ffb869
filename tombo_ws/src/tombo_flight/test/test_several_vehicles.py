"""Several vehicles in lockstep: alike flights where they are apart, refusals and downwash else."""

from dataclasses import replace

import numpy as np
import pytest

from tombo_dynamics.messages import Phase
from tombo_flight.flight import fly_scenario, fly_several
from tombo_flight.scenario import load_scenario
from tombo_flight.several_vehicles import FlownVehicle, vehicles_of

SHORT = ("mission.takeoff_time=0.2", "mission.height=1.0", "mission.climb_speed=1.0")


def flown_at(height, start, *settings):
    settings = (*SHORT, f"mission.height={height}", "duration=9.0", *settings)
    scenario = load_scenario("no_obstacle", settings)
    effects = {**scenario.effects, "downwash": {"strength": 1.0}}
    return replace(scenario, effects=effects), start


def room(*flown):
    return fly_several(
        [FlownVehicle(f"v{k}", s, start, k) for k, (s, start) in enumerate(flown, start=1)]
    )


@pytest.mark.slow
def test_vehicles_that_are_apart_fly_as_each_would_alone():
    settings = (*SHORT, "mission.approach_time=2.0", "duration=5.0", "effects.downwash.strength=0")
    vehicles = vehicles_of(load_scenario("no_obstacle", settings), 4, 7)
    together = fly_several(vehicles)
    for vehicle in vehicles:
        (alone,) = fly_several([vehicle]).values()
        for name, column in alone.log.items():
            np.testing.assert_array_equal(together[vehicle.name].log[name], column, name)
    usual = fly_scenario(vehicles[0].scenario, 7)
    np.testing.assert_array_equal(together["v1"].log["position"], usual.log["position"])


@pytest.mark.slow
def test_a_vehicle_holds_before_it_comes_too_near_to_another():
    """The second is to fly from 3 m away through the place where the first hovers."""
    goal = ("mission.goal_x=-6.0", "mission.approach_time=2.5", "mission.approach_speed=1.0")
    still = flown_at(1.0, (0.0, 0.0), "mission.approach_time=100", "mission.land_time=200")
    flights = room(still, flown_at(1.0, (3.0, 0.0), *goal))
    one, other = (flights[name].log["position"] for name in ("v1", "v2"))
    apart = np.linalg.norm(one - other, axis=1)
    assert 0.8 < apart.min() < 1.7  # it looks ahead as far as it brakes
    said = flights["v2"]["/mission/status"]["text"].values
    assert any("nearer to another vehicle than safety.separation" in text for text in said)
    setpoint = flights["v2"]["/mission/setpoint"]["position"].values[-1]
    assert np.linalg.norm(setpoint - one[-1]) > 0.8


@pytest.mark.slow
def test_downwash_pushes_the_vehicle_below_and_is_taken_for_no_wall():
    """The upper one flies to and fro, 0.5 m above the lower one."""
    near = ("safety.separation=0.1", "mission.approach_speed=1.0", "mission.approach_time=4.0")
    upper = flown_at(1.7, (-2.0, 0.0), "mission.goal_x=2.0", *near)
    lower = flown_at(1.2, (0.0, 0.0), *near, "mission.approach_time=100", "mission.land_time=200")
    flights = room(upper, lower)
    blown = flights["v2"]
    sunk = 1.38 - blown.log["position"][4000:, 2].min()
    alone = fly_scenario(lower[0], 2)
    assert np.abs(blown.log["position"][4000:, 2] - alone.log["position"][4000:, 2]).max() > 0.01
    assert sunk < 0.3
    for name in ("/collision_event", "/contact_event"):
        assert len(blown[name].t) == 0
    assert (np.asarray(blown["/mission/status"]["phase"].values) != Phase.REACT).all()
