"""`tombo sweep` on the command line; what it flies: tombo_flight/test/sweep."""

from __future__ import annotations

import json

import pyarrow.parquet as pq
import pytest
from suite_bench import names

SHORT = ("hover", "--set", "duration=0.3", "--workers", "1")


@pytest.mark.slow
def test_a_sweep_leaves_table_page_and_what_was_flown(tombo, tmp_path):
    words = ("sweep", *SHORT, "vehicle.mass=1.1:1.3:0.1", "mission.height=1,2", "--seeds", "2:4")
    for number in ("", "-2"):
        result = tombo(*words)
        assert result.code == 0, result.err
        assert "12 flights: 0 of 12 crashed" in result.out
        folder = tmp_path / "runs" / f"sweep-hover{number}"
        assert names(folder) == {"flights.parquet", "sweep.html", "sweep.json"}
    table = pq.read_table(folder / "flights.parquet")
    assert table.column("seed").to_pylist() == [2, 3] * 6
    assert table.column("vehicle.mass").to_pylist() == [1.1] * 4 + [1.2] * 4 + [1.3] * 4
    (run, _) = tombo("runs", "--json").json
    assert (run["kind"], run["outcome"]) == ("sweep", "0 of 12 crashed")
    again = tombo(*words, "-o", str(folder), "--json").json
    assert (again["flights"], again["flown"]) == (12, 0)
    assert json.loads((folder / "sweep.json").read_text())["outcome"] == "0 of 12 crashed"


@pytest.mark.parametrize("given", ["vehicle={mass: 1,4}", "mission={height: 2,5}"])
def test_a_decimal_comma_in_a_mapping_gets_a_hint(refused, given):
    refused(("fly", "hover", "--set", given), given.partition("=")[0], "decimal point")
