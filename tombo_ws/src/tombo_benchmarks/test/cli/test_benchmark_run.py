"""A benchmark that is stopped goes on where it was."""

from __future__ import annotations

import json
import math
from functools import partial
from pathlib import Path

import pytest

from tombo_benchmarks.cli.journal import Journal
from tombo_benchmarks.diagnosis.runner import run_benchmark
from tombo_dynamics.errors import InputError

CASES, SEED = 9, 5
RUN = "stand --seed 5"


def examine(folder: Path, seed: int, number: int) -> dict[str, object]:
    """Leave a trace of each call, across processes."""
    with (folder / "calls.txt").open("a", encoding="utf-8") as file:
        file.write(f"{number}\n")
    return {"number": number, "value": seed / 7 + number, "share": math.nan if number else None}


def score(rows) -> dict[str, object]:
    return {"cases": len(rows), "sum": sum(row["value"] for row in rows), "all": repr(rows)}


def run(folder, stop=None, kept=None):
    work = partial(examine, folder)
    return run_benchmark(work, score, CASES, SEED, 2, lambda *_: None, stop, kept)


def calls(folder):
    return (folder / "calls.txt").read_text(encoding="utf-8").split()


@pytest.mark.slow
def test_what_was_done_is_not_done_again_and_the_score_is_the_same(tmp_path):
    whole = run(tmp_path)
    (tmp_path / "calls.txt").unlink()
    path = tmp_path / "score.json.part"
    kept = Journal(path, RUN)
    run(
        tmp_path,
        lambda: len(kept.path.read_text().splitlines()) > 3 if path.exists() else False,
        kept,
    )
    with path.open("a", encoding="utf-8") as file:
        file.write('\n["stand --seed 5", 8, {"num')  # killed while it wrote
    known = Journal(path, RUN)
    done = len(known)  # the second run adds to them
    assert done >= 3
    (tmp_path / "calls.txt").unlink()
    again = run(tmp_path, None, known)
    assert again.aggregate == whole.aggregate
    assert len(calls(tmp_path)) == CASES - done
    assert sorted(Journal(path, RUN)) == list(range(CASES))


def test_scores_of_another_run_are_refused(tmp_path):
    path = tmp_path / "score.json.part"
    Journal(path, RUN)[0] = {"value": 1.0}
    with pytest.raises(InputError, match=f"'{RUN}', this is 'stand --seed 6'"):
        Journal(path, "stand --seed 6")


@pytest.mark.parametrize("line", ["5", "[[[[", ""])
def test_a_line_that_is_no_score_is_left_out(tmp_path, line):
    path = tmp_path / "score.json.part"
    path.write_text(f"{line}\n{json.dumps([RUN, 3, {'value': 2.0}])}\n", encoding="utf-8")
    assert Journal(path, RUN) == {3: {"value": 2.0}}
