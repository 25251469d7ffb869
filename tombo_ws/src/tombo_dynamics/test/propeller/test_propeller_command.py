import itertools
import json
import math
from pathlib import Path

import pytest
from typer.testing import CliRunner

from tombo_bringup.cli.propeller.propeller_command import app
from tombo_dynamics.propeller import configuration, evaluate, valid_speed

RUNNER = CliRunner()
KEYS = ["law", "conf", "rpm", "thrust_N", "drag_N", "torque_Nm", "alpha_rad", "beta_rad"]
KEYS += ["gamma_rad", "lift_over_drag", "valid"]


@pytest.fixture(autouse=True)
def empty_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_json_alone_on_standard_output_and_no_plot(empty_folder: Path) -> None:
    result = RUNNER.invoke(app, ["--conf", "5", "--rpm", "1000:3000:500", "--json"])
    assert result.exit_code == 0
    rows = json.loads(result.stdout)
    assert [row["rpm"] for row in rows] == [1000.0, 1500.0, 2000.0, 2500.0, 3000.0]
    assert all(list(row) == KEYS and row["valid"] and row["conf"] == 5 for row in rows)
    assert rows[2]["law"] == "repaired"
    point = evaluate(configuration(5), 2000.0 * math.pi / 30.0)
    assert rows[2]["thrust_N"] == pytest.approx(float(point.thrust_N), rel=1e-12)
    assert rows[2]["gamma_rad"] == pytest.approx(float(point.gamma_rad), rel=1e-12)
    assert not any(empty_folder.iterdir())


@pytest.mark.slow
def test_table_and_plot(empty_folder: Path) -> None:
    result = RUNNER.invoke(app, ["--conf", "13", "--law", "published"])
    assert result.exit_code == 0
    assert "0.614" in result.stdout
    assert "1.8952" in result.stdout
    picture = empty_folder / "propeller-conf13-published.png"
    assert str(picture) in result.stdout.replace("\n", "")
    assert picture.read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_plot_where_asked_for_even_with_json(empty_folder: Path) -> None:
    result = RUNNER.invoke(app, ["--conf", "0", "--json", "-o", "rigid.svg"])
    assert result.exit_code == 0
    assert [path.name for path in empty_folder.iterdir()] == ["rigid.svg"]
    assert len({row["lift_over_drag"] for row in json.loads(result.stdout)}) == 1
    assert "rigid.svg" in result.stderr


def test_rows_beyond_validity_are_empty() -> None:
    limit = valid_speed(configuration(1)) * 30.0 / math.pi
    result = RUNNER.invoke(app, ["--conf", "1", "--rpm", "1000:15000:1000", "--json"])
    assert result.exit_code == 0
    for row in json.loads(result.stdout):
        assert row["valid"] == (row["rpm"] <= limit)
        assert (row["thrust_N"] is None) == (not row["valid"])


def test_moduli() -> None:
    result = RUNNER.invoke(app, ["moduli", "--json"])
    assert result.exit_code == 0
    rows = json.loads(result.stdout)
    assert [row["conf"] for row in rows] == list(range(1, 14))
    assert all(list(row) == ["conf", "E_N_MPa", "G_N_MPa"] for row in rows)
    assert f"{rows[12]['E_N_MPa']:.4f}" == "0.7552"
    table = RUNNER.invoke(app, ["moduli"])
    assert "26 of 26" in table.stdout


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--conf", "14"], "unknown configuration 14"),
        (["--law", "fixed"], "unknown law 'fixed'"),
        (["--rpm", "nan"], "--rpm nan"),
        (["--rpm", "-100:2000:100"], "--rpm -100:2000:100"),
        (["--rpm", "1000:20000:100"], "18000 rpm"),
        (["--rpm", "2000:1000:100"], "2000:1000:100: A is above B"),
        (["--rpm", "1000:2000:0"], "1000:2000:0: STEP is not above 0"),
        (["--rpm", "1:2:3:4"], "--rpm 1:2:3:4"),
        (["--rpm", "0:18000:0.0001"], "100000"),
        (["--conf", "1", "--rpm", "9000"], "9000 rpm) is outside the validity"),
        (["-o", "nowhere/picture.png"], "no folder"),
        (["-o", "picture.docx"], "accepted: .png"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_2(
    arguments: list[str], message: str, empty_folder: Path
) -> None:
    result = RUNNER.invoke(app, [*arguments, "--json"])
    assert result.exit_code == 2
    assert result.stdout == ""
    assert message in result.stderr
    assert "accepted" in result.stderr
    assert len(result.stderr.splitlines()) == 1
    assert not any(empty_folder.iterdir())


def test_own_library(empty_folder: Path) -> None:
    row = "conf: 20, name: mine, blade: nine_inch, matrix: DragonSkin30, fibre: tendon, fibres: 5"
    own = empty_folder / "own"
    own.mkdir()
    (own / "configurations.yaml").write_text(
        f"- {{{row}, fibre_diameter_mm: 0.9, length_mm: 6}}\n"
    )
    asked = ["--library", "own", "--conf", "20", "--rpm", "4000", "--json"]
    stiff = json.loads(RUNNER.invoke(app, asked).stdout)[0]
    assert stiff["conf"] == 20
    assert stiff["thrust_N"] > float(evaluate(configuration(13), 4000 * math.pi / 30).thrust_N)
    moduli = RUNNER.invoke(app, ["moduli", "--library", "own"]).stdout
    assert "26 of 26" in moduli
    for bad, message in (("nowhere", "no such folder"), (".", "holds no data files")):
        result = RUNNER.invoke(app, ["--library", bad, "--json"])
        assert result.exit_code == 2
        assert message in result.stderr
        assert len(result.stderr.splitlines()) == 1


@pytest.mark.parametrize(
    ("before", "command"),
    [
        (["--library", "lib"], "moduli"),
        (["--law", "consistent"], "reproduce"),
        (["--json"], "reproduce"),
        (["--conf", "13"], "design"),
        (["--rpm", "2000"], "beta"),
        (["-o", "x"], "recovery"),
    ],
)
def test_an_option_before_a_sub_command_is_refused(before: list[str], command: str) -> None:
    result = RUNNER.invoke(app, [*before, command])
    assert result.exit_code == 2
    assert before[0].replace("-o", "--output") in result.stderr
    assert "after" in result.stderr and command in result.stderr
    assert result.stderr.count("\n") == 1


@pytest.mark.slow
def test_help_is_whole_lines_and_no_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert "A:B:STEP" in RUNNER.invoke(app, ["--help"]).stdout
    for command in ("reproduce", "diagnose", "beta", "recovery", "design"):
        text = RUNNER.invoke(app, [command, "--help"]).stdout.split("\u256d")[0]
        lines = [line.strip() for line in text.splitlines()]
        for line, following in itertools.pairwise(lines):
            if following:  # a line that is followed by another one has no room for its first word
                assert not line or len(line) + 1 + len(following.split()[0]) > 76, line
