import math

import pytest
from independent_propeller import span_load

from tombo_dynamics.propeller import configuration
from tombo_dynamics.propeller.blade import wing
from tombo_dynamics.propeller.laws.equilibrium import twisted

BLADE = configuration(13).blade


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


def test_twist_limit_leaves_the_tip_at_the_lowest_measured_angle() -> None:
    tip_pitch = 19.65  # degrees, from the pitch polynomial at 110 mm
    assert math.degrees(wing(BLADE).twist_limit) == pytest.approx(tip_pitch + 9.0, abs=0.01)
