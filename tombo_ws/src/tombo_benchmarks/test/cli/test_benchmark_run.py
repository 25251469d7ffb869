"""A benchmark that is stopped scores the cases that are done."""

from __future__ import annotations

import pytest

from tombo_benchmarks.diagnosis.runner import run_benchmark

CASES, SEED = 9, 5


def examine(seed: int, number: int) -> dict[str, object]:
    return {"number": number, "value": seed / 7 + number}


def score(rows) -> dict[str, object]:
    return {"cases": len(rows), "sum": sum(row["value"] for row in rows)}


def test_the_score_is_of_all_cases_or_of_the_first_ones():
    done = []
    whole = run_benchmark(examine, score, CASES, SEED, 1, lambda *_: None)
    assert whole.aggregate == {"cases": CASES, "sum": pytest.approx(CASES * SEED / 7 + 36)}
    some = run_benchmark(
        examine, score, 10_000, SEED, 1, lambda *_: done.append(1), lambda: len(done) > 3
    )
    assert 3 < some.aggregate["cases"] < 10_000
    assert [row["number"] for row in some.cases] == list(range(len(some.cases)))
