"""A new vehicle, and its state as numbers."""

import dataclasses

import numpy as np
import pytest

from tombo_dynamics.effects.compose import SimulatedPlant, new_plant
from tombo_dynamics.plant import State, set_state
from tombo_dynamics.records import numbers
from tombo_dynamics.vehicle import VehicleParams

AT_REST = np.array([*[0.0] * 9, 1.0, 0.0, 0.0, 0.0])


def test_every_vehicle_parameter_is_in_its_field():
    values = {f.name: (i + 1) * 1e-3 for i, f in enumerate(dataclasses.fields(VehicleParams))}
    nominal = new_plant(VehicleParams(**values)).vehicle
    assert {name: nominal[name] for name in nominal.dtype.names} == values


def test_a_new_vehicle_is_upright_at_the_origin_and_all_else_zero(vehicle):
    plant = new_plant(vehicle)
    assert (numbers(plant.state) == AT_REST).all()
    plant.state.attitude = 0.0
    plant.vehicle = np.zeros((), plant.vehicle.dtype)
    assert plant == SimulatedPlant.new()


def test_a_state_is_set_from_its_numbers_in_order():
    state, values = State.new(), np.arange(13.0)
    set_state(state, values)
    assert (numbers(state) == values).all()
    assert state.rates == pytest.approx([10.0, 11.0, 12.0])
