"""Synthetic cases: hidden effect, its size, and equal cases of equal seeds."""

from dataclasses import asdict

import numpy as np
import pytest

from tombo_benchmarks.diagnosis.cases import SIZES
from tombo_benchmarks.diagnosis.disturbances import DISTURBANCES
from tombo_benchmarks.diagnosis.flight_cases import (
    NOMINAL,
    UNOBSERVABLE_PARAMETERS,
    make_case,
    nominal_value,
    observable_effects,
)
from tombo_benchmarks.diagnosis.flight_simulation import simulate_case
from tombo_diagnosis.flight.nominal import PARAMETERS
from tombo_dynamics.effects import REGISTRY

CASES = [make_case(5, number) for number in range(400)]


def of(kind):
    return [case for case in CASES if case.kind == kind]


def test_a_case_follows_from_seed_and_number():
    for case in CASES[:20]:
        assert asdict(make_case(5, case.number)) == asdict(case)
    assert asdict(make_case(6, 3)) != asdict(make_case(5, 3)) != asdict(make_case(5, 4))


def test_in_a_healthy_case_nothing_is_hidden():
    """But nothing is exactly nominal either: it is off by what a careful lab leaves."""
    for case in of("none"):
        assert case.hidden == () and not case.shift and not case.disturbance and not case.size
    off = [
        (case.effects.get(p.effect, {}).get(p.name, p.null) - nominal_value(p)) / p.tolerance
        for case in of("none")
        for p in PARAMETERS
        if nominal_value(p) > p.low + 3.0 * p.tolerance and p.tolerance
    ]
    assert np.abs(off).max() < 4.5
    assert np.std([o for o in off if o]) == pytest.approx(1.0, abs=0.1)
    assert len([o for o in off if o]) > 0.6 * len(off)


@pytest.mark.parametrize("name", ["hanging_load", "steady_wind", "mocap_dropouts"])
def test_a_vehicle_has_nothing_of_what_healthy_ones_never_have_unless_it_is_hidden(name):
    for case in CASES:
        assert name in case.hidden or case.effects.get(name) == NOMINAL.get(name)


def test_what_is_hidden_has_the_size_that_is_said():
    """Length of the change, in sizes that clearly matter; bounds may cut it short."""
    scales = {p.label: p.scale for p in PARAMETERS}
    for case in of("single"):
        (name,) = case.hidden
        assert name in observable_effects(case.formulation) and case.shift
        assert all(
            label.startswith(f"{name}.") and label not in UNOBSERVABLE_PARAMETERS
            for label in case.shift
        )
        if name in ("gusts", "mocap_dropouts"):
            continue
        length = np.linalg.norm([v / scales[label] for label, v in case.shift.items()])
        tolerance = 0.05 * 4.0 * np.sqrt(len(case.shift))
        assert length < 1.25 * SIZES[case.size] + tolerance
        assert length > 0.8 * SIZES[case.size] - tolerance or near_a_bound(case)


def near_a_bound(case):
    shifted = [p for p in PARAMETERS if p.label in case.shift]
    return any(case.effects[p.effect][p.name] in (p.low, p.high) for p in shifted)


def test_pairs_hide_two_and_are_never_small():
    for case in of("pair"):
        assert len(set(case.hidden)) == 2 and case.size in ("medium", "large")
        assert {label.split(".")[0] for label in case.shift} == set(case.hidden)


def test_unknown_forces_are_in_no_registry_and_of_the_size_that_is_said():
    seen = set()
    for case in of("unknown"):
        (name,) = case.hidden
        seen.add(name)
        assert name not in REGISTRY and not case.shift
        kind = DISTURBANCES[name]
        for value, (p, typical) in zip(case.disturbance, kind.typical.items(), strict=True):
            if p in kind.strength and typical:
                assert 0.8 <= value / typical <= 2.0
    assert seen == set(DISTURBANCES)


@pytest.mark.slow
def test_flights_of_a_case_are_reproducible_and_have_the_sensor_data():
    case = next(c for c in (make_case(2, n, flights=1) for n in range(50))
                if c.kind == "none" and c.formulation == "mocap_rpm")  # fmt: skip
    (one,), (other,) = simulate_case(case), simulate_case(case)
    assert set(one.series) == {"position", "attitude", "rotor_command", "rotor_speed", "voltage"}
    for name, series in one.series.items():
        assert np.array_equal(series.values, other.series[name].values)
    assert one.name == "flight 1" and one.duration_s > 15.0
    again = make_case(3, case.number, flights=1)
    assert not np.array_equal(simulate_case(again)[0].series["voltage"].values[:50],
                              one.series["voltage"].values[:50])  # fmt: skip
