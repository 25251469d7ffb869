"""A first flight is stopped by each fault of a lab: the decisions, without nodes."""

from __future__ import annotations

import json
import math
import sys

import numpy as np
import pytest

from tombo_bringup.first_flight.checks import (
    Session,
    blockers_of,
    check_axes,
    fall_of,
    find_battery_fault,
    find_clock_fault,
    find_fence_faults,
    find_kill_fault,
    find_rotor_fault,
    parameter_differences,
    parameters_of,
)
from tombo_bringup.first_flight.runner import Answers, do_steps, steps_to_do
from tombo_bringup.first_flight.steps import STEPS, Step
from tombo_bringup.lab_file import Lab
from tombo_control.safety.params import FlightVolume
from tombo_dynamics.errors import InputError
from tombo_px4.bridge.vehicle_parameters import parameter_file

LIMITS = {"BAT_LOW_THR": 0.2, "BAT_CRIT_THR": 0.1, "BAT_EMERGEN_THR": 0.05, "COM_LOW_BAT_ACT": 2}
ROTORS = ["front_right ccw", "rear_left ccw", "front_left cw", "rear_right cw"]
FENCE = {"GF_ACTION": 5, "GF_MAX_HOR_DIST": 4.0, "GF_MAX_VER_DIST": 3.0}
NET = FlightVolume(x_min=-2.0, x_max=2.0, y_min=-1.5, y_max=1.5, z_max=2.5)
CHRONY = "C0A80101,192.168.1.1,3,0,{},0,0,0,0,0,0,0,0,{}"


def test_rotors_in_another_order_or_turning_the_other_way_are_named():
    assert find_rotor_fault(ROTORS) == ""
    assert "motor 1" in find_rotor_fault(["front_left cw"])
    assert "motor 3" in find_rotor_fault([*ROTORS[:2], "front_left ccw"])


def test_a_low_or_unknown_battery_is_named():
    assert find_battery_fault(0.9, LIMITS) == ""
    assert "30%" in find_battery_fault(0.3, LIMITS)
    assert "does not know" in find_battery_fault(math.nan, LIMITS)
    assert "COM_LOW_BAT_ACT" in find_battery_fault(0.9, {**LIMITS, "COM_LOW_BAT_ACT": 0})


def test_old_parameters_are_named_against_the_written_file():
    wanted = parameters_of(parameter_file())
    assert parameter_differences(wanted, wanted) == ""
    old = {**wanted, "COM_OBL_RC_ACT": 0.0}
    assert parameter_differences(old, wanted) == "COM_OBL_RC_ACT is 0, not 4"
    del old["COM_OBL_RC_ACT"]
    assert "COM_OBL_RC_ACT is not known" in parameter_differences(old, wanted)


def test_a_fence_must_be_around_the_volume():
    assert find_fence_faults(FENCE, NET) == ""
    assert "no volume" in find_fence_faults(FENCE, FlightVolume())
    assert "GF_MAX_VER_DIST is 0" in find_fence_faults({**FENCE, "GF_MAX_VER_DIST": 0.0}, NET)
    assert "GF_ACTION is 3" in find_fence_faults({**FENCE, "GF_ACTION": 3}, NET)


def test_a_clock_that_is_not_set_is_named():
    assert find_clock_fault(CHRONY.format("0.0001", "Normal")) == ""
    assert "50.0 ms off" in find_clock_fault(CHRONY.format("-0.05", "Normal"))
    assert "no clock" in find_clock_fault(CHRONY.format("0", "Not synchronised"))


@pytest.mark.parametrize(
    ("killed_s", "falls_s", "lack"),
    [
        (2.0, 2.0, ""),
        (math.nan, 3.0, "did not report"),  # it lands
        (0.2, 2.0, "0.02 m above"),
        (2.0, 3.5, "1.6 s later"),  # it said so, and flew on
        (2.0, 9.0, "inf s later"),
    ],
)
def test_a_kill_counts_in_the_air_alone_and_where_the_vehicle_falls(killed_s, falls_s, lack):
    t = np.arange(0.0, 5.0, 0.01)
    climb = np.minimum(0.1 * t, 0.12)
    fall = 0.5 * 9.81 * np.maximum(t - falls_s, 0.0) ** 2
    said = find_kill_fault(**fall_of(t, np.maximum(climb - fall, 0.0), killed_s))
    assert lack in said and bool(said) == bool(lack)


def test_only_blocking_findings_stop_the_proof_of_the_axes():
    values = {"mode": "hold", "findings": "blocks: axes | warning: late | blocks: up"}
    assert blockers_of(values) == "axes; up"
    assert blockers_of({**values, "findings": "warning: late"}) == ""
    assert blockers_of({"findings": ""}) != ""  # PX4 is not heard


class EndedBridge(Session):
    """A session whose `tombo up` loses its bridge."""

    def command_line(self, command: str, *more: str) -> list[str]:
        event = {"event": "ended", "node": "px4_bridge", "how": "exit code 1", "log": "b.log"}
        return [sys.executable, "-c", f"print({json.dumps(event)!r})"]


def test_a_bridge_that_ends_is_named_and_not_waited_for(tmp_path):
    session = EndedBridge(tmp_path / "lab.yaml", Lab(tmp_path), tmp_path, no_answer, no_answer)
    assert "exit code 1; its log: b.log" in check_axes(session).failure


def no_answer(*words: str) -> str:
    return ""


def test_a_list_goes_on_where_it_failed_and_repeats_what_may_have_changed():
    passed = {step.key: {"passed": True} for step in STEPS}
    assert steps_to_do(passed, None) == []
    later = {**passed, "axes": {"passed": False}}
    keys = [step.key for step in steps_to_do(later, None)]
    assert keys[:5] == ["mocap", "clocks", "battery", "kill_switch", "axes"]
    assert keys[-1] == "obstacle"
    with pytest.raises(InputError, match="axes is not passed"):
        steps_to_do(later, "hover")


def test_a_no_stops_the_list_and_is_written_down(tmp_path):
    person = Answers({"propellers": False})
    session = Session(tmp_path / "lab.yaml", Lab(tmp_path), tmp_path, person.ask, lambda text: 0)
    flown: list[str] = []
    asks = next(step for step in STEPS if step.key == "propellers")
    hover = Step("hover", "", "", "", lambda s: flown.append("hover"))  # type: ignore[func-returns-value, arg-type]
    assert not do_steps(session, [asks, hover], {})
    assert flown == []
    assert "passed: false" in (tmp_path / "first_flight.yaml").read_text()


def test_a_question_without_an_answer_is_bad_input():
    with pytest.raises(InputError, match="rotors"):
        Answers({}).ask("rotors", "Are all propellers off?")
