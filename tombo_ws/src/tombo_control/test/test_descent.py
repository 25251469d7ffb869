"""Blind, the vehicle brakes, sinks slowly, and stops its rotors on the ground."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from lockstep_bench import Lockstep, calm, hover_at, hovering
from tombo_control.safety.flight_volume import clamp_to_volume, outside_volume
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_control.safety.state_machine import SafetyState
from tombo_dynamics.messages import Phase
from tombo_dynamics.records import parameter_record

WRONG = {
    "as_modelled": (),
    "weak": ("effects.thrust_coefficient_error.fraction=-0.1",),
    "strong": ("effects.thrust_coefficient_error.fraction=0.1",),
    "heavy": ("effects.mass_error.fraction=0.1",),
}


def _state(flight: Lockstep) -> SafetyState:
    return SafetyState(int(flight.controller.memory.watch.state))


@pytest.mark.slow
@pytest.mark.parametrize("wrong", WRONG)
def test_without_estimates_it_sinks_slowly_drifts_little_and_stays_down(wrong: str) -> None:
    flight = hovering(calm(*WRONG[wrong]), seed=11)
    begin = flight.position
    flight.odometry_on = False
    rows = flight.fly(14.0)
    down = int(np.argmax(rows[:, 2] < 0.185))
    assert 3000 < down < 10_000
    assert -rows[:down, 5].min() <= 0.5
    assert np.linalg.norm(rows[:5000, :2] - begin[:2], axis=1).max() < 1.5
    assert _state(flight) == SafetyState.LATCHED
    assert flight.command is not None
    assert not flight.command.speed.any()
    assert np.linalg.norm(rows[-1, :2] - rows[down, :2]) < 0.4, "it slid"
    flight.odometry_on = True
    assert flight.fly(5.0)[:, 2].max() < 0.19, "no estimate starts the rotors again"
    assert _state(flight) == SafetyState.LATCHED


@pytest.mark.slow
def test_without_set_points_for_long_it_lands(flight: Lockstep) -> None:
    flight.controller.set_params("safety", SafetyParams(hold_time=1.0))
    flight.steer = lambda _: None
    rows = flight.fly(9.0)
    assert _state(flight) == SafetyState.LATCHED
    assert np.linalg.norm(rows[:, :2] - rows[0, :2], axis=1).max() < 0.2
    flight.steer = lambda _: hover_at(0.0, 0.0, 2.0)
    assert flight.fly(3.0)[:, 2].max() < 0.19, "set points that come back lift nothing off"


@pytest.mark.slow
def test_outside_of_the_flight_volume_it_lands_and_set_points_stay_inside(
    flight: Lockstep,
) -> None:
    flight.controller.set_params("volume", FlightVolume(x_min=-1.0, x_max=1.0, margin=0.3))
    flight.steer = lambda _: hover_at(3.0, 0.0, 2.0)
    rows = flight.fly(5.0)
    assert 0.85 < rows[-1, 0] < 1.15
    assert _state(flight) == SafetyState.FLY
    flight.controller.set_params("volume", FlightVolume(x_min=-1.0, x_max=0.5, margin=0.3))
    flight.steer = lambda _: hover_at(3.0, 0.0, 2.0)
    flight.fly(0.6)
    assert _state(flight) == SafetyState.LAND
    flight.fly(8.0)
    assert _state(flight) == SafetyState.LATCHED


def test_the_nearest_place_in_the_volume() -> None:
    volume = parameter_record(FlightVolume(x_min=-2.0, x_max=2.0, z_max=3.0, radius=1.5))
    place = np.array([5.0, 0.0, 9.0])
    assert outside_volume(place, volume) == pytest.approx(6.0)
    assert clamp_to_volume(place, volume)
    assert place == pytest.approx([1.5, 0.0, 3.0])
    assert not clamp_to_volume(place, volume)
    assert outside_volume(place, volume) == 0.0


@pytest.mark.slow
def test_a_landing_that_is_held_up_above_the_ground_ends(flight: Lockstep) -> None:
    """Phase land, and something the mission does not know of carries the vehicle."""
    landing = replace(hover_at(0.0, 0.0, 2.0), phase=Phase.LAND)
    flight.steer = lambda _: landing
    flight.fly(4.0)
    assert _state(flight) == SafetyState.LAND
    flight.fly(9.0)
    assert _state(flight) == SafetyState.LATCHED
