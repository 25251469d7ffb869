"""A slice of the blind benchmark: short flights of healthy vehicles, and of one large effect."""

from functools import partial

import pytest

from tombo_benchmarks.diagnosis.flight_cases import make_case
from tombo_benchmarks.diagnosis.flight_evaluation import examine
from tombo_benchmarks.diagnosis.score import score
from tombo_flight.process.workers import run_in_processes

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

SEED, OF_EACH = 11, 4
SHORT = {"flights": 2, "course_s": 5.0}


def numbers(kind, size):
    """Return the first cases of a kind that have an IMU and rotor speeds."""
    cases = (make_case(SEED, n) for n in range(1000))
    like = (c.number for c in cases if (c.kind, c.size, c.formulation) == (kind, size, "imu_rpm"))
    return [next(like) for _ in range(OF_EACH)]


def test_healthy_vehicles_are_none_and_large_effects_come_first():
    asked = numbers("none", "") + numbers("single", "large")
    rows = list(run_in_processes(partial(examine, SEED, **SHORT), asked, 2))
    result = score([row for row in rows if row["verdict"] != "not flown"])
    assert result["healthy_cases"] == OF_EACH and result["false_alarm"] <= 1 / OF_EACH, rows
    assert result["top1_large_cases"] >= OF_EACH - 1 and result["top1_large"] >= 0.75, rows
