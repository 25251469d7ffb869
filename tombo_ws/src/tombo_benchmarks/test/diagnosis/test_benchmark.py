"""A case of the blind benchmark, whole: hidden effects are named, with their size.

How often a healthy vehicle is accused is a rate: `test_benchmark_slice` asks twelve.
"""

import json

import pytest

from tombo_benchmarks.diagnosis.flight_cases import make_case
from tombo_benchmarks.diagnosis.flight_evaluation import examine
from tombo_benchmarks.diagnosis.score import score_of_flights

pytestmark = pytest.mark.slow

SEED = 3


@pytest.fixture(scope="module")
def row():
    """The first case that hides a large effect from poses and rotor speeds."""
    cases = (make_case(SEED, number) for number in range(400))
    like = ("single", "large", "mocap_rpm")
    number = next(c.number for c in cases if (c.kind, c.size, c.formulation) == like)
    return examine(SEED, number)


def test_a_large_effect_is_found(row):
    assert row["verdict"] in ("named", "set") and row["causes"][:1] == row["hidden"]
    if "parameters" in row:
        (compared,) = row["parameters"].values()
        assert compared["error"] < 0.3


def test_a_row_is_plain_and_scores(row):
    assert json.loads(json.dumps(row)) == row
    said = score_of_flights([row])
    assert said["mocap_only"]["top1_large"] == 1.0
    assert said["mocap_only"]["seconds_per_case"] > 0.0
