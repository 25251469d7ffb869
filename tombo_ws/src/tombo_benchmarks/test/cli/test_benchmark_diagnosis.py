"""`tombo benchmark diagnosis` on the command line."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import pytest

from tombo_benchmarks.diagnosis import runner

GOOD = {
    "top1_large": 0.98, "top1_medium": 0.9, "top1_small": 0.7, "right_if_named": 0.99,
    "truth_in_set": 1.0, "mean_set_size": 1.2,
    "another_named": 0.0, "false_alarm": 0.03, "unknown_wrongly_named": 0.0,
    "parameter_error_median": 0.01, "parameter_error_p90": 0.2, "coverage_95": 0.94,
    "seconds_per_case": None,
}  # fmt: skip


@dataclass(frozen=True)
class Scored:
    cases: list[dict[str, Any]] = field(default_factory=lambda: [{"truth": ["mass_error"]}])
    aggregate: dict[str, Any] = field(
        default_factory=lambda: {**GOOD, "mocap_only": {**GOOD, "top1_large": float("nan")}}
    )


@pytest.fixture
def blind(monkeypatch):
    """The benchmark, without its hour of work."""
    asked: list[Any] = []

    def run(examine, aggregate, cases, seed, workers, progress, stop, kept):
        asked.append((cases, seed, workers))
        progress("1 of 1 cases", 1.0)
        return Scored()

    monkeypatch.setattr(runner, "run_benchmark", run)
    return asked


def test_the_score_is_printed_beside_what_is_asked_for(tombo, blind):
    result = tombo("benchmark", "diagnosis", "--cases", "1", "--seed", "7", "--workers", "1")
    assert result.code == 0, result.err
    assert blind == [(1, 7, 1)]
    lines = {" ".join(line.split()) for line in result.out.splitlines()}
    assert "asked for all mocap only" in lines
    assert "right cause first, large effect >= 97.0 % 98.0 % –" in lines
    assert "95 % intervals that cover the truth 90.0 % to 98.0 % 94.0 % 94.0 %" in lines
    assert "mean size of the set <= 2.00 1.20 1.20" in lines
    assert "run time of a case [s] <= 5.00 – –" in lines


def test_the_score_as_json(tombo, blind, tmp_path):
    result = tombo("benchmark", "diagnosis", "--cases", "1", "--json", "-o", "b.json")
    assert result.json["aggregate"]["top1_large"] == 0.98
    assert result.json["aggregate"]["mocap_only"]["top1_large"] is None
    assert result.json["cases"] == [{"truth": ["mass_error"]}]
    assert (tmp_path / "b.json").read_text() == result.out
    assert [path.name for path in tmp_path.iterdir()] == ["b.json"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--cases", "0"), ("--cases 0", "1 to")),
        (("-o", "nowhere/b.json"), ("nowhere/b.json", "No such file")),
    ],
)
def test_a_benchmark_that_can_not_be_run_is_refused(refused, arguments, words):
    refused(("benchmark", "diagnosis", *arguments), *words)
