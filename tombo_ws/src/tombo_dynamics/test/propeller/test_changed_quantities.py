"""Quantities changed by name, and the peak of thrust."""

import numpy as np
import pytest

from tombo_dynamics.propeller import (
    LAWS,
    SCALARS,
    Surroundings,
    configuration,
    configurations,
    evaluate,
    nodus_moduli,
    parameter_row,
    parameter_rows,
    speed_of_maximum_thrust,
    thrust_peak,
)
from tombo_dynamics.propeller.blade import wing_mass_from
from tombo_dynamics.propeller.thrust_map import peak_of_rows

SPEEDS = np.array([100.0, 300.0, 450.0])


def test_moduli_in_place_of_what_they_come_from() -> None:
    moduli = nodus_moduli(configuration(5))
    got = parameter_rows(13, E_N_MPa=moduli.E_N_MPa, G_N_MPa=moduli.G_N_MPa)
    np.testing.assert_allclose(got, parameter_row(configuration(5), "repaired"), rtol=1e-12)
    stiff = parameter_rows(13, twist_compliance=[0.0, 1.0])
    assert stiff[:, SCALARS["twist_compliance"]].tolist() == [0.0, 1.0]


def test_changes_of_joint_air_and_materials_move_the_thrust_as_physics_says() -> None:
    base = evaluate(13, SPEEDS).thrust_N
    thin = evaluate(13, SPEEDS, air_density_kg_m3=1.0).thrust_N
    np.testing.assert_array_equal(
        thin, evaluate(13, SPEEDS, surroundings=Surroundings(air_density_kg_m3=1.0)).thrust_N
    )
    assert (thin < base).all()
    stiff = evaluate(13, SPEEDS, fibres=9).thrust_N
    rigid = evaluate(0, SPEEDS).thrust_N
    assert (np.abs(stiff - rigid) < np.abs(base - rigid)).all()
    soft = evaluate(13, SPEEDS, matrix="DragonSkin10").thrust_N
    assert (np.abs(soft - rigid) > np.abs(base - rigid)).all()


def test_wing_further_out_is_lighter_and_carries_less() -> None:
    blade = configuration(13).blade
    radii = np.array([0.030, 0.035, 0.045, 0.060])
    mass, centroid = wing_mass_from(blade, radii)
    assert (np.diff(mass) < 0.0).all() and (np.diff(centroid) > 0.0).all()
    assert mass[1] == pytest.approx(blade.joint.wing_mass_kg, rel=1e-12)
    thrust = evaluate(13, 400.0, outer_radius_m=radii).thrust_N
    assert (np.diff(thrust) > 0.0).all()  # less of it bends away
    assert thrust[-1] < float(evaluate(0, 400.0).thrust_N)


@pytest.mark.parametrize("law", LAWS)
def test_peak_of_all_is_the_peak_of_each(law: str) -> None:
    rows = np.stack([parameter_row(c, law) for c in configurations()])
    peak = peak_of_rows(rows, law)
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
