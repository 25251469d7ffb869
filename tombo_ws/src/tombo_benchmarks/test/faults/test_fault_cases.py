"""The model checker: no sequence of faults ends in what must not be."""

from __future__ import annotations

import pytest

from tombo_benchmarks.faults.fault_cases import (
    Case,
    FaultAt,
    fly_case,
    pair_cases,
    random_case,
    single_cases,
    violations,
)
from tombo_benchmarks.faults.fault_model import Fault, Verdict
from tombo_control.safety.state_machine import TABLE, Condition, SafetyState


def _bad(cases: list[Case]) -> list[str]:
    found = []
    for case in cases:
        if wrong := violations(case, fly_case(case)):
            found.append(f"{' + '.join(one.text() for one in case)}: {', '.join(wrong)}")
    return found


@pytest.mark.slow
def test_no_single_fault_in_any_phase_violates_anything() -> None:
    assert _bad(list(single_cases())) == []


@pytest.mark.slow
def test_no_pair_of_faults_in_any_phase_violates_anything() -> None:
    assert _bad(list(pair_cases(seed=1))) == []


@pytest.mark.slow
def test_no_random_sequence_violates_anything() -> None:
    assert _bad([random_case(1, i) for i in range(1000)]) == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fault", "lasts_s", "state", "by"),
    [
        (Fault.MOCAP, None, SafetyState.LATCHED, Condition.TOUCHDOWN),
        (Fault.REACTION, None, SafetyState.LATCHED, Condition.TOUCHDOWN),
        (Fault.MISSION, None, SafetyState.LATCHED, Condition.TOUCHDOWN),
        (Fault.SETPOINT_FAR, None, SafetyState.LATCHED, Condition.TOUCHDOWN),
        (Fault.CONTROLLER, 0.5, SafetyState.LATCHED, Condition.DOWN),
        (Fault.SIMULATOR, 0.05, SafetyState.OFF, Condition.NEW_FLIGHT),
        (Fault.MOVED_FRAME, 0.05, SafetyState.LATCHED, Condition.LIMIT),
        (Fault.KILL, 0.05, SafetyState.LATCHED, Condition.KILL),
        (Fault.ABORT, 0.05, SafetyState.LATCHED, Condition.ABORT),
    ],
    ids=lambda value: getattr(value, "name", str(value)),
)
def test_where_each_loss_in_hover_ends(
    fault: Fault, lasts_s: float | None, state: SafetyState, by: Condition
) -> None:
    verdict = fly_case((FaultAt(fault, 4.0, lasts_s),))
    assert int(verdict.state) == state
    taken = [row.condition for i, row in enumerate(TABLE) if int(verdict.rows) >> i & 1]
    assert by in taken
    assert int(verdict.lift_offs) == 1


@pytest.mark.slow
def test_a_second_flight_takes_a_command_and_is_flown_then() -> None:
    down = (FaultAt(Fault.MOCAP, 4.0, 12.0),)
    assert int(fly_case(down).lift_offs) == 1
    again = (*down, FaultAt(Fault.TAKEOFF_COMMAND, 22.0, 0.05))
    assert int(fly_case(again).lift_offs) == 2


@pytest.mark.slow
def test_a_mission_that_is_restarted_behind_a_landing_does_not_fly_by_itself() -> None:
    restarted = (FaultAt(Fault.MOCAP, 4.0, 12.0), FaultAt(Fault.MISSION, 20.0, 5.0))
    assert int(fly_case(restarted).lift_offs) == 1
    commanded = (*restarted, FaultAt(Fault.TAKEOFF_COMMAND, 26.0, 0.05))
    assert int(fly_case(commanded).lift_offs) == 2


@pytest.mark.slow
@pytest.mark.parametrize(
    "case",
    [
        # the flight controller lands it while the blind one is away; a touchdown is not felt
        (FaultAt(Fault.ESTIMATOR, 10.683, None), FaultAt(Fault.IMU, 13.152, 8.0)),
        (
            FaultAt(Fault.IMU, 11.59, 2.0),
            FaultAt(Fault.IMU, 6.408, 0.4),
            FaultAt(Fault.ESTIMATOR, 3.387, 8.0),
        ),
        # back in its last moment: it would climb from the ground, and fall
        (
            FaultAt(Fault.ESTIMATOR, 15.736, None),
            FaultAt(Fault.IMU, 15.886, 8.0),
            FaultAt(Fault.CLOCK_BACK, 17.083, None),
        ),
        # the estimate jumps away from a set point at the border
        (FaultAt(Fault.OUT_OF_VOLUME, 6.891, None), FaultAt(Fault.MOVED_FRAME, 7.35, 0.05)),
        # another flight within the first second: the mission goes on
        (FaultAt(Fault.SIMULATOR, 1.006, 2.0), FaultAt(Fault.KILL, 17.64, 0.4)),
        # a second flight whose mission dies lands after the reaction's 30 s
        (FaultAt(Fault.TAKEOFF_COMMAND, 19.935, 0.05), FaultAt(Fault.MISSION, 24.908, None)),
    ],
)
def test_what_chance_has_found(case: Case) -> None:
    assert violations(case, fly_case(case)) == []


def test_the_checker_sees_what_must_not_be() -> None:
    verdict = Verdict.new()
    assert violations((), verdict) == []
    for name in ("thrust_after_touchdown", "uncommanded", "far_setpoints", "outside"):
        verdict[name] = 1
    verdict.still_on = True
    verdict.longest_ground = 10_000
    assert len(violations((), verdict)) == 6


def test_every_state_has_a_way_to_the_ground() -> None:
    """From every state some rows lead to rotors off, whatever else happens."""
    reached = {SafetyState.OFF, SafetyState.LATCHED}
    while more := {row.state for row in TABLE if row.then in reached} - reached:
        reached |= more
    assert reached == set(SafetyState)
    assert all(row.then != SafetyState.FLY for row in TABLE if row.state == SafetyState.LATCHED)
    assert all(row.then != SafetyState.FLY for row in TABLE if row.state == SafetyState.LAND)
