"""Mapping files: errors name key, value and the accepted values."""

from pathlib import Path

import pytest

from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_logs.readers.csv_mapping import load_mapping, parse_mapping, shipped
from tombo_logs.readers.units import factor

GOOD = """
time: {column: t, unit: ms}
channels:
  position: {columns: [x, y, z], unit: m}
  attitude: {columns: [a, b, c, d], order: wxyz}
"""


def test_the_shipped_ones_can_be_read_and_are_distinguished():
    known = shipped()
    assert {"nanobench", "generic"} <= set(known)
    first, second = (known[n].channels["position"].columns for n in ("nanobench", "generic"))
    assert not set(first) & set(second)


def test_the_example_puts_each_motor_at_its_rotor():
    """Bitcraze: M1 front right, M2 rear right, M3 rear left, M4 front left."""
    folder = Path(__file__).resolve().parents[5] / "examples"
    mapping = load_mapping(folder / "crazypad.yaml")
    place = {"1": "front_right", "2": "rear_right", "3": "rear_left", "4": "front_left"}
    columns = mapping.channels["motor_command"].columns
    assert tuple(place[c[-1]] for c in columns) == ROTOR_NAMES


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        (("unit: ms", "unit: weeks"), "unknown unit of mapping 'lab': time 'weeks'"),
        (("unit: m}", "}"), "position: no unit"),
        (("[x, y, z]", "[x, y]"), "3 names of columns"),
        (("columns: [x", "colums: [x"), "did you mean 'columns'"),
        (("time:", "world: SWU\ntime:"), "'SWU'"),
        (("time:", "world: [x, x, z]\ntime:"), "x, y and z once each"),
        (("time:", "world: [y, x, z]\ntime:"), "are mirrored"),
        (("time:", "turn_deg: [1, 2, .nan]\ntime:"), "turn_deg: nan"),
        (
            ("time:", "airframe: {mass: -1, arm_length: 1, rotor_radius: 1}\ntime:"),
            "airframe: mass: -1",
        ),
        (("time: {column: t, unit: ms}", "time: {unit: ms}"), "no column"),
        (("order: wxyz", "axes: [x, y, z]"), "for gyro and accel"),
        (("unit: m}", "unit: m, range: [0, 1]}"), "of motor_command"),
        (("channels:", "channels: 7\nx:"), "channels: 7|unknown key"),
    ],
)
def test_what_is_wrong_is_named(change, complaint):
    parse_mapping(GOOD, "lab")
    with pytest.raises(InputError, match=complaint.replace("[", r"\[")) as error:
        parse_mapping(GOOD.replace(*change), "lab")
    assert "\n" not in str(error.value)


def test_a_name_or_a_file_is_loaded(tmp_path):
    path = tmp_path / "lab.yaml"
    path.write_text(GOOD)
    assert load_mapping(path).name == "lab"
    assert load_mapping("nanobench").airframe.mass == 0.027
    with pytest.raises(InputError, match="did you mean 'nanobench'"):
        load_mapping("nanobenhc")
    with pytest.raises(InputError, match="does not exist"):
        load_mapping(tmp_path / "none.yaml")


@pytest.mark.parametrize(
    ("unit", "wanted", "value"),
    [
        ("rpm", "rad/s", 0.104719755), ("krpm", "rad/s", 104.719755),
        ("°/s", "rad/s", 0.0174532925), ("m/s²", "m/s^2", 1.0), ("G", "m/s^2", 9.80665),
        ("mg", "m/s^2", 0.00980665), ("mV", "V", 1e-3), ("µs", "s", 1e-6), ("%", "1", 0.01),
        ("ozf", "N", 0.0283495231 * 9.80665),
        ("kg cm", "N m", 0.0980665), ("lbf in", "N m", 0.45359237 * 9.80665 * 0.0254),
        ("ft", "m", 12 * 0.0254),
    ],
)  # fmt: skip
def test_a_unit_is_worth_what_its_standard_says_in_any_usual_spelling(unit, wanted, value):
    assert factor(unit, wanted, "a column") == pytest.approx(value, rel=1e-6)
