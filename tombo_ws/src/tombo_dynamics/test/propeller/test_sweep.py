import csv
import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.propeller import (
    LAWS,
    RPM,
    SCALARS,
    Surroundings,
    configuration,
    configurations,
    evaluate,
    nodus_moduli,
    parameter_row,
    parameter_rows,
    speed_for_thrust,
    speed_of_maximum_thrust,
    sweep,
    thrust_peak,
    with_joint,
    with_nodus,
    with_section,
)

SPEEDS = np.array([100.0, 300.0, 450.0])


@pytest.mark.slow
@settings(deadline=None)
@given(
    matrix=st.sampled_from(["DragonSkin10", "DragonSkin20", "DragonSkin30"]),
    fibres=st.integers(0, 9),
    diameter=st.floats(0.2, 1.2),
    length=st.floats(4.0, 20.0),
    radius=st.floats(0.025, 0.07),
    law=st.sampled_from(["repaired", "consistent"]),
)
def test_changed_quantities_are_a_derived_configuration(
    matrix: str, fibres: int, diameter: float, length: float, radius: float, law: str
) -> None:
    changes = {"matrix": matrix, "fibres": fibres, "fibre_diameter_mm": diameter}
    changes |= {"length_mm": length, "outer_radius_m": radius}
    derived = with_nodus(configuration(13), **changes)
    rows = parameter_rows([13, 5], law, **changes)
    for row in rows:
        np.testing.assert_allclose(row, parameter_row(derived, law), rtol=1e-12, atol=1e-300)


@pytest.mark.parametrize("law", LAWS)
def test_joint_section_and_surroundings_by_name(law: str) -> None:
    soft = with_joint(configuration(13), wing_mass_kg=0.007, lift_arm_mm=2.0)
    thin = Surroundings(air_density_kg_m3=1.0)
    one = evaluate(soft, SPEEDS, law, thin)
    other = evaluate(13, SPEEDS, law, wing_mass_kg=0.007, lift_arm_mm=2.0, air_density_kg_m3=1.0)
    np.testing.assert_allclose(one.thrust_N, other.thrust_N, rtol=1e-12)
    assert (one.thrust_N != evaluate(13, SPEEDS, law).thrust_N).all()
    more = with_section(configuration(0), lift_mean=0.325)
    assert evaluate(more, 300.0, law).thrust_N > evaluate(0, 300.0, law).thrust_N


def test_moduli_in_place_of_what_they_come_from() -> None:
    moduli = nodus_moduli(configuration(5))
    got = parameter_rows(13, E_N_MPa=moduli.E_N_MPa, G_N_MPa=moduli.G_N_MPa)
    np.testing.assert_allclose(got, parameter_row(configuration(5), "repaired"), rtol=1e-12)
    stiff = parameter_rows(13, twist_compliance=[0.0, 1.0])
    assert stiff[:, SCALARS["twist_compliance"]].tolist() == [0.0, 1.0]


def test_wing_further_out_is_lighter_and_carries_less() -> None:
    base = configuration(13)
    radii = [0.030, 0.035, 0.045, 0.060]
    moved = [with_nodus(base, outer_radius_m=r).blade.joint for r in radii]
    assert (np.diff([joint.wing_mass_kg for joint in moved]) < 0.0).all()
    assert (np.diff([joint.wing_centroid_m for joint in moved]) > 0.0).all()
    assert moved[1].wing_mass_kg == pytest.approx(base.blade.joint.wing_mass_kg, rel=1e-12)
    thrust = evaluate(13, 400.0, outer_radius_m=radii).thrust_N
    assert (np.diff(thrust) > 0.0).all()  # less of it bends away
    assert thrust[-1] < float(evaluate(0, 400.0).thrust_N)


