"""Arming, modes, fail-safes: who is refused what, with which words, and when it acts by itself."""

from __future__ import annotations

from typing import Any

import pytest
from vehicle_bench import table_with

from tombo_px4 import modes
from tombo_px4.autopilot.commander import DESCEND, BatteryCharge, Commander, CommanderInput
from tombo_px4.autopilot.setpoint_controller import ControlLevel
from tombo_px4.modes import Result

FULL = BatteryCharge(12.6, 1.0, 1.0, 0)
WELL = CommanderInput(
    tick=10_000,
    attitude=True,
    local_position=True,
    global_position=True,
    landed=True,
    maybe_landed=True,
    taken_off=False,
    signal_tick=10_000,
    kind=ControlLevel.POSITION,
    battery=FULL,
)
MANUAL_MODES = (modes.MANUAL, modes.ALTCTL, modes.POSCTL, modes.ACRO, modes.STABILIZED)
NO_GLOBAL = {"global_position": False}
LOST = {"local_position": False, "global_position": False}


class Desk:
    """A commander, its situation, and its messages."""

    def __init__(self, mode: modes.Mode = modes.AUTO_HOLD, **parameters: float) -> None:
        self.texts: list[str] = []
        self.commander = Commander(
            table_with(**parameters), lambda severity, text: self.texts.append(text)
        )
        self.now = WELL
        assert self.commander.set_mode(mode, self.now) == Result.ACCEPTED

    def see(self, **changes: Any) -> None:
        self.now = self.now._replace(**changes)
        self.commander.update(self.now)

    def wait(self, seconds: float, stream: bool = True, **changes: Any) -> None:
        for _ in range(round(seconds * 50)):
            tick = self.now.tick + 20
            changes["signal_tick"] = tick if stream else self.now.signal_tick
            self.see(tick=tick, **changes)

    def fly(self) -> Desk:
        assert self.commander.arm(self.now) == Result.ACCEPTED, self.texts
        self.wait(10.0, landed=False, maybe_landed=False, taken_off=True)
        self.texts.clear()
        return self

    def heard(self, text: str) -> bool:
        return any(text in sent for sent in self.texts)


# --- Arming ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "changes", "why"),
    [
        (modes.AUTO_HOLD, {}, ""),
        (modes.AUTO_HOLD, {"attitude": False}, "No valid attitude estimate"),
        (modes.AUTO_HOLD, LOST, "No valid position estimate"),
        (modes.AUTO_HOLD, NO_GLOBAL, "No valid global position estimate"),
        (modes.AUTO_TAKEOFF, {}, ""),
        (modes.AUTO_TAKEOFF, NO_GLOBAL, ""),
        (modes.AUTO_TAKEOFF, LOST, "No valid position estimate"),
        (modes.AUTO_LAND, {}, "Mode not suitable for arming"),
        (modes.AUTO_RTL, {}, "Mode not suitable for arming"),
        (modes.AUTO_MISSION, {}, "No valid mission available"),
        *((mode, {}, "No manual control input") for mode in MANUAL_MODES),
        (modes.OFFBOARD, {}, ""),
        (modes.OFFBOARD, NO_GLOBAL, ""),
        (modes.OFFBOARD, {"signal_tick": -1}, "No offboard signal"),
        (modes.OFFBOARD, {"signal_tick": 8_900}, "No offboard signal"),
        (modes.OFFBOARD, LOST, "No valid position estimate"),
        (modes.OFFBOARD, {**LOST, "kind": ControlLevel.VELOCITY}, "No valid position estimate"),
        (modes.OFFBOARD, {**LOST, "kind": ControlLevel.ATTITUDE}, ""),
        (modes.AUTO_HOLD, {"battery": FULL._replace(warning=2)}, "Critical battery"),
        (modes.AUTO_HOLD, {"battery": FULL._replace(warning=1)}, ""),
    ],
)
def test_who_may_arm(mode, changes, why):
    desk = Desk(mode)
    desk.see(**changes)
    assert any(why in p for p in desk.commander.problems(desk.now)) == bool(why)
    result = desk.commander.arm(desk.now)
    if why:
        assert result == Result.TEMPORARILY_REJECTED and not desk.commander.armed
        assert desk.heard("Arming denied: Resolve system health failures first")
        assert desk.heard(f"Preflight Fail: {why}") or desk.heard(why)
    else:
        assert result == Result.ACCEPTED and desk.commander.armed
        assert desk.heard("Armed by")


