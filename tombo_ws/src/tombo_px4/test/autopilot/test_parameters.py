"""The table of parameters: PX4's names and types, refused values, kept values."""

import math

import pytest

from tombo_px4.autopilot.parameters import PARAMETERS, ParameterTable


def test_every_parameter_has_a_default_within_its_bounds_and_a_meaning():
    for p in PARAMETERS:
        assert p.low <= p.default <= p.high, p.name
        assert len(p.doc) > 8 and "\n" not in p.doc, p.name
        assert p.kind == "float" or all(v == int(v) for v in (p.default, p.low, p.high)), p.name


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("NO_SUCH_ONE", 1.0, "unknown"),
        ("EKF2_EV_CTRL", 1.5, "whole"),
        ("EKF2_EV_CTRL", 16, "out of bounds 0 to 15"),
        ("MPC_XY_VEL_MAX", -0.1, "out of bounds 0 to 20"),
        ("MPC_XY_VEL_MAX", math.nan, "no number"),
        ("EKF2_EV_CTRL", math.inf, "no number"),
    ],
)
def test_what_is_refused_changes_nothing(name, value, why):
    table = ParameterTable()
    before = {n: table.get(n) for n in table.names}
    assert why in table.set(name, value)
    assert {n: table.get(n) for n in table.names} == before
