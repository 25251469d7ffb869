import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from independent_propeller import span_load

from tombo_dynamics.propeller import configuration
from tombo_dynamics.propeller.blade import rigid_integrals, wing, wing_integrals
from tombo_dynamics.propeller.laws.equilibrium import twisted

BLADE = configuration(13).blade
ANGLE = st.floats(-0.2, 1.0)


def test_ten_constants_of_the_nine_inch_blade() -> None:
    # Computed from the same polynomials by others.
    square = [
        8.804851e-6, 6.226288e-6, 6.141707e-6, 6.648973e-6, 5.688911e-6,
        4.064536e-6, 2.920150e-6, 2.783987e-6, 3.024277e-6, 2.674237e-6,
    ]  # fmt: skip
    cube = [
        7.080855e-7, 4.885858e-7, 5.071665e-7, 5.463607e-7, 4.448284e-7,
        3.163733e-7, 2.213414e-7, 2.233647e-7, 2.412724e-7, 2.019179e-7,
    ]  # fmt: skip
    assert wing_integrals(BLADE, 2, 0.035, 0.110) == pytest.approx(square, rel=3e-7)
    assert wing_integrals(BLADE, 3, 0.035, 0.110) == pytest.approx(cube, rel=3e-7)


def test_inner_and_rigid_constants() -> None:
    found = wing(BLADE)
    inner = (found.inner_thrust, found.inner_drag, found.inner_torque)
    assert inner == pytest.approx((3.187054e-7, 2.346986e-7, 6.57890e-9), rel=3e-7)
    whole = 1.2041 * np.array(rigid_integrals(BLADE, 0.015, 0.110))
    assert whole == pytest.approx((1.46146e-5, 8.2289e-6, 6.2522e-7), rel=1e-5)


@pytest.mark.parametrize("gamma", [-0.1, 0.0, 0.27, 0.5])
def test_closed_form_is_the_integral(gamma: float) -> None:
    found = wing(BLADE)
    for weights, rate, kind, power in (
        (found.lift, 2.13, "lift", 2),
        (found.drag, 2.04, "drag", 2),
        (found.torque, 2.04, "drag", 3),
    ):
        value, _ = twisted(weights, rate, gamma, math.sin(gamma), math.cos(gamma))
        assert value == pytest.approx(span_load(kind, power, 0.035, 0.110, gamma), rel=1e-9)


@settings(deadline=None)
@given(gamma=ANGLE)
def test_slope_is_the_derivative(gamma: float) -> None:
    found, h = wing(BLADE), 1e-5
    for weights, rate in ((found.lift, 2.13), (found.drag, 2.04), (found.torque, 2.04)):
        ahead, behind = (
            twisted(weights, rate, g, math.sin(g), math.cos(g))[0] for g in (gamma + h, gamma - h)
        )
        _, slope = twisted(weights, rate, gamma, math.sin(gamma), math.cos(gamma))
        difference = (ahead - behind) / (2.0 * h)
        assert slope == pytest.approx(difference, rel=1e-6, abs=1e-12 + 1e-7 * abs(weights).max())


def test_twist_limit_leaves_the_tip_at_the_lowest_measured_angle() -> None:
    tip_pitch = 19.65  # degrees, from the pitch polynomial at 110 mm
    assert math.degrees(wing(BLADE).twist_limit) == pytest.approx(tip_pitch + 9.0, abs=0.01)