def test_disarming_in_the_air_needs_force():
    desk = Desk().fly()
    assert desk.commander.disarm(desk.now, False) == Result.TEMPORARILY_REJECTED
    assert desk.commander.armed and desk.heard("Disarming denied: not landed")
    assert desk.commander.disarm(desk.now, True) == Result.ACCEPTED
    assert not desk.commander.armed


# --- Offboard lost ---------------------------------------------------------------------------


def test_the_stream_is_lost_after_the_time_that_is_set():
    desk = Desk(modes.OFFBOARD, COM_OF_LOSS_T=2.0).fly()
    desk.wait(1.98, stream=False)
    assert desk.commander.mode == modes.OFFBOARD
    desk.wait(0.06, stream=False)
    assert desk.commander.failsafe and desk.commander.mode == modes.AUTO_RTL
    assert desk.heard("Failsafe activated")


@pytest.mark.parametrize(
    ("action", "changes", "mode"),
    [
        *((action, {}, modes.AUTO_RTL) for action in range(4)),
        (4, {}, modes.AUTO_LAND),
        (5, {}, modes.AUTO_HOLD),
        (0, NO_GLOBAL, modes.AUTO_LAND),
        (5, NO_GLOBAL, modes.AUTO_LAND),
        (0, LOST, modes.ALTCTL),
        (0, LOST | {"altitude": False}, modes.STABILIZED),
        (3, LOST, DESCEND),
        (4, LOST, DESCEND),
    ],
)
def test_what_is_done_when_the_stream_is_lost(action, changes, mode):
    desk = Desk(modes.OFFBOARD, COM_OBL_RC_ACT=action).fly()
    desk.wait(1.1, stream=False, **changes)
    assert desk.commander.mode == mode and desk.commander.armed


@pytest.mark.parametrize(("action", "again"), [(6, False), (7, True)])
def test_terminate_and_disarm_stop_the_rotors(action, again):
    desk = Desk(modes.OFFBOARD, COM_OBL_RC_ACT=action).fly()
    desk.wait(1.1, stream=False)
    assert not desk.commander.armed
    desk.wait(0.1, landed=True, maybe_landed=True)
    assert (desk.commander.arm(desk.now) == Result.ACCEPTED) == again


# --- By itself -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("parameter", "taken_off", "reason"),
    [("COM_DISARM_LAND", True, "landing"), ("COM_DISARM_PRFLT", False, "preflight")],
)
def test_it_disarms_by_itself(parameter, taken_off, reason):
    desk = Desk(**{parameter: 3.0})
    desk.commander.arm(desk.now)
    desk.wait(2.9, taken_off=taken_off)
    assert desk.commander.armed
    desk.wait(0.3)
    assert not desk.commander.armed and desk.heard(reason)
    desk = Desk(**{parameter: -1.0})
    desk.commander.arm(desk.now)
    desk.wait(30.0, taken_off=taken_off)
    assert desk.commander.armed


@pytest.mark.parametrize(
    ("action", "warning", "mode"),
    [
        (0, 3, modes.OFFBOARD),
        (2, 1, modes.OFFBOARD),
        (2, 2, modes.AUTO_LAND),
        (3, 2, modes.AUTO_RTL),
        (3, 3, modes.AUTO_LAND),
    ],
)
def test_battery(action, warning, mode):
    desk = Desk(modes.OFFBOARD, COM_LOW_BAT_ACT=action).fly()
    desk.wait(0.1, battery=FULL._replace(warning=warning, remaining=0.06))
    assert desk.commander.mode == mode
    assert desk.heard("attery")
