"""Two cases of the blind benchmark: what is hidden is found, and nothing else is named."""

import json

import pytest

from tombo_benchmarks.diagnosis.flight_cases import make_case
from tombo_benchmarks.diagnosis.flight_evaluation import examine
from tombo_benchmarks.diagnosis.score import score_of_flights

pytestmark = pytest.mark.slow

SEED = 3


def first(count, kind, size, formulations):
    """Return numbers of the first cases of a kind, no two of them hiding the same."""
    found = {}
    for number in range(400):
        case = make_case(SEED, number)
        if (case.kind, case.size) == (kind, size) and case.formulation in formulations:
            found.setdefault(case.hidden, number)
    return list(found.values())[:count]


IMU, MOCAP = ("imu", "imu_rpm"), ("mocap_rpm",)


@pytest.fixture(scope="module")
def rows():
    large = first(1, "single", "large", MOCAP)
    healthy = first(1, "none", "", IMU)
    return [examine(SEED, number) for number in large + healthy]


def test_a_large_effect_is_found(rows):
    row = rows[0]
    assert row["verdict"] in ("named", "set") and row["causes"][:1] == row["hidden"]
    if "parameters" in row:
        (compared,) = row["parameters"].values()
        assert compared["error"] < 0.3
        assert row["gain_share"] is None or row["gain_share"] > 0.8


def test_no_name_is_given_where_none_is_due(rows):
    assert (rows[1]["kind"], rows[1]["verdict"]) == ("none", "none")


def test_rows_are_plain_and_score(rows):
    assert json.loads(json.dumps(rows)) == rows
    said = score_of_flights(rows)
    assert said["mocap_only"]["top1_large"] == 1.0
    assert said["false_alarm"] == 0.0
    assert said["seconds_per_case"] > 0.0
