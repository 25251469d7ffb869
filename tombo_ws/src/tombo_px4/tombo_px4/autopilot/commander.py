"""Arming, modes and fail-safes of PX4's commander, and the states by which it decides."""

from __future__ import annotations

import math
from collections.abc import Callable
from enum import IntEnum
from typing import NamedTuple

from tombo_dynamics.plant import Plant
from tombo_dynamics.time_base import TICK_HZ
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.setpoint_controller import ControlLevel
from tombo_px4.modes import (
    ACRO,
    ALTCTL,
    AUTO_HOLD,
    AUTO_LAND,
    AUTO_MISSION,
    AUTO_READY,
    AUTO_RTL,
    MANUAL,
    MODE_NAMES,
    OFFBOARD,
    POSCTL,
    STABILIZED,
    Mode,
    Result,
    Severity,
)


class TakeoffState(IntEnum):
    """State of a take-off (PX4 `takeoff_status`)."""

    DISARMED = 1
    SPOOLUP = 2
    READY = 3
    RAMPUP = 4
    FLIGHT = 5


class BatteryCharge(NamedTuple):
    """State of the battery."""

    voltage: float
    """[V]."""
    current: float
    """Drawn [A]."""
    remaining: float
    """Share of the charge, 1: full."""
    warning: int
    """0 none, 1 low, 2 critical, 3 emergency."""


_EFFICIENCY = 0.7
"""Of drives and motors, as in the effect `battery_sag`."""
_LEVELS = ("BAT_LOW_THR", "BAT_CRIT_THR", "BAT_EMERGEN_THR")


class BatteryMeter:
    """Counts the charge of one pack, full at first; `voltage` [V] is that of the full pack."""

    def __init__(self, voltage: float, parameters: ParameterTable) -> None:
        self._voltage = voltage
        self._parameters = parameters
        self._used_mah = 0.0

    def empty(self) -> None:
        """Let nothing be left."""
        self._used_mah = math.inf

    def draw(self, plant: Plant, seconds: float) -> BatteryCharge:
        """Count what the plant has drawn; without a battery in it, from power and voltage."""
        voltage, current = float(plant.supply.voltage), float(plant.supply.current)
        if voltage <= 0.0 or current <= 0.0:
            voltage = self._voltage
            power = float(plant.rotor_torque @ plant.rotor_speed)
            current = power / (_EFFICIENCY * voltage)
        self._used_mah += current * seconds / 3.6
        get = self._parameters.get
        capacity = get("BAT1_CAPACITY")
        remaining = 1.0 if capacity <= 0.0 else max(1.0 - self._used_mah / capacity, 0.0)
        warning = sum(remaining < get(name) for name in _LEVELS)
        return BatteryCharge(voltage, current, remaining, warning)


_CONTACT_TICKS, _MAYBE_TICKS, _LANDED_TICKS = 350, 250, 300


class LandDetector:
    """Ground contact, then maybe landed, then landed."""

    def __init__(self) -> None:
        self.contact_ticks = 0
        """It has looked like standing for so long."""
        self.landed = True

    @property
    def contact(self) -> bool:
        """It touches the ground: the thrust may fall."""
        return self.landed or self.contact_ticks >= _CONTACT_TICKS

    @property
    def maybe_landed(self) -> bool:
        """It very likely stands: it may be disarmed."""
        return self.landed or self.contact_ticks >= _CONTACT_TICKS + _MAYBE_TICKS

    def stay(self, landed: bool) -> None:
        """Say that it is on the ground, or leaves it, whatever its motion looks like."""
        self.landed, self.contact_ticks = landed, 0

    def update(self, stands: bool, ticks: int) -> None:
        """Count whether it looks like standing, in the last `ticks` ticks of a flight."""
        self.contact_ticks = self.contact_ticks + ticks if stands else 0
        self.landed = self.contact_ticks >= _CONTACT_TICKS + _MAYBE_TICKS + _LANDED_TICKS


