"""Faults of logs are named by a check, and never end as physics; sound flights have none."""

from dataclasses import replace

import pytest

from tombo_benchmarks.diagnosis.flight_cases import make_case
from tombo_benchmarks.diagnosis.flight_simulation import simulate_case
from tombo_benchmarks.diagnosis.mutations import MUTATIONS
from tombo_diagnosis.flight.diagnose import diagnose_flights
from tombo_diagnosis.flight.nominal import nominal_model
from tombo_dynamics.errors import InputError
from tombo_logs.checks import check_log
from tombo_logs.checks.rotors.motors import hover_of

pytestmark = pytest.mark.slow

SEED = 90211
"""Of other flights than those with which the checks were developed."""


@pytest.fixture(scope="module")
def flights():
    """Flights of several vehicles with nothing wrong but tolerances, with every sensor."""
    cases = (make_case(SEED, number, flights=2) for number in range(100))
    sound = [case for case in cases if case.kind == "none"][:2]
    logs = [log for c in sound for log in simulate_case(replace(c, formulation="imu_rpm"))]
    return [replace(log, exclude=()) for log in logs]


@pytest.fixture(scope="module")
def hover():
    nominal = nominal_model()
    return hover_of(nominal.label, nominal.vehicle, nominal.maps)


def named(fault, log, hover):
    try:
        found = check_log(fault.applied(log, (SEED,)), hover).findings
    except InputError as error:
        return fault.named_by_error(error)
    return fault.named_by(found)


def test_nine_of_ten_faults_are_named(flights, hover):
    tried = [(fault, flights[k % len(flights)]) for k, fault in enumerate(MUTATIONS)]
    missed = [fault.name for fault, log in tried if not named(fault, log, hover)]
    assert len(missed) <= 0.1 * len(tried), missed


def test_sound_flights_have_no_finding(flights, hover):
    said = [f for log in flights for f in check_log(log, hover).findings]
    assert [f.message for f in said if f.severity != "info"] == []


@pytest.mark.parametrize("name", ["motors: two swapped", "gyro: x and y swapped"])
def test_a_fault_does_not_end_as_physics(name, flights, hover):
    fault = next(f for f in MUTATIONS if f.name == name)
    checked = [
        check_log(fault.applied(log, (SEED, k)), hover) for k, log in enumerate(flights[:2])
    ]
    verdict = diagnose_flights(checked, nominal_model())[0]
    assert not verdict.causes and not verdict.set
    assert any(fault.named_by([f]) for f in verdict.prechecks)
