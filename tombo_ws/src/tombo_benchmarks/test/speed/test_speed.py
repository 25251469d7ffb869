"""The benchmark measures what it says: the kernel's flight collides."""

from __future__ import annotations

import numpy as np
import pytest

from tombo_benchmarks.speed.kernel_flight import contact_time, fly_whole, new_flight, stretches
from tombo_benchmarks.speed.speed_measurements import batch_steps, kernel_steps, training_ticks
from tombo_dynamics.records import numbers
from tombo_dynamics.rotation import tilt
from tombo_flight.scenario import load_scenario


def test_the_kernels_flight_is_the_papers_experiment():
    scenario = load_scenario()
    contact = contact_time(scenario, 0)
    flight = new_flight(scenario, 0)
    legs = stretches(flight, contact)

    assert 22.0 < contact < 24.0
    front_left = 2
    folded = 0.0
    for leg, mode, start, stop in legs:
        for k in range(start, stop, 10):
            flight.stretch(leg, mode, k, min(k + 10, stop))
            folded = max(folded, float(flight.plant.fold[front_left]))
    assert folded > 0.5
    body = numbers(flight.plant.state)
    assert body[2] > 1.0
    assert float(tilt(body[6:10][None])[0]) < 0.3
    assert body[0] < scenario.obstacle.x - 0.5

    again = new_flight(scenario, 0)
    assert fly_whole(again, legs) == legs[-1][3]
    assert np.array_equal(numbers(again.plant.state), body)


@pytest.mark.slow
def test_rates_are_positive():
    assert kernel_steps(runs=1) > 0.0
    assert batch_steps(2, vehicles=2, runs=1) > 0.0
    assert training_ticks(2, vehicles=2, runs=1, steps=20) > 0.0
