"""`tombo benchmark faults`: refused input, and the table of flights over nodes."""

from __future__ import annotations

import json

import pytest

from tombo_benchmarks.faults import fault_benchmark, fault_flights
from tombo_benchmarks.faults.fault_cases import single_cases

ROW = {
    "fault": "estimator stopped", "ends": "rotors off", "down_s": 6.5, "rotors_off_s": 1.4,
    "sink_m_s": 0.33, "drift_m": 1.3, "slid_m": 0.3, "flew_again": False,
}  # fmt: skip


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (("--nodes", "0.5"), "--nodes 0.5: out of bounds; accepted: 1 to 3600"),
        (("--nodes", "nan"), "--nodes nan: out of bounds"),
    ],
)
def test_what_is_out_of_bounds_is_refused(refused, arguments, complaint):
    refused(("benchmark", "faults", *arguments), complaint)


@pytest.mark.slow
def test_flights_over_nodes_are_rows_and_lines(tombo, monkeypatch):
    asked = []

    def fly(seconds, seed, progress, stop):
        asked.append((seconds, seed))
        return [ROW, {**ROW, "down_s": None, "ends": "hovers"}]

    monkeypatch.setattr(fault_flights, "fly_faults", fly)
    # all single faults and pairs: test/faults/test_fault_cases.py
    monkeypatch.setattr(fault_benchmark, "enumerated", lambda: [*single_cases()][:5])
    words = ("benchmark", "faults", "--cases", "2", "--nodes", "60", "--seed", "4")
    words += ("--workers", "1")
    aggregate = json.loads(tombo(*words, "--json").out)["aggregate"]
    assert aggregate["nodes"][0] == ROW
    assert (aggregate["enumerated"], aggregate["random"], aggregate["violations"]) == (5, 2, 0)
    out = tombo(*words).out
    assert "estimator stopped: rotors off" in out and "rotors off 1.4 s later" in out
    assert "hovers, drift 1.30 m" in out
    assert asked == [(60.0, 4)] * 2
