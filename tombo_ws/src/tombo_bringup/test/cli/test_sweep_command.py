"""`tombo sweep` and `tombo fly --seeds`; their flights: tombo_flight/test/sweep."""

from __future__ import annotations

import json

import pyarrow.parquet as pq
import pytest
from suite_bench import names

from tombo_flight.flight import fly_scenario
from tombo_flight.flight_output import flight_summary
from tombo_flight.scenario import load_scenario

SHORT = ("hover", "--set", "duration=0.3", "--workers", "1")
FILES = {"flights.parquet", "sweep.html", "sweep.json"}


@pytest.mark.slow
def test_a_sweep_leaves_table_page_and_what_was_flown(tombo, tmp_path):
    words = ("sweep", *SHORT, "vehicle.mass=1.1:1.3:0.1", "mission.height=1,2", "--seeds", "2:4")
    for number in ("", "-2"):
        result = tombo(*words)
        assert result.code == 0, result.err
        assert "12 flights: 0 of 12 crashed" in result.out
        folder = tmp_path / "runs" / f"sweep-hover{number}"
        assert names(folder) == FILES
    table = pq.read_table(folder / "flights.parquet")
    assert table.column("seed").to_pylist() == [2, 3] * 6
    assert table.column("vehicle.mass").to_pylist() == [1.1] * 4 + [1.2] * 4 + [1.3] * 4
    again = tombo(*words, "-o", str(folder), "--json").json
    assert (again["flights"], again["flown"]) == (12, 0)
    assert json.loads((folder / "sweep.json").read_text())["outcome"] == "0 of 12 crashed"


@pytest.mark.slow
def test_many_seeds_of_fly_are_a_sweep_of_the_single_flights(tombo, tmp_path):
    words = ("fly", "--set", "propeller.conf=10", "--set", "duration=26", "--seeds", "4:9")
    result = tombo(*words, "-o", "c", "--json")
    assert (result.code, result.err) == (0, "")
    assert names(tmp_path / "c") == FILES
    scenario = load_scenario("paper_collision", ["duration=26", "propeller.conf=10"])
    alone = [flight_summary(fly_scenario(scenario, seed)) for seed in range(4, 9)]
    rows = pq.read_table(tmp_path / "c" / "flights.parquet").to_pylist()
    for key in ("crashed", "strikes", "max_falling_distance_m", "detection_latency_s"):
        assert [row[key] for row in rows] == [summary[key] for summary in alone]
    total = result.json["aggregate"]
    assert total["flights"] == 5 and not result.json["of_paper"], "the paper has another propeller"
    assert total["crashed"] == sum(summary["crashed"] for summary in alone)
    assert total["max_falling_distance_m"]["max"] == pytest.approx(
        max(summary["max_falling_distance_m"] for summary in alone), abs=1e-6
    )
    refused = tombo("fly", "--seeds", "4:10", "-o", "c")
    assert refused.code == 2 and "another seeds" in refused.err
