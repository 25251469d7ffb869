"""The benchmark measures what it says: the kernel's flight collides, NumPy flies it too."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tombo_benchmarks.speed import __main__ as command
from tombo_benchmarks.speed.kernel_flight import (
    contact_time,
    fly_whole,
    fly_with_true_state,
    new_flight,
    stretches,
)
from tombo_benchmarks.speed.numpy_step import hovering
from tombo_benchmarks.speed.speed_measurements import (
    batch_steps,
    kernel_steps,
    numpy_steps,
    training_ticks,
)
from tombo_control.planning.leg import store_leg, straight_leg
from tombo_dynamics.messages import Phase
from tombo_dynamics.plant import set_state
from tombo_dynamics.records import numbers
from tombo_dynamics.rotation import tilt
from tombo_flight.scenario import load_scenario


@pytest.mark.slow
def test_numpy_and_kernel_fly_the_same_approach():
    scenario = load_scenario(
        "no_obstacle",
        [
            "effects.ground_effect.strength=0",
            "effects.gusts.deviation=0",
            "effects.thrust_scatter.deviation=0",
        ],
    )
    plain = hovering(scenario, np.array([0.0, 0.0, 2.0]))
    flight = new_flight(scenario, 0)
    set_state(flight.plant.state, plain.body)
    flight.plant.rotor_speed = plain.speed
    flight.plant.rotor_command = plain.speed
    leg = straight_leg((0.0, 0.0, 2.0), (1.0, 0.5, 2.3), scenario.mission.approach_speed, 0.0)
    store_leg(flight.autopilot.leg, leg)
    flight.autopilot.mode_asked = Phase.APPROACH

    furthest = 0.0
    for tick in range(3000):
        plain.step(leg, tick)
        fly_with_true_state(
            flight.plant,
            flight.autopilot,
            flight.maps,
            flight.theta,
            flight.zero_noise,
            tick,
            tick + 1,
        )
        body = numbers(flight.plant.state)
        assert np.abs(body - plain.body).max() < 1e-3, tick
        furthest = max(furthest, float(body[0]))

    assert furthest > 0.9


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
def test_rates_are_positive_and_numpy_is_the_slow_one():
    assert kernel_steps(runs=1) > numpy_steps(runs=1, ticks=50) > 0.0
    assert batch_steps(2, vehicles=2, runs=1) > 0.0
    assert training_ticks(2, vehicles=2, runs=1, steps=20) > 0.0


@pytest.mark.parametrize("arguments", [["--json"], []])
def test_the_command_prints_every_figure(monkeypatch, capsys, arguments):
    figures = {row[0]: 1.5e6 for row in command._ROWS}
    monkeypatch.setattr(command, "measure", lambda said: figures)

    command.main(arguments)

    out = capsys.readouterr().out
    if arguments:
        assert json.loads(out) == figures
    else:
        assert "at least 3" in out
