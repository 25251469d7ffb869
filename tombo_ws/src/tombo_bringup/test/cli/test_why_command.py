"""`tombo why`: answers with the keys that are promised, or refuses with exit code 2."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from tombo_bringup.cli.errors import BAD_INPUT, exit_code_of
from tombo_bringup.cli.main import application

MAPPING = """\
time: {column: t, unit: s}
channels:
  position: {columns: [x, y, z], unit: m}
"""


@pytest.fixture
def hover(tmp_path):
    """A log of poses alone of a hover, and its mapping."""
    rng = np.random.default_rng(1)
    t = np.arange(0.0, 5.0, 0.01)
    place = np.column_stack([t, 0.1 * np.sin(t), 0.0 * t, 1.0 + 0.0 * t])
    place[:, 1:] += 0.001 * rng.standard_normal((t.size, 3))
    np.savetxt(tmp_path / "hover.csv", place, delimiter=",", header="t,x,y,z", comments="")
    (tmp_path / "mapping.yaml").write_text(MAPPING)
    return [str(tmp_path / "hover.csv"), "--mapping", str(tmp_path / "mapping.yaml")]


def test_a_healthy_flight_has_no_cause_and_no_time(hover):
    result = CliRunner().invoke(application(), ["why", *hover, "--json"])
    assert result.exit_code == 0, result.output
    said = json.loads(result.stdout)
    assert (said["cause"], said["time_s"], said["timeline"]) == ("none", None, [])
    assert 0.0 < said["confidence"] <= 1.0


def test_a_folder_gets_answer_and_report(hover, tmp_path):
    folder = tmp_path / "out"
    result = CliRunner().invoke(application(), ["why", *hover, "-o", str(folder)])
    assert result.exit_code == 0, result.output
    assert "Nothing wrong" in result.stdout
    assert {path.name for path in folder.iterdir()} == {"why.json", "report.html"}


def test_what_is_no_log_is_refused(tmp_path, capsys):
    path = tmp_path / "text.csv"
    path.write_text("nothing\n")
    code = exit_code_of(lambda: application()(["why", str(path)], standalone_mode=False))
    assert code == BAD_INPUT
    assert "accepted" in capsys.readouterr().err
