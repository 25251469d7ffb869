"""Recorded crashes of rotorpy do what they are called, and `why` names them from their logs.

`recordings/orders.json` makes the recordings again, in their folder:
`PYTHONPATH=../.. ENV/bin/python ../../other_environments/rotorpy_crashes.py orders.json`.
"""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from tombo_benchmarks.why.crash_benchmark import aggregate, examine_crash, read_crash
from tombo_benchmarks.why.mishap import Mishap, began

RECORDINGS = Path(__file__).parents[1] / "recordings"
ORDERS = json.loads((RECORDINGS / "orders.json").read_text())
SEEDS = {order["kind"]: tuple(order["seed"]) for order in ORDERS}


def test_a_stopped_vehicle_falls_freely_from_the_time_of_the_mishap():
    mishap = Mishap.draw("killed", np.random.default_rng(SEEDS["killed"]))
    rows, start = read_crash(RECORDINGS / "killed.npz")
    assert start == pytest.approx(mishap.time, abs=0.01)
    before, after = rows[rows[:, 0] < start], rows[rows[:, 0] > start + 0.2]
    assert before[:, 13].mean() == pytest.approx(9.8, abs=0.5)
    assert np.abs(after[:20, 13]).max() < 2.0


@pytest.mark.slow
@pytest.mark.parametrize("kind", SEEDS)
def test_cause_and_time_of_a_crash_are_named_from_its_log(kind):
    row = examine_crash(kind, SEEDS[kind], *read_crash(RECORDINGS / f"{kind}.npz"))
    assert row["said"] == row["cause"]
    assert row["said_s"] == pytest.approx(row["time_s"], abs=0.1)


def test_the_score_counts_wrong_answers_and_abstentions_apart():
    row = {"kind": "killed", "cause": "kill", "time_s": 1.0, "said_s": 1.05, "confidence": 0.9}
    said = [row | {"said": s} for s in ("kill", "battery", "unknown", "set")]
    score = aggregate(said)
    assert (score["right"], score["wrong"], score["abstained"]) == (0.25, 1, 2)
    assert score["in_time"] == 1.0
    assert score["kinds"]["motor_stopped"] == {"cases": 0}


def test_loops_that_swing_deviate_when_their_rates_do():
    mishap = Mishap.draw("gains_too_high", np.random.default_rng(5))
    t = np.arange(0.0, mishap.time + 1.0, 0.01)
    rates = np.where(t[:, None] > mishap.time + 0.3, 2.0, 0.1 * np.sin(t)[:, None]) * np.ones(3)
    command = 500.0 + np.sin(t)[:, None] * np.array([1.0, -1.0, 1.0, -1.0])
    assert began(mishap, t, rates, command, mishap.time) == pytest.approx(
        mishap.time + 0.3, abs=0.02
    )


def test_a_python_without_rotorpy_is_refused(tombo):
    for python in ("/no/such/python", sys.executable):
        result = tombo("benchmark", "why", "--rotorpy", python)
        assert result.code == 2
        assert f"--rotorpy '{python}' can't import rotorpy; accepted: " in result.err
