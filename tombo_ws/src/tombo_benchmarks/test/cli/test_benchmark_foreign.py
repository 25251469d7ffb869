"""Logs of the second simulator through `tombo diagnose`: from the files to the name.

What is hidden is large: the forces, moments and readings that it makes are many times the noise
in each of the three flights, so that who has the right model can't miss it.
"""

import json

import numpy as np
import pytest

from tombo_benchmarks.cli import benchmark_foreign_command
from tombo_benchmarks.cli.benchmark_foreign_command import diagnose_files
from tombo_benchmarks.diagnosis import foreign_evaluation
from tombo_benchmarks.diagnosis.foreign_cases import WrittenFlights, make_case
from tombo_benchmarks.diagnosis.foreign_evaluation import aggregate, examine_case
from tombo_benchmarks.diagnosis.runner import BenchmarkResult
from tombo_benchmarks.diagnosis.second_simulator.vehicles import S500
from tombo_dynamics.errors import InputError

SEED = 12
LARGEST_ERROR = 0.25
"""Of a parameter: what a careful lab leaves open is a twentieth, in three flights of 20 s."""


def examined(kind, size, hidden, formulation="imu_rpm", log_format="table", chain="plain"):
    case = make_case((SEED, 0), kind, size, hidden, S500, formulation, chain, log_format)
    return examine_case(diagnose_files, case)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("cause", "formulation", "log_format"),
    [("mass_error", "imu_rpm", "bag"), ("linear_rotor_drag", "mocap_rpm", "turned_table")],
)
def test_a_large_cause_is_found_from_the_files_on(cause, formulation, log_format):
    row = examined("single", "large", (cause,), formulation, log_format)
    assert row["verdict"] in ("named", "set"), (row["verdict"], row.get("why"), row.get("said"))
    assert cause in (*row["causes"][:1], *row["set"]), row
    if row["verdict"] == "named":
        assert set(row["causes"]) == {cause}, row
        assert row["parameters"][cause]["error"] < LARGEST_ERROR, row


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden():
    assert examined("none", "", (), "imu", "turned_table")["verdict"] == "none"


@pytest.mark.slow
def test_a_cord_that_no_effect_describes_gets_no_name():
    row = examined("unknown", "large", ("tether",))
    assert row["verdict"] in ("unknown", "partly_explained"), row


def test_a_refusal_is_scored_and_says_why(monkeypatch):
    def refuse(arguments):
        raise InputError("no poses; accepted: poses")

    monkeypatch.setattr(
        foreign_evaluation, "write_flights", lambda case, folder: WrittenFlights([], None, None)
    )
    row = examine_case(refuse, make_case((1, 1), "none", "", (), S500))
    assert (row["verdict"], row["why"]) == ("refused", "no poses; accepted: poses")
    assert aggregate([row])["false_alarm"] == 1.0


def test_bad_files_are_refused_as_by_the_command(tmp_path):
    log = tmp_path / "log.csv"
    log.write_text("a,b\n1,2\n")
    with pytest.raises(InputError, match="no mapping given"):
        diagnose_files([str(log), "--json"])


def test_the_score_is_that_of_the_own_benchmark_and_of_each_vehicle(tombo, monkeypatch):
    row = {
        "case": 0, "kind": "single", "size": "large", "formulation": "imu", "vehicle": "x500",
        "hidden": ["mass_error"], "verdict": "named", "causes": ["mass_error"], "set": [],
        "confidence": 0.9,
    }  # fmt: skip

    def benchmark(ask, cases, seed, workers, progress, stop, kept):
        assert ask is benchmark_foreign_command.diagnose_files
        return BenchmarkResult([row] * cases, aggregate([row] * cases))

    monkeypatch.setattr(foreign_evaluation, "benchmark", benchmark)
    result = tombo("benchmark", "foreign", "--cases", "2", "--seed", "3", "--json")
    said = json.loads(result.out)["aggregate"]
    assert said["top1_large"] == said["x500"]["top1_large"] == said["all"]["top1_large"] == 1.0
    assert said["s500"]["top1_large"] is None and said["nominal"] == "command"
    shown = tombo("benchmark", "foreign", "--cases", "2").out
    assert "right cause first, large effect" in shown and "x500" in shown
    assert np.isclose(said["calibration"][0]["stated"], 0.9)
