"""Simulated flights: the paper's experiment, and some with gaps in their story."""

from __future__ import annotations

import pytest

from tombo_bag.flight import Flight
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario


def fly_named(name: str = "paper_collision", *settings: str) -> Flight:
    return fly_scenario(load_scenario(name, settings), 0)


@pytest.fixture(scope="session")
def flight() -> Flight:
    """The flight that recovers."""
    return fly_named()


@pytest.fixture(scope="session")
def edge_flights() -> dict[str, Flight]:
    """Flights that have gaps in their story."""
    return {
        "no contact": fly_named("hover"),
        "crashed": fly_named("rigid_propeller"),
        "cut short at 0.3 s": fly_named("hover", "duration=0.3"),
        "one sample": fly_named("hover", "duration=0.1", "mission.takeoff_time=0"),
        "cut short after contact": fly_named("paper_collision", "duration=23.3"),
        "detected before contact": fly_named("known_obstacle"),
    }
