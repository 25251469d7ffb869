"""`tombo benchmark faults`: its counts as JSON and as lines."""

from __future__ import annotations

import json

import pytest

from tombo_benchmarks.faults import fault_benchmark
from tombo_benchmarks.faults.fault_cases import single_cases


@pytest.mark.slow
def test_counts_of_all_cases_are_printed(tombo, monkeypatch):
    # all single faults and pairs: test/faults/test_fault_cases.py
    monkeypatch.setattr(fault_benchmark, "enumerated", lambda: [*single_cases()][:5])
    words = ("benchmark", "faults", "--cases", "2", "--seed", "4", "--workers", "1")
    aggregate = json.loads(tombo(*words, "--json").out)["aggregate"]
    assert (aggregate["enumerated"], aggregate["random"], aggregate["violations"]) == (5, 2, 0)
    assert "2 random sequences: 0 with a violation" in tombo(*words).out
