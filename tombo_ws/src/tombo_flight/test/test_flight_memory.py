"""Memory of flights: its arrays of a flight, and their reuse."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import WALL_KEYS
from tombo_flight.scenario import load_scenario
from tombo_sim.kernel import FIGURE_COLUMNS

pytestmark = pytest.mark.slow


def flown(seed=0, workspace=None):
    return fly_scenario(load_scenario("hover", ["duration=0.3"]), seed, workspace)


def address(flight):
    return flight.log["position"].__array_interface__["data"][0]


def test_figures_of_a_flight_that_keeps_no_more_are_those_of_the_whole_log():
    scenario = load_scenario("paper_collision", [])
    whole = fly_scenario(scenario, 3)
    short = fly_scenario(scenario, 3, Workspace(figures_only=True))

    def figures(flight):
        return {key: value for key, value in flight.summary.items() if key not in WALL_KEYS}

    assert figures(whole)["collided"]
    assert figures(short) == figures(whole)
    assert short.events == whole.events
    assert set(short.log) == set(FIGURE_COLUMNS)
    for name in FIGURE_COLUMNS:
        assert np.array_equal(short.log[name], whole.log[name], equal_nan=True)
    assert "/imu/data_raw" in whole.topics
    assert "/imu/data_raw" not in short.topics


def test_memory_is_used_again_once_the_flight_is_forgotten():
    kept = flown(1)
    before = kept.log["position"].copy()
    other = flown(2)
    assert address(other) != address(kept)
    assert np.array_equal(kept.log["position"], before)
    where = address(other)
    del other
    assert address(flown(3)) == where


@pytest.mark.parametrize("topic", ["/imu/data_raw", "/odometry"])
def test_an_array_that_is_kept_keeps_its_memory(topic):
    flight = flown(1)
    where, array = address(flight), next(iter(flight[topic].values())).values
    before = array.copy()
    del flight
    assert address(flown(2)) != where
    assert np.array_equal(array, before, equal_nan=True)
