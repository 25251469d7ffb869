"""Inputs, margin, and a study that is killed and goes on."""

from __future__ import annotations

import builtins
import json
import shlex
from dataclasses import replace
from functools import partial
from itertools import pairwise

import numpy as np
import pyarrow.parquet as pq
import pytest

from tombo_dynamics.errors import InputError
from tombo_flight.flight import fly_scenario
from tombo_flight.process.study_folder import fly_study, open_study
from tombo_flight.risk.page import analyse_risk
from tombo_flight.risk.study import margin, new_risk, parse_input, settings_at
from tombo_flight.scenario import load_scenario
from tombo_flight.vehicle_file import Note, vehicle_named

PAPER = load_scenario("paper_collision")
S500 = vehicle_named("tombo_s500")
GIVEN = ("mission.approach_speed~Normal(1.0,0.15)", "vehicle.mass")


def made(text: str):
    return parse_input(text, PAPER, S500)


def test_inputs_have_the_quantiles_of_their_distribution():
    mass = made("vehicle.mass ~ Normal(1.3, 0.02)")
    for u in (-6.0, -1.0, 0.0, 3.0, 7.0):
        assert float(mass.text_at(u)) == pytest.approx(1.3 + 0.02 * u, rel=1e-9)
    speed = made("mission.approach_speed~Uniform(0.5,1.5)")
    assert float(speed.text_at(0.0)) == pytest.approx(1.0)
    assert 0.5 <= float(speed.text_at(-9.0)) < 0.5001 < 1.4999 < float(speed.text_at(9.0)) <= 1.5
    wind = made("effects.steady_wind.east~LogNormal(0.0,0.4)")
    assert float(wind.text_at(2.0)) == pytest.approx(np.exp(0.8), rel=1e-6)
    assert settings_at([mass, mass], np.zeros(2)) == ["vehicle.mass=1.3"] * 2


def test_an_input_alone_has_the_tolerance_that_is_known():
    assert made("vehicle.mass").distribution == "Normal(1.3,0.0065)"  # a twentieth of 10 %
    noted = replace(S500, notes={"vehicle.mass": Note(0.002, "weighed")})
    assert parse_input("vehicle.mass", PAPER, noted).distribution == "Normal(1.3,0.002)"
    assert made("effects.mass_error.fraction").distribution == "Normal(0,0.005)"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "accepted: KEY"),
        ("vehicle.mass~", "accepted: KEY"),
        ("vehicle.mass~__import__('os')", "accepted: KEY"),
        ("vehicle.mas~Normal(1,2)", "did you mean 'vehicle.mass'"),
        ("wind~Normal(0,1)", "unknown setting"),
        ("effects.steady_wnd.east", "did you mean 'steady_wind'"),
        ("vehicle.mass~Norml(1,2)", "did you mean 'Normal'"),
        ("vehicle.mass~Normal(1)", r"Normal\(mean, deviation\)"),
        ("vehicle.mass~Normal(1.3,-1)", "accepted: Normal"),
        ("vehicle.mass~Normal(0.1,1)", "outside 0.01 to 10"),
        ("propeller.law~Normal(0,1)", "unknown setting"),
        ("mission.height", "no tolerance"),
    ],
)
def test_what_is_no_input_is_refused(text: str, said: str):
    with pytest.raises(InputError, match=said):
        made(text)


def test_without_the_packages_one_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    original = builtins.__import__

    def without(name: str, *more, **named):
        if name == "openturns":
            raise ModuleNotFoundError(name=name)
        return original(name, *more, **named)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"openturns.*requirements-study\.txt"):
        new_risk("paper_collision", GIVEN, 100)


SUMMARY = {
    "crashed": False, "crash_time_s": None, "collision_time_s": 23.0, "max_tilt_rad": 0.3,
    "contact_position_m": [1.7, 0.0, 2.0], "max_falling_distance_m": 0.5,
}  # fmt: skip


def test_margin_falls_with_the_height_that_is_left_and_is_negative_after_a_crash():
    def of(**changed) -> float:
        return margin({**SUMMARY, **changed}, PAPER)

    falls = [of(max_falling_distance_m=fall) for fall in (0.5, 1.0, 1.5, 1.8, 1.95)]
    assert falls == sorted(falls, reverse=True) and falls[-1] > 0.0
    assert falls[0] - of(max_falling_distance_m=0.5 + 1e-4) < 1e-3  # continuous
    assert of(max_tilt_rad=3.1) < 0.02 < of(max_tilt_rad=2.0)
    late, early = (of(crashed=True, crash_time_s=23.0 + after) for after in (8.0, 0.7))
    assert -1.0 <= early < late < 0.0
    assert of(crashed=True, crash_time_s=1e5) > -1e-3  # goes to 0 the later it comes
    untouched = {"collision_time_s": None, "contact_position_m": None}
    assert of(**untouched, max_falling_distance_m=None) == pytest.approx(1.0 - 0.3 / np.pi)
    assert of(**untouched, crashed=True, crash_time_s=9.0) < 0.0


