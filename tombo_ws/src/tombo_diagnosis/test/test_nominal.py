"""The nominal model of a diagnosis, and models that are laid over it."""

from dataclasses import replace

import pytest

from tombo_diagnosis.flight.scenario_nominal import nominal_model
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import FittedEffect, FittedParameter, Model, Origin
from tombo_flight.model_file import write_model
from tombo_flight.scenario import load_scenario

DRAG = FittedEffect(
    "linear_rotor_drag", (FittedParameter("d_xy", "N s/m", 0.3, 0.5, 0.48, 0.52),), 0.9
)
ORIGIN = Origin("tombo", "2026-01-01", "named", 0.9, "Drag.", "no_obstacle")


def test_the_nominal_model_is_the_suites_own_vehicle():
    nominal = nominal_model()
    assert not nominal.calibrated and nominal.moments
    assert nominal.vehicle == load_scenario("no_obstacle").vehicle


def test_a_model_file_extends_it(tmp_path):
    path = tmp_path / "model.yaml"
    write_model(path, Model((DRAG,), ORIGIN))
    assert nominal_model(path).effects["linear_rotor_drag"]["d_xy"] == 0.5


def test_a_model_of_another_vehicle_is_not_flown(tmp_path):
    path = tmp_path / "model.yaml"
    write_model(path, Model((DRAG,), replace(ORIGIN, vehicle="Crazyflie 2.1")))
    with pytest.raises(InputError, match=r"another vehicle \(Crazyflie 2\.1\)"):
        load_scenario("hover", model=str(path))
