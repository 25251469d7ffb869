import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.propeller import (
    LAWS,
    SCALARS,
    SPEED_LIMIT,
    Surroundings,
    configuration,
    configurations,
    evaluate,
    evaluate_rows,
    nodus_moduli,
    parameter_row,
    rotor_inertia,
    speed_of_maximum_thrust,
    valid_speed,
)

RPM = 30.0 / math.pi
SOFT = [c for c in configurations() if not c.rigid]
WEIGHTLESS = Surroundings(gravity_m_s2=0.0)
COMPLIANCES = [SCALARS[f"{name}_compliance"] for name in ("flap", "lag", "twist")]
EACH_LAW = pytest.mark.parametrize("law", LAWS)


@pytest.mark.slow
@EACH_LAW
@settings(deadline=None)
@given(factor=st.floats(0.05, 0.95), rpm=st.floats(1500.0, 4500.0))
def test_more_compliance_gives_less_thrust(law: str, factor: float, rpm: float) -> None:
    soft = parameter_row(configuration(1), law)
    stiff = soft.copy()
    stiff[COMPLIANCES] *= factor
    thrust = evaluate_rows(np.stack([soft, stiff]), rpm / RPM, law).thrust_N
    assert thrust[0] < thrust[1] < evaluate(configuration(0), rpm / RPM).thrust_N


@pytest.mark.slow
@EACH_LAW
@settings(deadline=None)
@given(conf=st.integers(1, 13), factor=st.floats(0.2, 5.0), share=st.floats(0.05, 0.95))
def test_without_weight_only_speed_squared_over_stiffness_counts(
    law: str, conf: int, factor: float, share: float
) -> None:
    row = parameter_row(configuration(conf), law, WEIGHTLESS)
    scaled = row.copy()
    scaled[COMPLIANCES] *= factor
    speed = share * min(600.0, SPEED_LIMIT * math.sqrt(factor))
    one, other = evaluate_rows(row, speed, law), None
    other = evaluate_rows(scaled, speed / math.sqrt(factor), law)
    if not one.valid:
        assert not other.valid
        return
    for name in ("alpha_rad", "beta_rad", "gamma_rad", "lift_over_drag"):
        assert getattr(other, name) == pytest.approx(getattr(one, name), rel=1e-9, abs=1e-12)
    assert other.thrust_N * factor == pytest.approx(one.thrust_N, rel=1e-9)


@pytest.mark.parametrize("chosen", SOFT, ids=lambda c: f"conf{c.number}")
def test_maximum_of_thrust_without_weight(chosen) -> None:
    shear = nodus_moduli(chosen).G_N_MPa * 1e6
    top, exists = speed_of_maximum_thrust(chosen, "repaired", WEIGHTLESS)
    point = evaluate(chosen, top, "repaired", WEIGHTLESS)
    assert exists
    assert top == pytest.approx(2.2645 * math.sqrt(shear), rel=1e-3)
    assert float(point.thrust_N) == pytest.approx(3.431e-5 * shear, rel=1e-3)
    assert math.degrees(point.gamma_rad) == pytest.approx(15.47, abs=0.02)


def test_figures_of_conf_13() -> None:
    top, _ = speed_of_maximum_thrust(configuration(13))
    assert top * RPM == pytest.approx(11226.0, abs=1.0)
    assert float(evaluate(configuration(13), top).thrust_N) == pytest.approx(9.25, abs=0.005)


def test_consistent_twist_saturates_and_thrust_has_no_maximum() -> None:
    for chosen in SOFT:
        top, exists = speed_of_maximum_thrust(chosen, "consistent")
        assert (top, exists) == (SPEED_LIMIT, False)
        twist = evaluate(chosen, SPEED_LIMIT * np.array([0.8, 1.0]), "consistent").gamma_rad
        assert math.degrees(twist[1]) == pytest.approx(4.6, abs=0.1)
        assert math.degrees(twist[1] - twist[0]) < 0.15


@EACH_LAW
def test_rigid_propeller_is_exactly_quadratic(law: str) -> None:
    speeds = np.linspace(0.0, SPEED_LIMIT / 2.0, 50)
    once, twice = (evaluate(configuration(0), k * speeds, law) for k in (1.0, 2.0))
    for name in ("thrust_N", "drag_N", "torque_Nm"):
        assert (getattr(twice, name) == 4.0 * getattr(once, name)).all()
    assert np.ptp(once.lift_over_drag) == 0.0
    assert not once.alpha_rad.any() and not once.beta_rad.any() and not once.gamma_rad.any()


@EACH_LAW
@pytest.mark.parametrize("conf", [1, 5, 9, 13])
def test_continuous_along_speed(conf: int, law: str) -> None:
    chosen = configuration(conf)
    speeds = np.linspace(0.0, valid_speed(chosen, law), 4001)
    points = evaluate(chosen, speeds, law)
    for name in ("alpha_rad", "beta_rad", "gamma_rad"):
        angle = getattr(points, name)
        assert np.abs(np.diff(angle)).max() < 2e-3
        assert np.abs(np.diff(angle, 2)).max() < 2e-5


@EACH_LAW
def test_at_rest_the_wing_hangs_by_its_weight_alone(law: str) -> None:
    rest = evaluate(configuration(1), 0.0, law)
    assert (float(rest.thrust_N), float(rest.torque_Nm)) == (0.0, 0.0)
    assert float(rest.beta_rad) < 0.0
    assert math.isfinite(float(rest.lift_over_drag))
    floating = evaluate(configuration(1), 0.0, law, WEIGHTLESS)
    assert float(floating.beta_rad) == pytest.approx(0.0, abs=1e-15)


def test_rotor_inertia_by_part() -> None:
    found = rotor_inertia(configuration(13).blade)
    points = 2 * 5.715e-3 * 0.06664**2  # two point masses at the published centroid
    rods = 2 * 5.715e-3 * 0.075**2 / 12.0  # at most as spread out as rods over 35-110 mm
    assert points < found.wings < points + rods
    assert 0.0 < found.roots < 0.1 * found.wings
    assert found.total == found.wings + found.roots + found.bell
