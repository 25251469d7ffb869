"""`tombo diagnose` on the command line."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
from diagnosis_samples import sample

from tombo_bringup.cli import diagnose_command
from tombo_diagnosis.diagnosis import VERDICTS, diagnosis_mapping
from tombo_diagnosis.report.files import NominalReference


@pytest.fixture
def fixed_answer(monkeypatch):
    """Fixed answer of the diagnosis, without reading and fitting."""
    answer: dict[str, Any] = {"diagnosis": sample(flights=2, seconds=10.0), "asked": None}

    def run(logs, model, mapping, names, tell, vehicle):
        answer["asked"] = (logs, model, mapping, names, vehicle)
        for stage in ("reading", "checking", "fitting"):
            tell(stage, 0.5)
        return answer["diagnosis"], NominalReference("hover", "2031-04-05")

    monkeypatch.setattr(diagnose_command, "run", run)
    return answer


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_is_printed_first_and_leaves_with_0(tombo, fixed_answer, verdict):
    fixed_answer["diagnosis"] = sample(verdict, flights=1, seconds=10.0)
    result = tombo("diagnose", "a.mcap", "--no-report")
    assert result.code == 0, result.err
    assert result.err == ""
    first = result.out.splitlines()[0]
    assert {
        "named": "The cause is linear rotor drag",
        "set": "mass error or thrust coefficient error: these flights can’t tell",
        "none": "The simulation agrees",
        "unknown": "no known effect explains",
        "partly_explained": "something else is left",
    }[verdict] in first


@pytest.mark.slow
def test_cause_gain_faults_and_files_are_told(tombo, fixed_answer, tmp_path):
    result = tombo("diagnose", "lab flights.mcap", "other.mcap")
    out = re.sub(r"\s+", " ", result.out)
    for words in (
        "0.283 N s/m", "0.276 to 0.290",
        "specific force x 74 % 0.239 m/s² 0.0610 m/s²",
        "fault circle_3 25.00–28.50 s crash accel: 2.5 g", "d_z is not told from zero",
        "tombo fly --model runs/diagnosis-lab_flights/model.yaml",
        "runs/diagnosis-lab_flights: ",
    ):  # fmt: skip
        assert words in out, words
    assert "stamps repeat" not in out  # an info is for the report
    folder = tmp_path / "runs" / "diagnosis-lab_flights"
    assert {"report.html", "diagnosis.json", "model.yaml"} <= names(folder)


def test_json_is_that_alone_and_writes_nothing_unless_asked(tombo, fixed_answer, tmp_path):
    result = tombo("diagnose", "a.mcap", "--json")
    assert result.json == _plain(diagnosis_mapping(fixed_answer["diagnosis"]))
    assert list(tmp_path.iterdir()) == []
    again = tombo("diagnose", "a.mcap", "--json", "-o", "d", "--no-report")
    assert again.out == result.out == (tmp_path / "d" / "diagnosis.json").read_text()


def _plain(value: Any) -> Any:
    import json

    return json.loads(json.dumps(value))


def test_what_is_given_is_handed_on(tombo, fixed_answer):
    tombo(
        "diagnose", "a.bag", "b.bag", "--model", "m.yaml", "--mapping", "lab", "--json",
        "--vehicle", "v.yaml",
        "--map", "/vrpn/quad/pose=/mocap/pose", "--map", "/imu:=/imu/data_raw",
    )  # fmt: skip
    assert fixed_answer["asked"] == (
        [Path("a.bag"), Path("b.bag")],
        Path("m.yaml"),
        "lab",
        {"/vrpn/quad/pose": "/mocap/pose", "/imu": "/imu/data_raw"},
        "v.yaml",
    )


def test_ctrl_c_leaves_nothing_and_130(tombo, monkeypatch, tmp_path):
    import os
    import signal

    def run(*_):
        os.kill(os.getpid(), signal.SIGINT)
        for _ in range(1000):
            pass
        raise AssertionError("not stopped")

    monkeypatch.setattr(diagnose_command, "run", run)
    result = tombo("diagnose", "a.mcap", "-o", "deep/d")
    assert result.code == 130
    assert result.err == "Error: interrupted\n"
    assert list(tmp_path.iterdir()) == []
