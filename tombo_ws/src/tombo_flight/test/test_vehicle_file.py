"""Vehicle files: their content survives a round trip, and errors are refused."""

import dataclasses
import math

import pytest

from tombo_control.params import ControlParams
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.builtin_files import builtin_vehicles
from tombo_flight.scenario import load_scenario
from tombo_flight.vehicle_file import read_vehicle, vehicle_from_text, write_vehicle

TEXT = """
tombo_vehicle: 1
name: My S500
vehicle:
  mass: {value: 1.5, tolerance: 0.005, source: weighed}
  arm_length: 0.24
propeller:
  k_thrust: {value: 1.6e-5, tolerance: 2.0e-7, source: stand}
  k_torque: 2.4e-7
  radius: 0.127
"""


def test_the_suites_own_vehicle_is_the_default_to_the_last_bit():
    file = read_vehicle("tombo_s500")
    assert file.vehicle == VehicleParams()
    assert file.propeller == PropellerChoice()
    assert file.control == ControlParams()
    for name in ("hover", "paper_collision", "survey"):
        assert load_scenario(name, vehicle="tombo_s500") == load_scenario(name)


@pytest.mark.parametrize("name", builtin_vehicles())
def test_a_vehicle_survives_its_file(name, tmp_path):
    file = read_vehicle(name)
    write_vehicle(tmp_path / "v.yaml", file)
    assert read_vehicle(str(tmp_path / "v.yaml")) == file
    assert [p.name for p in tmp_path.iterdir()] == ["v.yaml"]


def test_each_value_of_a_preset_has_a_source():
    for name in builtin_vehicles():
        file = read_vehicle(name)
        bare = {key for key in file.given if not file.notes.get(key) or not file.notes[key].source}
        assert bare <= {"propeller.law"}, name


def test_values_with_and_without_notes_are_read():
    file = vehicle_from_text(TEXT, "own")
    assert file.vehicle.mass == 1.5
    assert file.tolerance("vehicle.mass") == 0.005 and file.tolerance("vehicle.arm_length") is None
    assert file.notes["propeller.k_thrust"].source == "stand"
    assert file.vehicle.rotor_radius == 0.127


def test_what_is_left_out_has_the_vehicles_own_size():
    """By dimensions: half the mass on half the arm has an eighth of the inertia."""
    half = (
        TEXT.replace("value: 1.5", "value: 0.75").replace("0.24", "0.12").replace("0.127", "0.05")
    )
    small, own = vehicle_from_text(half, "half").vehicle, vehicle_from_text(TEXT, "own").vehicle
    assert small.inertia_xx == pytest.approx(own.inertia_xx / 8.0)
    sag = [v.mass / v.ground_stiffness for v in (small, own)]
    assert sag[0] == pytest.approx(sag[1])
    assert small.rotor_speed_max == pytest.approx(own.rotor_speed_max * math.sqrt(0.5))


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("value: 1.5", "value: .nan", ("vehicle.mass", "nan", "[kg]")),
        ("value: 1.5", "value: -1.5", ("vehicle.mass", "-1.5", "0.01 to 10")),
        ("value: 1.5, ", "", ("vehicle.mass", "no value")),
        ("tolerance: 0.005", "tolerance: much", ("vehicle.mass.tolerance", "much")),
        ("tolerance: 0.005", "sigma: 0.005", ("sigma", "tolerance")),
        ("arm_length", "arm_lenght", ("arm_lenght", "did you mean 'arm_length'")),
        ("arm_length: 0.24", "arm_length: 0.17", ("vehicle.arm_length", "overlap", "0.1796")),
        ("radius: 0.127", "radius: 0", ("propeller.radius", "missing")),
        ("  k_torque: 2.4e-7\n", "", ("propeller.k_torque", "missing")),
        ("radius: 0.127", "radius: 0.127\n  on_impact: melts", ("on_impact", "melts", "breaks")),
        ("radius: 0.127", "radius: 0.127\n  curve: [[1, 2]]", ("propeller.curve[0]", "rows")),
        ("value: 1.5", "value: 1.5}\n  rotor_speed_max: {value: 300", ("k_thrust", "at most")),
        ("tombo_vehicle: 1", "tombo_vehicle: 2", ("tombo_vehicle: 2", "accepted: 1")),
        (TEXT[TEXT.index("propeller"):], "", ("propeller: missing",)),
        (TEXT, "[1, 2]", ("tombo_vehicle",)),
        ("vehicle:\n", "vehicle: {\n", ("YAML",)),
        ("name: My S500", "name: x\neffects: {linear_rotor_drag: 3}", ("linear_rotor_drag", "3")),
        ("name: My S500", "name: x\ncontrol: {rate_p: 1000}", ("control.rate_p", "1000")),
    ],
)  # fmt: skip
def test_a_wrong_file_is_refused_in_one_line(old, new, words):
    assert old in TEXT
    with pytest.raises(InputError) as caught:
        vehicle_from_text(TEXT.replace(old, new, 1), "vehicle file 'v.yaml'")
    message = str(caught.value)
    assert "v.yaml" in message and "\n" not in message
    for word in words:
        assert word in message


def test_settings_win_over_the_file_and_the_file_over_the_scenario(tmp_path):
    (tmp_path / "own.yaml").write_text(TEXT)
    (tmp_path / "flight.yaml").write_text("extends: rigid_propeller\nvehicle: own.yaml\n")
    by_scenario = load_scenario(str(tmp_path / "flight.yaml"))
    assert by_scenario.propeller.plain and by_scenario.vehicle.mass == 1.5
    path = str(tmp_path / "own.yaml")
    by_option = load_scenario("rigid_propeller", vehicle=path)
    assert dataclasses.replace(by_scenario, name=by_option.name, description="") == (
        dataclasses.replace(by_option, description="")
    )
    heavy = load_scenario("hover", ["vehicle.mass=1.7", "control.rate_p=20"], vehicle=path)
    assert heavy.vehicle.mass == 1.7 and heavy.control.rate_p == 20.0
    assert heavy.propeller == by_option.propeller
    with pytest.raises(InputError, match=r"propeller\.conf=5.*plain propeller"):
        load_scenario("hover", ["propeller.conf=5"], vehicle=path)


def test_limits_of_a_scenario_stay_and_forces_take_the_vehicles_size():
    survey, own = load_scenario("survey", vehicle="crazyflie_2_1"), load_scenario("survey")
    assert survey.control.velocity_max_xy == own.control.velocity_max_xy == 3.0
    assert survey.control.rate_p < own.control.rate_p
    drag = [s.effects["linear_rotor_drag"]["d_xy"] / s.vehicle.mass for s in (survey, own)]
    assert drag[0] == pytest.approx(drag[1])
    assert survey.effects["mocap_noise"] == own.effects["mocap_noise"]