DESCEND = Mode(-1)
"""Level descent without a position; a heartbeat shows it as land."""
TERMINATE = Mode(-2)
"""Rotors off for good; a heartbeat shows it as manual."""
_MANUAL_MODES = (MANUAL, ALTCTL, POSCTL, ACRO, STABILIZED)
_TITLES = {mode: name.capitalize() for mode, name in MODE_NAMES.items() if mode != AUTO_READY}
_TITLES |= {DESCEND: "Descend", TERMINATE: "Termination"}
_NOT_FOR_ARMING = (AUTO_LAND, AUTO_RTL)
"""Modes that end a flight; after it the mode before is back."""
_RETURNS = (AUTO_RTL, AUTO_LAND, DESCEND, DESCEND)
_LANDS = (AUTO_LAND, AUTO_LAND, DESCEND, DESCEND)
FAILSAFES = {
    0: (AUTO_RTL, AUTO_LAND, ALTCTL, STABILIZED),
    1: (AUTO_RTL, AUTO_LAND, DESCEND, STABILIZED),
    2: _RETURNS,
    3: _RETURNS,
    4: _LANDS,
    5: (AUTO_HOLD, AUTO_LAND, DESCEND, DESCEND),
    6: 4 * (TERMINATE,),
    7: 4 * (TERMINATE,),
}
"""COM_OBL_RC_ACT -> mode after OFFBOARD is lost while PX4 knows its place on earth, in map, its
height alone, none of them. PX4 1.17 without a remote control and with NAV_RCL_ACT 2, its default:
in altitude and stabilized mode nobody steers. Recorded: `test/autopilot/recorded_losses.yaml`."""
_NO_SIGNAL = "No offboard signal"
_NO_STICKS = "No manual control input"
_NO_POSITION = "Navigation error: No valid position estimate"
_BATTERY = ("", "Low battery", "Critical battery", "Emergency battery level")

Say = Callable[[Severity, str], None]


class CommanderInput(NamedTuple):
    """State of the vehicle by which the commander decides."""

    tick: int
    attitude: bool
    local_position: bool
    global_position: bool
    landed: bool
    maybe_landed: bool
    taken_off: bool
    """It has been in the air since arming."""
    signal_tick: int
    """Tick of the last valid set point; negative: none ever came."""
    kind: ControlLevel
    """Of that set point."""
    battery: BatteryCharge
    altitude: bool = True
    """The height is known; without poses for longer than x and y, with a barometer always."""


