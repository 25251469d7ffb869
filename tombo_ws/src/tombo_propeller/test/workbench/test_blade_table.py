import numpy as np
import pytest

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM, Configuration, evaluate, read_library, with_nodus
from tombo_dynamics.propeller.blade import shape
from tombo_propeller.workbench.blade_table import blade_from_table, parse_blade_table, scaled_blade
from tombo_propeller.workbench.presets import APC_10X7, PRESETS, preset

PAPER = read_library().blades["nine_inch"]
GOOD = [(15, 14, 40), (40, 25, 30), (80, 20, 20), (110, 10, 15)]


def text_of(rows, head="r_mm, chord_mm, twist_deg"):
    return "\n".join([head, *(", ".join(map(str, row)) for row in rows)])


def test_the_papers_blade_typed_as_a_table_is_the_papers_blade():
    x = np.linspace(0.015, 0.110, 60)
    depth, pitch = shape(PAPER, x)
    rows = np.column_stack([1e3 * x, 1e3 * depth / np.cos(pitch), np.degrees(pitch)])
    text = "\n".join(",".join(f"{v:.6f}" for v in row) for row in rows)
    typed = blade_from_table("typed", parse_blade_table(text, 222.2), PAPER)
    assert typed.joint.wing_mass_kg == pytest.approx(PAPER.joint.wing_mass_kg, rel=2e-3)
    assert typed.joint.torsion_constant_m4 == pytest.approx(4.704e-9, rel=5e-3)
    speeds = np.array([2000.0, 6000.0, 10000.0]) * RPM
    for law in ("repaired", "consistent"):
        soft = [with_nodus(Configuration(99, blade), matrix="DragonSkin30", fibre="tendon",
                           fibres=5, fibre_diameter_mm=0.9, length_mm=12.0)
                for blade in (typed, PAPER)]  # fmt: skip
        a, b = (evaluate(c, speeds, law).thrust_N for c in soft)
        assert a == pytest.approx(b, rel=5e-3)


@pytest.mark.parametrize("inches", [5.0, 20.0])
def test_thrust_of_a_rigid_blade_goes_with_the_fourth_power_of_its_size(inches):
    scaled = scaled_blade("scaled", PAPER, 25.4 * inches)
    scale = 12.7e-3 * inches / PAPER.tip_radius_m
    a, b = (evaluate(Configuration(0, blade), 2000 * RPM) for blade in (scaled, PAPER))
    assert float(a.thrust_N) == pytest.approx(scale**4 * float(b.thrust_N), rel=1e-9)
    assert float(a.torque_Nm) == pytest.approx(scale**5 * float(b.torque_Nm), rel=1e-9)


def test_shares_of_the_radius_and_millimetres_are_the_same_blade():
    shares = parse_blade_table(APC_10X7, 254.0)
    rows = zip(1e3 * shares.radius_m, 1e3 * shares.chord_m, shares.twist_deg, strict=True)
    again = parse_blade_table(text_of(rows), 254.0)
    assert again.chord_m == pytest.approx(shares.chord_m)
    assert again.radius_m == pytest.approx(shares.radius_m)


@pytest.mark.parametrize("name", list(PRESETS))
def test_every_preset_gives_thrust(name):
    assert float(evaluate(Configuration(0, preset(name)), 2000 * RPM).thrust_N) > 0.05


@pytest.mark.parametrize(
    ("text", "diameter", "message"),
    [
        ("", None, "0 rows"),
        ("\0\0\0", None, "columns"),
        ("<script>alert(1)</script>", None, "columns"),
        (text_of(GOOD[:3]), None, "3 rows"),
        (text_of([(i + 1, 1, 1) for i in range(201)]), None, "201 rows"),
        (text_of([*GOOD[:2], (80, "nan", 20), GOOD[3]]), None, "row 3"),
        (text_of([*GOOD[:2], (80, "1e999", 20), GOOD[3]]), None, "row 3"),
        (text_of([*GOOD[:2], (80, 20), GOOD[3]]), None, "row 3"),
        (text_of([*GOOD[:2], GOOD[1], GOOD[3]]), None, "radius .* in row 3"),
        (text_of([*GOOD[:2], (80, -20, 20), GOOD[3]]), None, "chord .* in row 3"),
        (text_of([*GOOD[:2], (80, 20, 89.9), GOOD[3]]), None, "twist .* in row 3"),
        (text_of([(60, 14, 40), (80, 25, 30), (90, 20, 20), (110, 10, 15)]), None, "0.55 to 1.00"),
        (text_of(GOOD), 400.0, "0.55 of the tip"),
        (text_of(GOOD), 200.0, "up to the tip"),
        (text_of(GOOD), 1e6, "diameter_mm"),
        (text_of([(1e3 * r, c, t) for r, c, t in GOOD]), None, "diameter of the table"),
        (APC_10X7, None, "without a diameter"),
        (text_of(GOOD, "a, b, c"), None, "columns"),
        ("1 2 3\n" * 20_000, None, "too large"),
    ],
)
def test_what_is_no_blade_is_refused_by_name(text, diameter, message):
    with pytest.raises(InputError, match=message) as refused:
        blade_from_table("own", parse_blade_table(text, diameter), PAPER)
    assert "accepted" in str(refused.value) and len(str(refused.value)) < 400
