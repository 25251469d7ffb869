"""`tombo fly --seeds`: as the single flights, in the order of the seeds."""

from __future__ import annotations

import json
import math

import pytest
from suite_bench import names

from tombo_flight.campaign.campaign import CampaignStudy, draw_campaign, fly_campaign
from tombo_flight.campaign.statistics import SPREAD_METRICS, aggregate, spread
from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import WALL_KEYS, flight_summary
from tombo_flight.process.study import Task, begin_flying, fly_batch
from tombo_flight.process.study_folder import open_study
from tombo_flight.scenario import load_scenario

pytestmark = pytest.mark.slow

SETTINGS = ["duration=26"]


def timeless(summary):
    return {key: value for key, value in summary.items() if key not in WALL_KEYS}


def test_a_campaign_is_its_single_flights(tombo, tmp_path):
    result = tombo("fly", "--seeds", "4:9", "--set", SETTINGS[0], "-o", "c", "--json")

    assert result.code == 0
    assert result.err == ""
    campaign = result.json
    assert json.loads((tmp_path / "c" / "summary.json").read_text()) == campaign
    written = {"summary.json", "scenario.yaml", "campaign.png", "campaign.json", "flights.parquet"}
    assert names(tmp_path / "c") == written
    assert (tmp_path / "c" / "campaign.png").read_bytes().startswith(b"\x89PNG")
    scenario = load_scenario("paper_collision", SETTINGS)
    for seed, flight in zip(range(4, 9), campaign["flights"], strict=True):
        alone = json.loads(json.dumps(flight_summary(fly_scenario(scenario, seed))))
        assert timeless(flight) == timeless(alone)
    total = campaign["aggregate"]
    assert total["flights"] == 5
    assert total["collided"] == sum(f["collided"] for f in campaign["flights"])
    assert total["crashed"] + total["not_crashed"] == 5
    latencies = [f["detection_latency_s"] for f in campaign["flights"]]
    assert total["detection_latency_s"]["mean"] == pytest.approx(sum(latencies) / 5, abs=1e-6)
    assert total["detection_latency_s"]["max"] == max(latencies)
    flown = sum(f["duration_s"] for f in campaign["flights"])
    assert total["real_time_factor"] == pytest.approx(flown / total["wall_time_s"])


def test_a_campaign_goes_on_where_it_was_killed_and_flies_nothing_twice(tombo, tmp_path):
    words = ("fly", "hover", "--seeds", "3:7", "--set", "duration=0.5", "--json")
    whole = tombo(*words, "-o", "whole").json
    study = CampaignStudy(load_scenario("hover", ["duration=0.5"]), range(3, 7))
    with open_study(tmp_path / "c", study) as opened:
        task = Task(5, None, 5)
        begin_flying(study)
        opened.keep(fly_batch([task]))
    run = next(run for run in tombo("runs", ".", "--json").json if run["folder"] == "c")
    assert (run["kind"], run["outcome"]) == ("campaign", "not finished")
    line = (tmp_path / "c" / "flights.jsonl").read_text()
    (tmp_path / "c" / "flights.jsonl").write_text(line.replace('"strikes": 0', '"strikes": 7'))

    again = tombo(*words, "-o", "c").json

    strikes = [flight["strikes"] for flight in again["flights"]]
    assert strikes == [0, 0, 7, 0]  # that of seed 5 was not flown again
    for flight, alone in zip(again["flights"], whole["flights"], strict=True):
        assert timeless({**flight, "strikes": 0}) == timeless(alone)
    other = ("fly", "hover", "--seeds", "3:8", "--set", "duration=0.5", "-o", "c")
    assert "another seeds" in tombo(*other).err
    assert tombo(*other, "--force").code == 0


def test_one_table_for_all_flights(tombo, tmp_path):
    result = tombo("fly", "hover", "--seeds", "0:2", "--set", "duration=0.5")

    assert result.code == 0
    assert "2 flights: 0 collided" in result.out
    assert "median" in result.out and "mean" not in result.out
    assert "–" not in result.out and "paper" not in result.out, "figures of no collision"
    assert names(tmp_path / "runs") == {"hover-0-2-duration_0.5"}


def test_the_papers_figures_stand_beside_its_vehicle_alone():
    for vehicle, of_paper in ((None, True), ("racer_5_inch", False)):
        scenario = load_scenario("paper_collision", ["duration=0.2"], vehicle=vehicle)
        campaign = fly_campaign(scenario, range(1), workers=1)
        assert campaign["of_paper"] == of_paper


