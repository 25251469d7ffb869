"""The estimator stands still for 10 s in a hover of the running suite, then goes on."""

from __future__ import annotations

import pytest

from in_time import in_time
from tombo_benchmarks.faults import fault_flights
from tombo_benchmarks.faults.fault_flights import NodeFault, fly_faults
from tombo_dynamics.errors import InputError

pytestmark = pytest.mark.real_time

pytest.importorskip("rclpy")


LOW = ("mission.takeoff_time=0.2", "mission.climb_speed=1.0", "mission.height=1.2")


def test_the_vehicle_is_down_with_rotors_off_and_stays_so(monkeypatch):
    monkeypatch.setattr(fault_flights, "KINDS", {"stopped": 10.0})  # it is down by then
    monkeypatch.setattr(fault_flights, "_HOVER", [*fault_flights._HOVER, *LOW])
    monkeypatch.setattr(fault_flights, "_HOVER_S", 2.0)
    fault = NodeFault("estimator", "stopped")
    with in_time():
        try:
            (found,) = fly_faults(14.0, 0, lambda *_: None, lambda: False, [fault])
        except InputError as error:  # a machine that is late refuses the take-off
            raise AssertionError(str(error)) from error
        assert found["ends"] == "rotors off" and not found["flew_again"]
        assert 2.0 < found["down_s"] < 12.0 and found["rotors_off_s"] < 4.0
        assert found["sink_m_s"] < 0.6
        assert found["slid_m"] < 1.0
