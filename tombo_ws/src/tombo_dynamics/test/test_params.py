"""Parameter records: accepted and refused values, and the message."""

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_number, from_mapping, param, validate
from tombo_dynamics.propeller import configuration
from tombo_dynamics.propeller.blade import rotor_inertia
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES, SPIN, VehicleParams

FIELDS = {f.name: f for f in dataclasses.fields(VehicleParams)}


@dataclasses.dataclass(frozen=True)
class Example:
    length: float = param(1.0, "m", (-2.0, 3.0), "how long")
    count: int = param(4, "1", (0, 9), "how many")
    name: str = "x"


@pytest.mark.parametrize("name", FIELDS)
def test_every_vehicle_parameter_says_unit_bounds_meaning_and_source(name):
    meta = FIELDS[name].metadata
    low, high = meta["bounds"]
    assert meta["unit"] and meta["doc"]
    assert meta["source"], f"{name}: a source, or 'estimated, because ...'"
    assert math.isfinite(low) and math.isfinite(high)
    assert low <= FIELDS[name].default <= high


@given(
    st.sampled_from(sorted(FIELDS)),
    st.one_of(
        st.floats(1e-6, 1e6), st.floats(-1e6, -1e-6),
        st.sampled_from([math.nan, math.inf, -math.inf]),
    ),
)  # fmt: skip
def test_everything_beyond_bounds_is_refused_in_one_line(name, beyond):
    low, high = FIELDS[name].metadata["bounds"]
    value = beyond if not math.isfinite(beyond) else (high if beyond > 0 else low) + beyond
    with pytest.raises(InputError) as caught:
        from_mapping(VehicleParams, {name: value}, "vehicle")
    message = str(caught.value)
    assert f"vehicle.{name}" in message
    assert f"from {low:g} to {high:g}" in message
    assert FIELDS[name].metadata["unit"] in message
    assert "\n" not in message
    with pytest.raises(InputError, match=f"vehicle.{name}"):
        validate(dataclasses.replace(VehicleParams(), **{name: value}), "vehicle")


@pytest.mark.parametrize(
    ("given", "words"),
    [
        *(({"mass": value}, r"vehicle\.mass") for value in ("1.3", None, True, [1.3], 1j)),
        ({"mass": 10**400}, r"vehicle\.mass: 1000.* is out of bounds"),
        ({"masss": 1.0}, r"key in vehicle 'masss' \(did you mean 'mass'\?\)"),
        *((given, "expected a mapping") for given in (None, 3, "mass", [1.0])),
    ],
)
def test_what_is_no_record_is_refused(given, words):
    with pytest.raises(InputError, match=words):
        from_mapping(VehicleParams, given, "vehicle")


def test_a_name_that_is_meant_is_proposed_only_where_there_is_one():
    assert "did you mean" not in str(unknown_name("key", "zzz", ["mass"]))
    assert "did you mean 'course'" in str(unknown_name("key", "waypoints", ["course", "way"]))
    assert "'course'" not in str(unknown_name("key", "waypoints", ["land_time"]))


def test_whole_numbers_stay_whole():
    assert from_mapping(Example, {"count": 5.0}, "example").count == 5
    assert isinstance(from_mapping(Example, {"count": 5.0}, "example").count, int)
    with pytest.raises(InputError, match=r"example\.count: 5\.5 is not a whole number"):
        from_mapping(Example, {"count": 5.5}, "example")
    assert check_number("n", 3, "1", (0.0, 5.0)) == 3.0


# --- the vehicle ----------------------------------------------------------------------------


def test_rotors_stand_where_their_names_say():
    for name, x, y in zip(ROTOR_NAMES, ARM_X, ARM_Y, strict=True):
        assert ("front" in name) == (x > 0.0)
        assert ("left" in name) == (y > 0.0)
        assert math.hypot(x, y) == pytest.approx(1.0)


def test_neighbours_turn_against_each_other():
    """Then drag torques cancel in hover, and yaw is free of roll and pitch."""
    assert SPIN.sum() == 0.0
    assert pytest.approx([0.0, 0.0]) == [SPIN @ ARM_X, SPIN @ ARM_Y]
    assert set(SPIN) == {-1.0, 1.0}
    front_right_and_rear_left = SPIN[[0, 1]]
    assert (front_right_and_rear_left == 1.0).all()  # PX4's quad-x: 1 and 2 counter-clockwise


def test_the_defaults_agree_with_where_they_come_from(vehicle):
    blade = configuration(13).blade
    assert vehicle.rotor_inertia == pytest.approx(rotor_inertia(blade).total, rel=0.02)
    drive_units = 0.085 * vehicle.arm_length**2
    assert 2.0 * drive_units < vehicle.inertia_xx < 4.0 * drive_units
    assert 4.0 * drive_units < vehicle.inertia_zz < vehicle.inertia_xx + vehicle.inertia_yy
    assert 1.2 <= vehicle.mass <= 1.5