def test_grid_has_an_axis_for_each_list() -> None:
    grid = sweep([5, 13], SPEEDS, length_mm=[8.0, 12.0], matrix=["DragonSkin10", "DragonSkin30"])
    assert grid.thrust_N.shape == (2, 2, 2, 3)
    assert list(grid.axes) == ["configuration", "length_mm", "matrix", "speed_rad_s"]
    alone = evaluate(5, SPEEDS[2], length_mm=12.0, matrix="DragonSkin30")
    assert grid.thrust_N[0, 1, 1, 2] == pytest.approx(float(alone.thrust_N), rel=1e-12)
    assert sweep(13, SPEEDS, fibres=4).thrust_N.shape == (3,)
    assert sweep(13, 300.0).thrust_N.shape == ()


def test_table_and_csv_hold_every_point_with_its_axes() -> None:
    grid = sweep([1, 13], np.array([1000.0, 8000.0]) * RPM, matrix=["DragonSkin10"])
    rows = list(csv.DictReader(io.StringIO(grid.csv(note="x"))))
    axes = [(row["configuration"], row["matrix"], row["note"]) for row in rows]
    assert axes == [(n, "DragonSkin10", "x") for n in ("1", "1", "13", "13")]
    assert [round(float(row["speed_rpm"])) for row in rows] == [1000, 8000, 1000, 8000]
    assert [row["valid"] for row in rows] == ["true", "false", "true", "false"]
    assert rows[1]["thrust_N"] == ""
    assert float(rows[0]["thrust_N"]) == grid.thrust_N[0, 0, 0]
    assert {len(column) for column in grid.table().values()} == {4}


@pytest.mark.parametrize("law", LAWS)
def test_peak_of_all_is_the_peak_of_each(law: str) -> None:
    peak = thrust_peak(configurations(), law)
    for chosen in configurations():
        top, exists = speed_of_maximum_thrust(chosen, law)
        assert peak.has_maximum[chosen.number] == exists
        assert peak.speed_rad_s[chosen.number] == pytest.approx(top, rel=1e-9)
    assert peak.valid_further.all()


def test_peak_that_the_law_does_not_reach() -> None:
    narrow = thrust_peak(13, twist_limit=[0.1, 0.5])
    assert narrow.has_maximum.tolist() == [False, True]
    assert narrow.valid_further.tolist() == [False, True]
    assert 0.0 < narrow.gamma_rad[0] <= 0.1
    assert narrow.gamma_rad[0] == pytest.approx(0.1, abs=1e-4)


@pytest.mark.slow
@settings(deadline=None)
@given(conf=st.integers(0, 13), law=st.sampled_from(list(LAWS)), shares=st.lists(st.floats(0, 1)))
def test_speed_for_thrust_and_back(conf: int, law: str, shares: list[float]) -> None:
    most = float(thrust_peak(conf, law).thrust_N)
    thrust = most * np.array([0.0, 1.0, *shares])
    speed = speed_for_thrust(conf, thrust, law)
    back = evaluate(conf, speed, law, outside="keep").thrust_N
    np.testing.assert_allclose(back, thrust, rtol=1e-11, atol=1e-300)
    assert (np.diff(speed[np.argsort(thrust)]) >= -1e-6).all()


def test_thrust_out_of_reach() -> None:
    masked = speed_for_thrust([13, 1], 3.0, outside="mask")
    assert np.isnan(masked).tolist() == [False, True]
    kept = speed_for_thrust([13, 1], 3.0, outside="keep")
    assert kept[1] == pytest.approx(speed_of_maximum_thrust(configuration(1))[0])


def test_derived_configurations_leave_measurements_behind() -> None:
    own = with_nodus(configuration(13), fibres=np.int64(8), length_mm=10)
    assert own.measured is None
    assert own.printed_G_N_MPa is None
    assert own.label == "configuration 13, fibres 8, length_mm 10"
    assert with_nodus(configuration(13)) is configuration(13)
    nodus = {"matrix": "DragonSkin30", "fibre": "tendon", "fibres": 5, "fibre_diameter_mm": 0.9}
    soft = with_nodus(configuration(0), **nodus, length_mm=12.0)
    assert evaluate(soft, 300.0).thrust_N == evaluate(13, 300.0).thrust_N
