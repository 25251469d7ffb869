"""A flight whose plant is changed before its first tick, in ways that no scenario can say."""

from __future__ import annotations

from typing import Any

import numpy as np

from tombo_benchmarks.diagnosis.disturbances import set_disturbance
from tombo_dynamics.arrays import Array
from tombo_dynamics.plant import Plant
from tombo_flight.flight import fly_scenario
from tombo_flight.scenario import load_scenario

_QUICK = ["mission.takeoff_time=0.2", "duration=6"]


def _fly(prepare: Any = None, settings: tuple[str, ...] = (), seed: int = 1) -> dict[str, Array]:
    return fly_scenario(load_scenario("hover", [*_QUICK, *settings]), seed, prepare=prepare).log


def test_equal_propellers_in_flights_of_different_seeds() -> None:
    def same_propellers(plant: Plant) -> None:
        plant.draws[:4] = [1.0, -1.0, 0.5, 0.0]

    scatter = ("effects.thrust_scatter.deviation=0.1",)
    moments = []
    for prepare in (None, same_propellers):
        speeds = [_fly(prepare, scatter, seed)["rotor_speed"][-500:].mean(0) for seed in (1, 2)]
        moments.append(np.abs(speeds[0] - speeds[1]).max())
    assert moments[1] < 2.0 < moments[0]


def test_a_disturbance_acts_in_the_flight_and_the_accelerometer_feels_it() -> None:
    calm = _fly()
    pushed = _fly(lambda plant: set_disturbance(plant, "body_push", 0.0, 0.65, 0.0))
    felt = pushed["accel"][-1000:, 1].mean() - calm["accel"][-1000:, 1].mean()
    assert abs(felt - 0.65 / 1.3) < 0.05