def test_a_stopped_campaign_keeps_the_flights_up_to_the_first_one_missing():
    done = []

    campaign = fly_campaign(
        load_scenario("hover", ["duration=0.2"]),
        range(10, 400),
        workers=2,
        progress=done.append,
        stop=lambda: bool(done) and done[-1] >= 60,
    )

    flights = campaign["flights"]
    assert campaign["interrupted"]
    assert len(flights) < 390  # none, where one worker has flown all of them so far
    assert [f["seed"] for f in flights] == list(range(10, 10 + len(flights)))
    assert campaign["aggregate"]["flights"] == len(flights)


def test_a_failure_in_a_process_is_not_swallowed(monkeypatch):
    scenario = load_scenario("hover", ["propeller.conf=1"])  # cannot lift: the rehearsal's to find

    with pytest.raises(ValueError, match=r"seed \d: propeller\.conf"):
        fly_campaign(scenario, range(3), workers=1)


def test_spread_of_known_values():
    values = spread([1.0, None, 2.0, 3.0, 4.0, 5.0])

    assert values["count"] == 5
    assert values["mean"] == 3.0
    assert values["std"] == pytest.approx(math.sqrt(2.5), abs=1e-6)
    assert (values["p05"], values["median"], values["p95"]) == (1.2, 3.0, 4.8)
    assert (values["p5"], values["p50"]) == (1.2, 3.0)
    assert values["max"] == 5.0
    assert spread([7.0])["std"] is None
    assert spread([None]) == {**dict.fromkeys(values), "count": 0}


def flight(**changes):
    return {
        **dict.fromkeys(SPREAD_METRICS, 1.0), "collided": True, "detected": True, "landed": True,
        "crashed": False, "false_alarms": 0, "struck_rotor": None, "contact_rotor": "front_left",
        **changes,
    }  # fmt: skip


def test_recovery_is_aggregated_over_flights_that_settled_without_crash():
    flights = [
        flight(),
        flight(recovery_time_s=None),
        flight(crashed=True, landed=False),
        flight(false_alarms=2, detected=False),
    ]

    total = aggregate(flights, 2.0)

    assert (total["flights"], total["crashed"], total["not_crashed"]) == (4, 1, 3)
    assert total["recovered"] == 2
    assert total["crash_rate"] == 0.25
    low, high = total["crash_rate_95"]  # of 1 in 4: the ends at which the count is 2.5 % likely
    assert 1.0 - (1.0 - low) ** 4 == pytest.approx(0.025, abs=1e-4)
    assert (1.0 - high) ** 4 + 4.0 * high * (1.0 - high) ** 3 == pytest.approx(0.025, abs=1e-4)
    assert (total["detected"], total["landed"], total["false_alarms"]) == (3, 3, 2)
    assert total["recovery_time_s"]["count"] == 3
    assert total["real_time_factor"] == 2.0


def test_alarms_are_counted_by_the_hour_and_rotors_where_one_was_named():
    named = ("front_left", "front_left", "rear_left", None)
    flights = [flight(struck_rotor=rotor, duration_s=900.0) for rotor in named]
    flights += [
        flight(false_alarms=3, duration_s=1800.0),
        flight(collided=False, contact_rotor=None, struck_rotor="front_left", duration_s=0.0),
    ]

    total = aggregate(flights, 2.0)

    assert total["false_alarms_per_hour"] == 2.0  # 3 in an hour and a half
    assert (total["struck_rotor_named"], total["struck_rotor_right"]) == (3, 0.666667)
    nothing = aggregate([], 0.0)
    assert nothing["false_alarms_per_hour"] is nothing["struck_rotor_right"] is None
    assert nothing["crash_rate"] is nothing["crash_rate_95"] is None


def test_the_figure_copes_with_flights_without_a_collision():
    none = flight(**dict.fromkeys(SPREAD_METRICS) | {"duration_s": 1.0})
    campaign = {
        "scenario": "a $x_b name", "conf": 13, "reaction": "none", "disturbances": False,
        "of_paper": True,
        "first_seed": 0, "last_seed": 1,
        "flights": [none, none], "aggregate": aggregate([none, none], 1.0),
    }  # fmt: skip

    figure = draw_campaign(campaign)
    figure.canvas.draw()

    assert len(figure.axes) == 6


def test_the_figure_shows_tilt_in_degrees_and_latency_in_milliseconds_as_the_table_does():
    flights = [flight(max_tilt_rad=math.pi / 6, contact_known_s=0.036)] * 2
    campaign = {
        "scenario": "hover", "conf": 13, "reaction": "none", "disturbances": False,
        "of_paper": True, "first_seed": 0, "last_seed": 1,
        "flights": flights, "aggregate": aggregate(flights, 1.0),
    }  # fmt: skip
    legends = {a.get_xlabel(): str(a.get_legend().texts) for a in draw_campaign(campaign).axes}
    assert "median 30'" in legends["largest tilt [°]"]
    assert "median 36'" in legends["detection latency [ms]"]