class Commander:
    """Which mode the vehicle flies in, and whether its rotors may turn."""

    def __init__(self, parameters: ParameterTable, say: Say) -> None:
        self._parameters = parameters
        self._say = say
        self.armed = False
        self.user_intended_mode: Mode = AUTO_HOLD
        """Mode that the user asked for."""
        self.mode: Mode = AUTO_HOLD
        """Mode that is flown."""
        self.failsafe = False
        self.terminated = False
        self.killed_tick = -1
        """When the kill switch was switched on; negative: it is off."""
        self._landed_tick = -1
        self._battery_reported = 0
        self._battery_failsafe: tuple[Mode, ...] | None = None
        self._after_disarming: Mode = AUTO_HOLD

    # --- what is possible

    def missing(self, mode: Mode, now: CommanderInput) -> str:
        """Return the missing inputs of a mode; "" if nothing."""
        if mode == TERMINATE:
            return ""
        if not now.attitude:
            return "No valid attitude estimate"
        if mode == DESCEND:
            return ""
        if mode in _MANUAL_MODES:
            return _NO_STICKS
        if mode == OFFBOARD:
            if self.signal_lost(now):
                return _NO_SIGNAL
            if now.kind <= ControlLevel.ACCELERATION and not now.local_position:
                return _NO_POSITION
            return ""
        if mode == AUTO_MISSION:
            return "No valid mission available"
        if not now.local_position:
            return _NO_POSITION
        if mode in (AUTO_HOLD, AUTO_RTL) and not now.global_position:
            return "Navigation error: No valid global position estimate"
        return ""

    def signal_lost(self, now: CommanderInput) -> bool:
        """Return whether set points are missing for longer than COM_OF_LOSS_T."""
        limit = TICK_HZ * self._parameters.get("COM_OF_LOSS_T")
        return now.signal_tick < 0 or now.tick - now.signal_tick > limit

    def problems(self, now: CommanderInput) -> tuple[str, ...]:
        """Return what arming in the present mode would be denied for, as texts; () if nothing."""
        problems = [self.missing(self.user_intended_mode, now)]
        if self.user_intended_mode in _NOT_FOR_ARMING:
            problems.append("Mode not suitable for arming")
        if now.battery.warning >= 2:
            problems.append(_BATTERY[now.battery.warning])
        if self.killed_tick >= 0:
            problems.append("Kill switch engaged")
        if self.terminated:
            problems.append("Flight termination active")
        return tuple(dict.fromkeys(filter(None, problems)))

    # --- commands

    def arm(self, now: CommanderInput) -> Result:
        """Arm, if nothing is in the way. Force does not help: PX4 checks commands from outside."""
        if self.armed:
            return Result.ACCEPTED
        problems = self.problems(now)
        if problems:
            self._say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
            for problem in problems:
                self._say(Severity.CRITICAL, f"Preflight Fail: {problem}")
            return Result.TEMPORARILY_REJECTED
        self.armed = True
        self._landed_tick = -1
        self._battery_failsafe = None
        self._say(Severity.INFO, "Armed by external command")
        return Result.ACCEPTED

    def disarm(self, now: CommanderInput, force: bool, reason: str = "external command") -> Result:
        """Disarm; in the air only by force."""
        if not self.armed:
            return Result.ACCEPTED
        if not force and not (now.landed or now.maybe_landed):
            self._say(Severity.CRITICAL, "Disarming denied: not landed")
            return Result.TEMPORARILY_REJECTED
        self.armed = False
        self.failsafe = False
        self._battery_failsafe = None
        self.user_intended_mode = self.mode = self._after_disarming
        self._say(Severity.INFO, f"Disarmed by {reason}")
        return Result.ACCEPTED

    def set_mode(self, mode: Mode, now: CommanderInput) -> Result:
        """Change the mode: on the ground any, in flight one that can be flown."""
        title = _TITLES.get(mode)
        if title is None or mode in (DESCEND, TERMINATE):
            kind = "auto mode" if mode.main == AUTO_HOLD.main else "mode"
            self._say(Severity.CRITICAL, f"Unsupported {kind}")
            return Result.TEMPORARILY_REJECTED
        lacking = self.missing(mode, now)
        if self.armed and lacking:
            self._say(Severity.CRITICAL, f"Switching to {title} is currently not available")
            self._say(Severity.CRITICAL, f"{title}: {lacking}")
            return Result.TEMPORARILY_REJECTED
        self.user_intended_mode = mode
        if mode not in _NOT_FOR_ARMING:
            self._after_disarming = mode
        self._battery_failsafe = None
        self._select_mode(now)
        return Result.ACCEPTED

    def kill(self, on: bool, now: CommanderInput) -> None:
        """Take the kill switch of the remote control."""
        if on == (self.killed_tick >= 0):
            return
        self.killed_tick = now.tick if on else -1
        in_flight = on and not now.landed
        severity = Severity.CRITICAL if in_flight else Severity.INFO
        self._say(severity, "Kill engaged" if on else "Kill disengaged")

    # --- fail-safes and automatic changes

    def update(self, now: CommanderInput) -> None:
        """Apply fail-safes and automatic disarming."""
        self._watch_battery(now)
        self._select_mode(now)
        if self.armed:
            self._disarm_by_itself(now)

    def _select_mode(self, now: CommanderInput) -> None:
        """Choose the mode to fly from the mode asked for and the modes that are possible."""
        if not self.armed:
            self.mode, self.failsafe = self.user_intended_mode, False
            return
        mode = self.user_intended_mode
        cause = self.missing(mode, now)
        if cause:
            act = int(self._parameters.get("COM_OBL_RC_ACT"))
            mode = self._failsafe(FAILSAFES[act] if mode == OFFBOARD else _RETURNS, now)
        if self._battery_failsafe is not None and mode not in (AUTO_LAND, DESCEND):
            mode, cause = (
                self._failsafe(self._battery_failsafe, now),
                _BATTERY[now.battery.warning],
            )
        failsafe = mode != self.user_intended_mode
        if failsafe and (not self.failsafe or mode != self.mode):
            self._say(Severity.CRITICAL, f"Failsafe activated: {cause}, {_TITLES[mode]}")
        elif self.failsafe and not failsafe:
            self._say(Severity.NOTICE, f"Failsafe cleared, {_TITLES[mode]}")
        self.mode, self.failsafe = mode, failsafe

    def _failsafe(self, modes: tuple[Mode, ...], now: CommanderInput) -> Mode:
        """Return the mode of a row of `FAILSAFES`."""
        known = (now.global_position, now.local_position, now.altitude, True)
        return modes[known.index(True)]

    def _disarm_by_itself(self, now: CommanderInput) -> None:
        get = self._parameters.get
        if self.mode == TERMINATE:
            self.terminated = int(get("COM_OBL_RC_ACT")) == 6
            self.disarm(now, True, "flight termination" if self.terminated else "failsafe")
            return
        killed_s = (now.tick - self.killed_tick) / TICK_HZ
        if self.killed_tick >= 0 and killed_s >= get("COM_KILL_DISARM"):
            self.disarm(now, True, "kill-switch")
            return
        if not now.landed:
            self._landed_tick = -1
            return
        if self._landed_tick < 0:
            self._landed_tick = now.tick
        wait = get("COM_DISARM_LAND") if now.taken_off else get("COM_DISARM_PRFLT")
        reason = "landing" if now.taken_off else "auto preflight disarming"
        if wait > 0.0 and now.tick - self._landed_tick >= TICK_HZ * wait:
            self.disarm(now, False, reason)

    def _watch_battery(self, now: CommanderInput) -> None:
        warning = now.battery.warning
        if warning <= self._battery_reported:
            return
        self._battery_reported = warning
        self._say(
            Severity.WARNING if warning == 1 else Severity.CRITICAL,
            f"{_BATTERY[warning]}: {100.0 * now.battery.remaining:.0f} %",
        )
        action = int(self._parameters.get("COM_LOW_BAT_ACT"))
        if not self.armed or warning < 2 or action == 0:
            return
        land = action == 2 or (action == 3 and warning == 3)
        self._battery_failsafe = _LANDS if land else _RETURNS
