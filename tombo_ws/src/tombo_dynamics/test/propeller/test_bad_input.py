import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tombo_dynamics import propeller
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import (
    SPEED_LIMIT,
    configuration,
    evaluate,
    evaluate_rows,
    nodus_moduli,
    parameter_row,
    read_library,
    valid_speed,
)
from tombo_dynamics.propeller.library import DATA


@pytest.mark.parametrize("speed", [math.nan, -1.0, math.inf, 1.001 * SPEED_LIMIT, "fast"])
@pytest.mark.parametrize("law", ["published", "repaired", "consistent"])
def test_speeds_that_no_law_takes(speed: object, law: str) -> None:
    with pytest.raises(InputError, match=r"accepted: 0 to 1885\.0 rad/s \(18000 rpm\)"):
        evaluate(configuration(0), [10.0, speed], law)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["published", "repaired"])
def test_speed_beyond_validity_names_the_valid_range(law: str) -> None:
    chosen = configuration(1)
    limit = valid_speed(chosen, law)
    evaluate(chosen, limit, law)
    with pytest.raises(InputError) as error:
        evaluate(chosen, [100.0, 1.01 * limit], law)
    assert f"{limit:.6g} rad/s" in str(error.value)
    assert "configuration 1" in str(error.value)
    masked = evaluate(chosen, [100.0, 1.01 * limit], law, outside="mask")
    assert masked.valid.tolist() == [True, False]
    assert np.isnan(masked.thrust_N[1])
    kept = evaluate(chosen, [100.0, 1.01 * limit], law, outside="keep")
    assert kept.valid.tolist() == [True, False]
    assert np.isfinite(kept.thrust_N[1])


def test_unknown_names() -> None:
    with pytest.raises(InputError, match="did you mean 'repaired'"):
        evaluate(configuration(13), 100.0, "repared")
    with pytest.raises(InputError, match="outside 'ignore'"):
        evaluate(configuration(13), 100.0, outside="ignore")
    for number in (14, -1, True):
        with pytest.raises(InputError, match=r"accepted: 0, 1, .*, 13"):
            configuration(number)
    with pytest.raises(InputError, match="rigid"):
        nodus_moduli(configuration(0))


def test_rows_of_another_kind() -> None:
    row = parameter_row(configuration(13), "repaired")
    for rows in (row[:-1], np.full_like(row, math.nan), 3.0):
        with pytest.raises(InputError, match="accepted: finite rows"):
            evaluate_rows(rows, 100.0)
    with pytest.raises(InputError, match="broadcast"):
        evaluate_rows(np.stack([row, row]), [1.0, 2.0, 3.0])


def test_a_row_is_a_copy() -> None:
    before = evaluate(configuration(13), 300.0).thrust_N
    parameter_row(configuration(13), "repaired")[:] = 0.0
    assert evaluate(configuration(13), 300.0).thrust_N == before


def write(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder


def test_own_configuration_beside_the_papers(tmp_path: Path) -> None:
    write(
        tmp_path,
        "materials.yaml",
        "matrices: {Stiff: {poisson_ratio: 0.45, strain_percent: [1, 2, 3, 4, 5],"
        " secant_modulus_MPa: [2.0, 2.0, 2.0, 2.0, 2.0]}}",
    )
    row = "{conf: 20, blade: nine_inch, matrix: Stiff, fibre: tendon, fibres: 4,"
    write(tmp_path, "configurations.yaml", f"- {row} fibre_diameter_mm: 0.5, length_mm: 8}}")
    library = read_library(tmp_path)
    assert set(library.configurations) == {*range(14), 20}
    own = library.configurations[20]
    assert nodus_moduli(own).E_N_MPa > nodus_moduli(configuration(3)).E_N_MPa
    assert evaluate(own, 400.0).thrust_N > evaluate(configuration(3), 400.0).thrust_N


ROW = "{conf: 20, blade: nine_inch, matrix: DragonSkin10, fibre: tendon, fibres: 4, "


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("configurations.yaml", f"- {ROW}length_mm: 8}}", "no fibre_diameter_mm"),
        (
            "configurations.yaml",
            f"- {ROW}fibre_diameter_mm: .nan, length_mm: 8}}",
            "fibre_diameter_mm: nan",
        ),
        (
            "configurations.yaml",
            f"- {ROW}fibre_diameter_mm: 0.5, length_mm: -8}}",
            "length_mm: -8",
        ),
        ("configurations.yaml", f"- {ROW}fibre_diametre_mm: 0.5}}", "did you mean 'fibre_diamet"),
        ("configurations.yaml", "- {conf: 20, blade: ten_inch}", "unknown blade"),
        ("configurations.yaml", "- {conf: x, blade: nine_inch}", "conf 'x'"),
        ("configurations.yaml", "a: b: c", "line 1: mapping"),
        ("configurations.yaml", "a: 1", "no list"),
        ("materials.yaml", "fibers: {}", "did you mean 'fibres'"),
        ("materials.yaml", "fibres: {x: {youngs_modulus_MPa: 1}}", "no shear_modulus_MPa"),
        (
            "materials.yaml",
            "matrices: {x: {poisson_ratio: 0.4, strain_percent: [1, 2, 3], "
            "secant_modulus_MPa: [1, 1, 1]}}",
            "4 or more",
        ),
        ("blades.yaml", "x: 3", "a mapping"),
    ],
)
def test_data_that_does_not_fit(tmp_path: Path, name: str, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message) as error:
        read_library(write(tmp_path, name, text))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("start_m: 0.030", "start_m: 0.031", "accepted: pieces that join"),
        ("outer_radius_m: 0.035", "outer_radius_m: 0.2", "outside of the blade"),
        ("lift_mean: 0.225", "lift_mean: big", "lift_mean: 'big'"),
        ("thickness_mm: [6.2, 6.2,", "thickness_mm: [6.2,", "one thickness a station"),
    ],
)
def test_blades_that_do_not_fit(tmp_path: Path, old: str, new: str, message: str) -> None:
    text = (DATA / "blades.yaml").read_text()
    assert old in text
    with pytest.raises(InputError, match=message):
        read_library(write(tmp_path, "blades.yaml", text.replace(old, new)))


