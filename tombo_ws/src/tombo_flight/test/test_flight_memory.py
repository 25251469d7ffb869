"""A flight that keeps its figures alone."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_flight.flight import Workspace, fly_scenario
from tombo_flight.flight_output import WALL_KEYS
from tombo_flight.scenario import load_scenario
from tombo_sim.kernel import FIGURE_COLUMNS

pytestmark = pytest.mark.slow


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
