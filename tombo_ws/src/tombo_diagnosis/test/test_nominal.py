"""The nominal model of a diagnosis, and models that extend it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.flight.nominal import held_against, nominal_model
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotor_maps import hover_point
from tombo_flight.extended_model import FittedEffect, FittedParameter, Model, Origin, write_model
from tombo_flight.scenario import load_scenario
from tombo_flight.vehicle_file import read_vehicle

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


VEHICLE = """
tombo_vehicle: 1
name: Mine
vehicle:
  mass: {value: 1.5, tolerance: 0.03}
  arm_length: 0.24
  inertia_zz: {value: 0.03, tolerance: 0.003}
  motor_time_constant: {value: 0.04, tolerance: 0.002}
propeller:
  k_thrust: {value: 1.6e-5, tolerance: 3.2e-7}
  k_torque: 2.4e-7
  radius: 0.127
  matched: 0.02
"""


def test_the_model_and_the_tolerances_of_a_vehicle_file_are_used(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(VEHICLE)
    nominal, own = nominal_model(vehicle=str(path)), nominal_model()
    assert nominal.vehicle.mass == 1.5 and nominal.vehicle_name == "Mine" and nominal.moments
    speed = math.sqrt(1.5 * 9.80665 / 4.0 / 1.6e-5)
    assert hover_point(nominal.maps, nominal.vehicle).speed == pytest.approx(speed, rel=1e-3)
    assert nominal.effects["thrust_scatter"]["deviation"] == 0.02
    known = {p.label: p.tolerance for p in nominal.parameters}
    assert known["mass_error.fraction"] == pytest.approx(0.02)
    assert known["inertia_error.zz"] == pytest.approx(0.1)
    assert known["motor_lag.extra_tau"] == pytest.approx(0.002)
    assert known["thrust_coefficient_error.fraction"] == pytest.approx(0.02)
    usual = {p.label: p.tolerance for p in own.parameters}
    assert known["inertia_error.xx"] == usual["inertia_error.xx"]
    for p in nominal.parameters:
        assert p.scale > 2.0 * p.tolerance, p.label


def test_logs_without_rotor_speeds_take_the_airframe_of_the_file():
    t = np.arange(10.0)
    speeds = Flight.measured("a", "", {"rotor_speed": Series(t, np.ones((10, 4)))})
    commands = Flight.measured("b", "", {"motor_command": Series(t, np.ones((10, 4)))})
    file = read_vehicle("px4_x500")
    assert [log.airframe for log in held_against([speeds, speeds], file)] == [None, None]
    frames = [log.airframe for log in held_against([speeds, commands], file)]
    assert frames[0] == frames[1] and frames[0].mass == file.vehicle.mass


def test_a_model_of_a_vehicle_flies_on_that_vehicle_alone(tmp_path):
    path = tmp_path / "model.yaml"
    write_model(path, Model((DRAG,), replace(ORIGIN, vehicle="PX4 X500")))
    flown = load_scenario("hover", model=str(path), vehicle="px4_x500")
    assert flown.effects["linear_rotor_drag"]["d_xy"] == 0.5
    with pytest.raises(InputError, match=r"another vehicle \(PX4 X500\)"):
        load_scenario("hover", model=str(path), vehicle="crazyflie_2_1")
