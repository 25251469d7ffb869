import math
from pathlib import Path

import pytest

from tombo_dynamics.propeller import configuration, evaluate, valid_speed

KEYS = ["law", "conf", "rpm", "thrust_N", "drag_N", "torque_Nm", "alpha_rad", "beta_rad"]
KEYS += ["gamma_rad", "lift_over_drag", "valid"]


def test_json_alone_on_standard_output_and_no_file(tombo, tmp_path: Path) -> None:
    result = tombo("propeller", "--conf", "5", "--rpm", "1000:3000:500", "--json")
    assert result.code == 0
    rows = result.json
    assert [row["rpm"] for row in rows] == [1000.0, 1500.0, 2000.0, 2500.0, 3000.0]
    assert all(list(row) == KEYS and row["valid"] and row["conf"] == 5 for row in rows)
    assert rows[2]["law"] == "repaired"
    point = evaluate(configuration(5), 2000.0 * math.pi / 30.0)
    assert rows[2]["thrust_N"] == pytest.approx(float(point.thrust_N), rel=1e-12)
    assert rows[2]["gamma_rad"] == pytest.approx(float(point.gamma_rad), rel=1e-12)
    assert not any(tmp_path.iterdir())


def test_a_table_alone_writes_nothing(tombo, tmp_path: Path) -> None:
    result = tombo("propeller", "--conf", "13", "--law", "published")
    assert result.code == 0
    assert "0.614" in result.out
    assert "1.8952" in result.out
    assert not any(tmp_path.iterdir())


def test_rows_beyond_validity_are_empty(tombo) -> None:
    limit = valid_speed(configuration(1)) * 30.0 / math.pi
    result = tombo("propeller", "--conf", "1", "--rpm", "1000:15000:1000", "--json")
    assert result.code == 0
    for row in result.json:
        assert row["valid"] == (row["rpm"] <= limit)
        assert (row["thrust_N"] is None) == (not row["valid"])


def test_own_library(tombo, refused, tmp_path: Path) -> None:
    row = "conf: 20, name: mine, blade: nine_inch, matrix: DragonSkin30, fibre: tendon, fibres: 5"
    own = tmp_path / "own"
    own.mkdir()
    (own / "configurations.yaml").write_text(
        f"- {{{row}, fibre_diameter_mm: 0.9, length_mm: 6}}\n"
    )
    asked = ["--library", "own", "--conf", "20", "--rpm", "4000", "--json"]
    stiff = tombo("propeller", *asked).json[0]
    assert stiff["conf"] == 20
    assert stiff["thrust_N"] > float(evaluate(configuration(13), 4000 * math.pi / 30).thrust_N)
    for bad, message in (("nowhere", "no such folder"), (".", "holds no data files")):
        refused(("propeller", "--library", bad, "--json"), message)


@pytest.mark.parametrize(
    ("before", "command"), [(["--library", "lib"], "design"), (["--conf", "13"], "design")]
)
def test_an_option_before_a_sub_command_is_refused(refused, before: list[str], command: str):
    refused(("propeller", *before, command), f"options before {command}", "accepted")
