"""The files of a diagnosis: strict JSON with the fields that were agreed on, all or nothing."""

import dataclasses
import json
import math
from pathlib import Path

import pytest
from diagnosis_samples import sample

from tombo_diagnosis.report.files import DIAGNOSIS_FILES, NominalReference, write_diagnosis
from tombo_diagnosis.report.page import diagnosis_page
from tombo_flight.extended_model import read_model
from tombo_flight.process.output_folder import open_output
from tombo_flight.report.page import page_json

AGAINST = NominalReference("hover", "2031-04-05")


def strict(diagnosis):
    def refuse(name: str):
        raise AssertionError(f"{name} is no JSON")

    return json.loads(page_json(diagnosis_page(diagnosis)), parse_constant=refuse)


def short(verdict="named"):
    return sample(verdict, flights=1, seconds=10.0)


def write(path: Path, result, *, replace: bool = False, **options) -> set[str]:
    with open_output(path, replace=replace, results=DIAGNOSIS_FILES) as folder:
        write_diagnosis(folder, result, AGAINST, **options)
        folder.publish()
    return {str(p.relative_to(path)) for p in path.rglob("*") if p.is_file()}


CHECK = "check severity flight channel message start_s end_s key subject numbers"


def test_the_fields_are_exactly_those_agreed_on():
    result = strict(sample("set"))
    assert list(result) == [
        "verdict", "causes", "set", "separating_experiment", "gain", "prechecks", "candidates",
        "flights", "confidence", "summary", "notes", "model", "vehicle", "seconds",
        "changed", "leftover", "controller", "tolerances", "version",
    ]  # fmt: skip
    cause, gain = result["causes"][0], strict(sample())["gain"][0]
    for fields, names in (
        (result["separating_experiment"], "effects text"),
        (cause, "effect theta confidence covariance"),
        (cause["theta"]["fraction"], "value unit nominal low high"),
        (gain, "channel unit horizon before after reduction low high flights"),
        (result["prechecks"][0], CHECK),
    ):
        assert set(fields) == set(names.split())
    assert result["set"] == ["mass_error", "thrust_coefficient_error"]


def test_values_survive_the_round_trip_and_what_is_not_finite_is_null():
    result = sample()
    theta = dataclasses.replace(result.causes[0].theta[0], high=math.inf)
    cause = dataclasses.replace(result.causes[0], theta=(theta,))
    read = strict(dataclasses.replace(result, causes=(cause,)))
    assert read["causes"][0]["theta"]["d_xy"] == {
        "value": 0.283, "unit": "N s/m", "nominal": 0.0, "low": 0.2761, "high": None,
    }  # fmt: skip
    assert read["causes"][0]["covariance"] == [[1.3e-5, 2.0e-7], [2.0e-7, 9.1e-4]]
    assert read["gain"][-1]["low"] is None
    assert read["candidates"][0]["evidence"] == 812.4
    assert read["flights"][1]["missing"] == ["gyro", "accel", "rotor_speed"]


@pytest.mark.slow
def test_a_named_cause_leaves_a_model_that_can_be_read(tmp_path):
    names = write(tmp_path / "o", sample(flights=2, seconds=10.0))
    assert names == set(DIAGNOSIS_FILES)
    model = read_model(tmp_path / "o" / "model.yaml")
    assert model.effects == {"linear_rotor_drag": {"d_xy": 0.283, "d_z": 0.041}}
    assert (model.origin.scenario, model.origin.date) == ("hover", "2031-04-05")
    assert str(tmp_path / "o" / "model.yaml") in (tmp_path / "o" / "report.html").read_text()


def test_a_set_leaves_no_model(tmp_path):
    assert write(tmp_path / "o", short("set"), pictures=False) == {"diagnosis.json"}
