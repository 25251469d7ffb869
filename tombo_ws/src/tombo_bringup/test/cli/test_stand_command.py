"""`tombo propeller diagnose` from the outside."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from tombo_dynamics.propeller import configuration, evaluate


@pytest.fixture
def run(tombo):
    return lambda *arguments: tombo("propeller", "diagnose", *map(str, arguments))


def table(path, gain=1.0, confs=(5, 9, 13), seed=0, tare=0.0):
    rng = np.random.default_rng(seed)
    rows = ["conf,rpm,thrust_N,torque_Nm,beta_deg"]
    for conf in confs:
        rpm = np.linspace(1000.0, 4200.0, 17)
        p = evaluate(configuration(conf), rpm * math.pi / 30.0)
        for k, speed in enumerate(rpm):
            t = gain * (p.thrust_N[k] + tare) + 0.004 * rng.standard_normal()
            q = p.torque_Nm[k] + 2e-4 * rng.standard_normal()
            b = math.degrees(p.beta_rad[k]) + 0.2 * rng.standard_normal()
            rows.append(f"{conf},{speed:.1f},{t:.5f},{q:.6f},{b:.3f}")
    path.write_text("\n".join(rows) + "\n")
    return path


def write_model(folder, effects):
    """Write a model of earlier runs: effect -> parameter -> value."""
    path = folder / "m.yaml"
    parameters = {
        name: {"parameters": {p: {"value": v} for p, v in theta.items()}, "confidence": 0.9}
        for name, theta in effects.items()
    }
    text = yaml.safe_dump({"tombo_model": 1, "effects": parameters})
    path.write_text(text)
    return path


@pytest.mark.slow
def test_a_gain_is_found_written_and_then_no_finding_any_more(run, tmp_path):
    path = table(tmp_path / "a.csv", gain=1.15)
    result = run(path, "-o", tmp_path / "out")
    assert result.code == 0, result.out
    diagnosis = json.loads((tmp_path / "out/diagnosis.json").read_text())
    assert diagnosis["verdict"] in ("named", "set")
    assert diagnosis["causes"][0]["effect"] in ("thrust_gain", "thrust_coefficient")
    page = (tmp_path / "out/report.html").read_text()
    places = [page.index(t) for t in ("What would settle it", "The gap", "All candidates")]
    assert places == sorted(places)
    assert page.count("<figure ") == 3  # thrust, torque and flap angle
    assert "http:" not in page and "https:" not in page and "{{" not in page
    if diagnosis["verdict"] == "named":
        model = yaml.safe_load((tmp_path / "out/stand_model.yaml").read_text())
        assert model["origin"]["flights"][0]["source"].startswith(str(path))
    (cause, *_) = diagnosis["causes"]
    values = {name: theta["value"] for name, theta in cause["theta"].items()}
    model = write_model(tmp_path, {cause["effect"]: values})
    again = run(path, "--model", model, "--json")
    assert again.json["verdict"] == "none"


@pytest.mark.slow
def test_the_table_of_the_paper_leaves_a_set_and_says_what_separates_it(run):
    diagnosis = run(Path(__file__).parents[5] / "examples/table3.csv", "--json").json
    assert diagnosis["verdict"] == "set"
    assert {"centrifugal_stiffening", "torsion_constant"} <= set(diagnosis["set"])
    assert "flap angle" in diagnosis["separating_experiment"]["text"]


def test_a_thousandfold_thrust_is_refused_first_thing(refused, tmp_path):
    table(tmp_path / "a.csv", gain=1e3 / 9.80665)
    words = ("column 'thrust_N'", "are the units of thrust and speed right")
    refused(("propeller", "diagnose", "a.csv", "--json"), *words)


@pytest.mark.slow
def test_runs_that_differ_are_told_and_extend_no_model(run, tmp_path):
    paths = [table(tmp_path / f"{n}.csv", g, (13,), n) for n, g in enumerate((1.0, 1.1))]
    result = run(*paths, "-o", tmp_path / "out")
    assert result.code == 0, result.out
    assert "The cause is run scatter" in result.out
    assert not (tmp_path / "out/stand_model.yaml").exists()
    page = (tmp_path / "out/report.html").read_text()
    assert "differ by" in page and "stand_model.yaml: the verdict" not in page
