import dataclasses

import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM, evaluate, read_library
from tombo_propeller.workbench.curves import bench_force, propeller_curves
from tombo_propeller.workbench.propeller_choice import propeller_choice

LIBRARY = read_library()


def choice_of(**values):
    return propeller_choice(values, LIBRARY)


def panels_of(**values):
    return {p["name"]: p for p in propeller_curves(choice_of(**values), LIBRARY)["panels"]}


def test_without_values_it_is_configuration_13_with_what_was_measured_of_it():
    choice = choice_of()
    assert choice.configuration is LIBRARY.configurations[13]
    panels = panels_of()
    own = [r for r in panels["thrust_N"]["readings"] if r["chosen"]]
    assert [(r["value"], r["deviation"]) for r in own] == [(0.611, 0.06)]
    assert len(panels["thrust_N"]["readings"]) == 10
    assert sum("Table II:" in r["text"] for r in panels["collision_force_N"]["readings"]) == 6


@pytest.mark.parametrize("law", ["published", "repaired", "consistent"])
def test_curves_are_those_of_the_library(law):
    curves = propeller_curves(choice_of(), LIBRARY, 9000.0)
    direct = evaluate(13, np.array(curves["rpm"]) * RPM, law)
    for panel, values in (
        ("thrust_N", direct.thrust_N),
        ("torque_mNm", 1e3 * direct.torque_Nm),
        ("twist_deg", np.degrees(direct.gamma_rad)),
        ("lift_over_drag", direct.lift_over_drag),
    ):
        shown = next(p for p in curves["panels"] if p["name"] == panel)
        curve = next(c for c in shown["curves"] if c["name"] == law)
        shown = np.array(curve["values"], dtype=float)
        np.testing.assert_allclose(shown, values, rtol=1e-4, equal_nan=True)


def test_the_band_of_thrust_is_the_laws_own_error_at_2000_rpm():
    thrust = {c["name"]: c for c in panels_of()["thrust_N"]["curves"]}["repaired"]
    at = len(thrust["values"]) // 2
    assert thrust["high"][at] / thrust["values"][at] - 1.0 == pytest.approx(0.085, abs=0.001)
    assert thrust["low"][at] / thrust["values"][at] - 1.0 == pytest.approx(-0.085, abs=0.001)


def test_a_nodus_that_was_not_measured_gets_the_mean_force_and_its_interval():
    value, low, high, known = bench_force(choice_of(fibres=8), LIBRARY)
    assert (value, known) == (pytest.approx(127.2, abs=0.1), "modelled")
    assert high == pytest.approx(182.5, abs=1.0)
    assert bench_force(choice_of(), LIBRARY)[0] == 145.5
    assert low < value < high


def test_of_another_blade_nothing_is_called_measured():
    own = dataclasses.replace(LIBRARY.blades["nine_inch"], name="own", published=None)
    library = dataclasses.replace(LIBRARY, blades={**LIBRARY.blades, "own": own})
    curves = propeller_curves(propeller_choice({"blade": "own"}, library), library)
    assert not any(panel["readings"] for panel in curves["panels"])
    assert "extrapolated" in next(p for p in curves["panels"] if p["name"] == "thrust_N")["known"]
    assert list(curves["refused"]) == ["published"]


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"blade": "../../etc/passwd"}, "blade"),
        ({"blade": ["x"]}, "blade"),
        ({"matrix": "steel"}, "matrix"),
        ({"fibres": 2.5}, "fibres"),
        ({"fibres": True}, "fibres"),
        ({"length_mm": float("nan")}, "length_mm"),
        ({"length_mm": 34.0}, "nodus from"),
        ({"outer_radius_mm": 140.0}, "nodus from"),
        ({"soft": "yes"}, "soft"),
        ({"wings": 3}, "wings"),
    ],
)
def test_what_is_no_propeller_is_refused_by_name(values, message):
    with pytest.raises(InputError, match=message) as refused:
        propeller_curves(choice_of(**values), LIBRARY)
    assert "accepted" in str(refused.value) or "is not a number from" in str(refused.value)
