"""`tombo fly --model`: the model's effects over the scenario's, named in all that is written."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tombo_bag.flight_time import FLIGHT_METADATA
from tombo_bag.recording import Recording
from tombo_dynamics.errors import InputError
from tombo_flight.extended_model import FittedEffect, FittedParameter, Model, Origin, write_model
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.slow

SHORT = ("hover", "--set", "duration=3")
ORIGIN = Origin("tombo", "2025-01-02", "named", 0.9, "", "no_obstacle")


def fitted(name: str, value: float) -> FittedParameter:
    return FittedParameter(name, "m/s", 0.0, value, value, value)


@pytest.fixture
def model(tmp_path: Path) -> str:
    wind = FittedEffect("steady_wind", (fitted("east", 2.0), fitted("north", -1.0)), 0.9)
    write_model(tmp_path / "windy.yaml", Model((wind,), ORIGIN))
    return "windy.yaml"


def scenario_of(folder: str) -> dict[str, object]:
    with Recording(Path(folder) / "flight.mcap") as recording:
        scenario: dict[str, object] = json.loads(recording.metadata[FLIGHT_METADATA]["scenario"])
    return scenario


def without_names(summary: dict[str, object]) -> dict[str, object]:
    names = ("model", "wall_time_s", "real_time_factor", "recorded_messages")
    return {key: value for key, value in summary.items() if key not in names}


def test_flies_as_if_the_effects_were_set(tombo, model):
    by_model = tombo("fly", *SHORT, "--model", model, "-o", "a", "--json").json
    wind = ("--set", "effects.steady_wind={east: 2.0, north: -1.0}")
    by_setting = tombo("fly", *SHORT, *wind, "-o", "b", "--json").json
    calm = tombo("fly", *SHORT, "-o", "c", "--json").json

    assert without_names(by_model) == without_names(by_setting) != without_names(calm)
    assert scenario_of("a")["effects"] == scenario_of("b")["effects"]


def test_summary_report_and_recording_name_the_model(tombo, model):
    result = tombo("fly", *SHORT, "--model", model, "-o", "a")
    assert result.code == 0
    assert f"model {model}" in " ".join(result.out.split())
    assert json.loads(Path("a/summary.json").read_text())["model"] == model
    assert f"model {model}" in Path("a/report.html").read_text()
    assert scenario_of("a")["model"] == model
    assert tombo("fly", *SHORT, "-o", "b", "--json").json["model"] is None


def test_a_model_is_not_laid_over_reality(refused, model):
    arguments = ("fly", "hover", "--model", model, "--px4", "udpin://127.0.0.1:1", "--yes")
    refused(arguments, "--model: accepted: without --px4 URL")


def test_a_scenario_file_can_t_claim_a_model(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("extends: hover\nmodel: windy.yaml")
    with pytest.raises(InputError, match="model: accepted: tombo fly --model"):
        load_scenario(str(path))
