"""Bad input of the propeller is refused in one line, with its name and the accepted values."""

import math
from collections.abc import Callable
from dataclasses import replace
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
    thrust_map,
    valid_speed,
)
from tombo_dynamics.propeller.effects import check_stand_theta
from tombo_dynamics.propeller.library import DATA

ROW = parameter_row(configuration(13), "repaired")
FILLED = replace(configuration(13), nodus=replace(configuration(13).nodus, fibres=500))
CALLS = [
    *((lambda s=s: evaluate(0, [10.0, s]), r"accepted: 0 to 1885\.0 rad/s \(18000 rpm\)")
      for s in (math.nan, -1.0, 1.001 * SPEED_LIMIT, "fast", None)),
    (lambda: evaluate(13, 100.0, "repared"), "did you mean 'repaired'"),
    (lambda: evaluate(13, 100.0, outside="ignore"), "outside 'ignore'; accepted"),
    (lambda: evaluate(13, 100.0, surroundings=3), "surroundings 3; accepted"),
    *((lambda n=n: configuration(n), r"accepted: 0, 1, .*, 13") for n in (14, -1, True)),
    *((lambda rows=rows: evaluate_rows(rows, 100.0), "accepted: finite rows")
      for rows in (ROW[:-1], np.full_like(ROW, math.nan), 3.0)),
    (lambda: evaluate_rows(np.stack([ROW, ROW]), [1.0, 2.0, 3.0]), "broadcast"),
    (lambda: nodus_moduli(0), "rigid"),
    (lambda: nodus_moduli(FILLED), "fill the nodus' section"),
    (lambda: valid_speed([13]), r"unknown configuration \[13\].*accepted"),
    (lambda: valid_speed(13, ["repaired"]), "unknown law.*accepted"),
    (lambda: thrust_map("13"), "unknown configuration '13'.*accepted"),
    *((lambda w=w: thrust_map(13).thrust([1.0, w]), "accepted: 0 to") for w in (-1.0, math.nan)),
    (lambda: propeller.rotor_inertia("nine_inch"), "'nine_inch'; accepted: a Blade"),
    (lambda: check_stand_theta({"thrust_gian": {}}, "x"), "thrust_gain"),
    (lambda: check_stand_theta({"thrust_gain": {"error": 9.0}}, "x"), r"from -0\.6 to 1\.5"),
    (lambda: check_stand_theta({"thrust_gain": 3}, "x"), "accepted: a mapping|mapping"),
]  # fmt: skip


@pytest.mark.parametrize(("call", "words"), CALLS, ids=[words for _, words in CALLS])
def test_a_bad_call_is_refused(call: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        call()
    assert "\n" not in str(error.value)


@pytest.mark.slow
@pytest.mark.parametrize("law", ["published", "repaired"])
def test_speed_beyond_validity_names_the_valid_range(law: str) -> None:
    limit = valid_speed(1, law)
    evaluate(1, limit, law)
    with pytest.raises(InputError, match="configuration 1:") as error:
        evaluate(1, [100.0, 1.01 * limit], law)
    assert f"{limit:.6g} rad/s" in str(error.value)
    masked, kept = (evaluate(1, [100.0, 1.01 * limit], law, outside=o) for o in ("mask", "keep"))
    assert masked.valid.tolist() == kept.valid.tolist() == [True, False]
    assert np.isnan(masked.thrust_N[1])
    assert np.isfinite(kept.thrust_N[1])


def write(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text)
    return folder


NODUS = "{conf: 20, blade: nine_inch, matrix: Stiff, fibre: tendon, fibres: 4, length_mm: 8,"


def test_own_configuration_beside_the_papers(tmp_path: Path) -> None:
    stiff = "poisson_ratio: 0.45, strain_percent: [1, 2, 3, 4], secant_modulus_MPa: [2, 2, 2, 2]"
    write(tmp_path, "materials.yaml", f"matrices: {{Stiff: {{{stiff}}}}}")
    for diameter in (0.9, 0.5):  # read anew
        write(tmp_path, "configurations.yaml", f"- {NODUS} fibre_diameter_mm: {diameter}}}")
        library = read_library(str(tmp_path))
        assert set(library.configurations) == {*range(14), 20}
        own = library.configurations[20]
        assert own.nodus.fibre_diameter_mm == diameter
    assert nodus_moduli(own).E_N_MPa > nodus_moduli(3).E_N_MPa
    assert evaluate(own, 400.0).thrust_N > evaluate(3, 400.0).thrust_N


SOFT = NODUS.replace("Stiff", "DragonSkin10")
FILES = [
    ("configurations.yaml", f"- {SOFT}}}", "no fibre_diameter_mm"),
    ("configurations.yaml", f"- {SOFT} fibre_diameter_mm: .nan}}", "fibre_diameter_mm: nan"),
    ("configurations.yaml", f"- {SOFT} fibre_diametre_mm: 0.5}}", "did you mean 'fibre_diamet"),
    ("configurations.yaml", 2 * f"- {SOFT} fibre_diameter_mm: 0.5}}\n", "conf 20 twice"),
    ("configurations.yaml", "- {conf: 20, blade: ten_inch}", "unknown blade"),
    ("configurations.yaml", "a: b: c", "line 1: mapping"),
    ("configurations.yaml", "a: 1", "no list"),
    ("materials.yaml", "fibers: {}", "did you mean 'fibres'"),
    ("materials.yaml", "matrices: {x: {poisson_ratio: 0.4, strain_percent: [1, 2, 3], "
     "secant_modulus_MPa: [1, 1, 1]}}", "4 or more"),
    ("blades.yaml", "x: 3", "a mapping"),
    ("readme.txt", "", "holds no data files"),
]  # fmt: skip
BLADES = [
    ("start_m: 0.030", "start_m: 0.031", "accepted: pieces that join"),
    ("outer_radius_m: 0.035", "outer_radius_m: 0.2", "outside of the blade"),
    ("lift_mean: 0.225", "lift_mean: big", "lift_mean: 'big'"),
    ("thickness_mm: [6.2, 6.2,", "thickness_mm: [6.2,", "one thickness a station"),
]
PRINTED = (DATA / "blades.yaml").read_text()
FILES += [("blades.yaml", PRINTED.replace(old, new), words) for old, new, words in BLADES]


@pytest.mark.parametrize(("name", "text", "words"), FILES, ids=[words for *_, words in FILES])
def test_data_that_does_not_fit(tmp_path: Path, name: str, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words) as error:
        read_library(write(tmp_path, name, text))
    assert "\n" not in str(error.value)


def test_law_published_is_for_the_papers_blade_only(tmp_path: Path) -> None:
    start, end = PRINTED.index("  # Only the law `published`"), PRINTED.index("  # Table II")
    library = read_library(write(tmp_path, "blades.yaml", PRINTED[:start] + PRINTED[end:]))
    other = library.configurations[13]
    assert evaluate(other, 300.0, "repaired").valid
    with pytest.raises(InputError, match="accepted: law repaired or consistent"):
        evaluate(other, 300.0, "published")
