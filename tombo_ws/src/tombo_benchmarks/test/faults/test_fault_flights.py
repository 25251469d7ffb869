"""Verdict on a vehicle after a fault, from synthetic flights."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tombo_benchmarks.faults.fault_flights import after_fault

GROUND_M, AT_S, BEHIND_S = 0.18, 5.0, 30.0


def flight(height, speed, x=lambda t: 0.0 * t):
    """A record from functions of the time since the fault: height, rotor speed, place along x."""
    t = np.arange(0.0, AT_S + BEHIND_S + 5.0, 0.001)
    behind = t - AT_S
    position = np.column_stack([x(behind), 0.0 * t, GROUND_M + height(behind)])
    log = {
        "position": position,
        "velocity": np.gradient(position, 0.001, axis=0),
        "rotor_speed": np.repeat(speed(behind)[:, None], 4, axis=1),
    }
    return SimpleNamespace(t=t, log=log)


def sinking(t, begin_s=2.0, speed=0.4):
    return np.clip(1.8 - speed * (t - begin_s), 0.0, 1.8)


def turning(until_s):
    return lambda t: np.where(t < until_s, 480.0, 0.0)


def test_a_vehicle_that_holds_hovers():
    found = after_fault(flight(lambda t: 1.8 + 0.0 * t, turning(1e9)), GROUND_M, AT_S, BEHIND_S)
    assert found["ends"] == "hovers" and found["down_s"] is None and not found["flew_again"]


def test_a_descent_is_timed_from_the_fault_and_its_end_from_the_touchdown():
    found = after_fault(flight(sinking, turning(8.0)), GROUND_M, AT_S, BEHIND_S)
    assert found["ends"] == "rotors off"
    assert found["down_s"] == pytest.approx(2.0 + 1.77 / 0.4, abs=0.02)
    assert found["rotors_off_s"] == pytest.approx(8.0 - found["down_s"], abs=0.02)
    assert found["sink_m_s"] == pytest.approx(0.4, abs=0.01)
    assert found["slid_m"] == 0.0


def test_drift_is_before_and_sliding_behind_the_touchdown():
    record = flight(sinking, turning(8.0), lambda t: np.clip(0.1 * t, 0.0, 0.8))
    found = after_fault(record, GROUND_M, AT_S, BEHIND_S)
    assert found["drift_m"] == pytest.approx(0.1 * found["down_s"], abs=0.01)
    assert found["slid_m"] == pytest.approx(0.8 - found["drift_m"], abs=0.01)


def test_rotors_that_turn_on_the_ground_and_a_second_flight_are_seen():
    found = after_fault(flight(sinking, turning(1e9)), GROUND_M, AT_S, BEHIND_S)
    assert found["ends"] == "on the ground, rotors on" and found["rotors_off_s"] is None

    def again(t):
        return np.where(t < 20.0, sinking(t), 0.5)

    found = after_fault(flight(again, turning(1e9)), GROUND_M, AT_S, BEHIND_S)
    assert found["flew_again"]
