"""Recorded flights of a simulator by others: the hidden effect is named, and the score counts
it."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tombo_benchmarks.diagnosis.foreign_flights import aggregate, cases_in, examine
from tombo_dynamics.errors import InputError

RECORDINGS = Path(__file__).parents[1] / "recordings" / "rotorpy"
"""12 s of two flights of rotorpy 3.0.0, by `other_environments/rotorpy_flights.py --seed 0`."""


@pytest.mark.slow
def test_the_drag_of_another_simulator_is_found():
    row = examine(cases_in(RECORDINGS), 0, 0)
    assert row["condition"] == "drag"
    assert row["answer"] == "right", row["summary"]
    found, true = (row[key]["linear_rotor_drag.d_xy"] for key in ("found", "truth"))
    assert found == pytest.approx(true, rel=0.1)
    score = aggregate([row])
    assert (score["cases"], score["right"], score["wrong"]) == (1, 1, 0)


def test_a_folder_without_flights_and_a_truth_of_another_form_are_refused(tmp_path):
    with pytest.raises(InputError, match="no case"):
        cases_in(tmp_path)
    case = tmp_path / "a"
    shutil.copytree(RECORDINGS / "002_drag", case)
    (case / "truth.json").write_text(json.dumps({"truth": 3}))
    with pytest.raises(InputError, match=r"truth\.json"):
        examine(cases_in(tmp_path), 0, 0)