def test_law_published_is_for_the_papers_blade_only(tmp_path: Path) -> None:
    text = (DATA / "blades.yaml").read_text()
    start, end = text.index("  # Only the law `published`"), text.index("  # Table II")
    library = read_library(write(tmp_path, "blades.yaml", text[:start] + text[end:]))
    other = library.configurations[13]
    assert evaluate(other, 300.0, "repaired").valid
    with pytest.raises(InputError, match="accepted: law repaired or consistent"):
        evaluate(other, 300.0, "published")


def test_a_number_stands_for_a_configuration_everywhere() -> None:
    own = configuration(13)
    assert propeller.valid_speed(13) == valid_speed(own)
    assert propeller.nodus_moduli(13) == nodus_moduli(own)
    assert propeller.thrust_map(13) is propeller.thrust_map(own)
    assert propeller.speed_of_maximum_thrust(13) == propeller.speed_of_maximum_thrust(own)
    assert np.array_equal(parameter_row(13, "repaired"), parameter_row(own, "repaired"))
    assert propeller.with_nodus(13, fibres=8).nodus == propeller.with_nodus(own, fibres=8).nodus
    assert propeller.with_joint(13, lift_arm_mm=1.0) == propeller.with_joint(own, lift_arm_mm=1.0)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: propeller.nodus_moduli(0), "rigid"),
        (lambda: propeller.valid_speed(77), "unknown configuration 77"),
        (lambda: propeller.valid_speed([13]), r"unknown configuration \[13\]"),
        (lambda: propeller.valid_speed(13, ["repaired"]), "unknown law"),
        (lambda: propeller.thrust_map("13"), "unknown configuration '13'"),
        (lambda: propeller.with_nodus(None, fibres=8), "unknown configuration None"),
        (lambda: propeller.with_nodus(13, foo=1), "'foo'.*accepted: .*length_mm"),
        (lambda: propeller.with_section("x", lift_mean=1.0), "unknown configuration 'x'"),
        (lambda: propeller.rotor_inertia("nine_inch"), "'nine_inch'; accepted: a Blade"),
        (lambda: propeller.evaluate(13, 100.0, surroundings=3), "surroundings 3; accepted"),
        (lambda: propeller.thrust_map(13, surroundings=[3]), r"surroundings \[3\]; accepted"),
        (lambda: propeller.read_library(3), "folder 3; accepted: a path"),
        (lambda: propeller.evaluate(13, None), "speed None is not a number; accepted"),
        (lambda: propeller.evaluate(13, [1.0, None]), "speed .1.0, None. is not a number"),
        (lambda: propeller.evaluate(13, [1, 2], length_mm=[8, 9, 10]),
         r"speed_rad_s \(2,\), length_mm \(3,\); accepted: shapes that broadcast"),
        (lambda: propeller.speed_for_thrust(13, [1, 2], length_mm=[8, 9, 10]),
         r"thrust_N \(2,\), length_mm \(3,\); accepted: shapes that broadcast"),
    ],
)  # fmt: skip
def test_python_type_errors_are_input_errors(call: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()