@pytest.mark.slow
@pytest.mark.parametrize("speed", ["0.5", "1.1", "1.5"])
def test_margin_is_negative_exactly_where_a_flight_crashed(speed: str):
    scenario = load_scenario("paper_collision", [f"mission.approach_speed={speed}"])
    for seed in range(4):
        summary = fly_scenario(scenario, seed).summary
        assert (margin(summary, scenario) < 0.0) is summary["crashed"]


SOON = (
    *("mission.takeoff_time=0.2", "mission.climb_speed=1.2", "mission.approach_time=4"),
    "duration=11",
)
"""The paper's collision after 7 s instead of 23 s."""


@pytest.mark.slow
def test_a_killed_study_goes_on_to_the_same_digit(tmp_path):
    study = new_risk("paper_collision", GIVEN, 100, settings=SOON)
    with open_study(tmp_path / "whole", study) as folder:
        whole = fly_study(folder, partial(analyse_risk, study), workers=1).data
    with open_study(tmp_path / "killed", study) as folder:
        assert (
            fly_study(
                folder, partial(analyse_risk, study), workers=1, stop=lambda: folder.kept > 30
            )
            is None
        )
        kept = folder.kept
    assert 0 < kept < 100
    journal = tmp_path / "killed" / "flights.jsonl"
    journal.write_bytes(journal.read_bytes() + b'\n["risk", 77, {"mar')
    with open_study(tmp_path / "killed", study) as folder:
        assert folder.kept == kept
        assert fly_study(folder, partial(analyse_risk, study), workers=1).data == whole
    one, two = (pq.read_table(tmp_path / name / "flights.parquet") for name in ("whole", "killed"))
    assert one.equals(two) and one.num_rows == 100
    assert (np.array(one["margin"]) < 0.0).tolist() == one["crashed"].to_pylist()
    assert json.loads((tmp_path / "whole" / "risk.json").read_text())["result"] == whole
    _the_most_likely_crash_flies_again(whole)
    assert whole["most_likely_crash"]["command"] in (tmp_path / "whole" / "risk.html").read_text()
    _a_check_goes_on_from_the_estimate(tmp_path / "killed", whole)
    other = new_risk("paper_collision", GIVEN, 110, settings=SOON)
    with pytest.raises(InputError, match="another flights"), open_study(tmp_path / "whole", other):
        pass


def _a_check_goes_on_from_the_estimate(path, whole) -> None:
    def checked(flights: int) -> tuple[int, dict]:
        study = new_risk("paper_collision", GIVEN, 100, settings=SOON, check=flights)
        with open_study(path, study) as folder:
            kept = folder.kept
            return kept, fly_study(folder, partial(analyse_risk, study), workers=1).data

    kept, long = checked(150)
    assert kept == 100 and long | {"check": None, "outcome": whole["outcome"]} == whole
    table = pq.read_table(path / "flights.parquet")
    flown = table.filter(table["check"])
    assert flown.num_rows == 150 and flown["flight"][0].as_py() == 100
    crashes = sum(flown["crashed"].to_pylist())
    assert long["check"]["crashes"] == crashes > 0
    assert long["check"]["probability"] == pytest.approx(crashes / 150)
    assert set(flown["weight"].to_pylist()) == {0.0} and all(flown["drawn_as_given"].to_pylist())
    speeds = np.array(flown["mission.approach_speed"])
    assert speeds.mean() == pytest.approx(1.0, abs=4 * 0.15 / np.sqrt(150))  # drawn as given
    kept, short = checked(100)
    assert kept == 200 and short["check"]["crashes"] == sum(flown["crashed"].to_pylist()[:100])


def _the_most_likely_crash_flies_again(result) -> None:
    words = shlex.split(result["most_likely_crash"]["command"])
    assert words[:3] == ["tombo", "fly", "paper_collision"]
    settings = [word for before, word in pairwise(words) if before == "--set"]
    scenario = load_scenario("paper_collision", settings)
    summary = fly_scenario(scenario, int(words[words.index("--seed") + 1])).summary
    assert summary["crashed"]
    assert margin(summary, scenario) == pytest.approx(result["most_likely_crash"]["margin"])
