"""Arming, modes and fail-safes: what PX4's commander allows, refuses and does by itself."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from tombo_dynamics.time_base import TICK_HZ
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.setpoint_controller import ControlLevel
from tombo_px4.autopilot.vehicle_state import ArmingHealth, BatteryCharge
from tombo_px4.link.decoded_messages import Result, Severity
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
)

DESCEND = Mode(-1)
"""Level descent without a position; a heartbeat shows it as land."""
TERMINATE = Mode(-2)
"""Rotors off for good; a heartbeat shows it as manual."""
_MANUAL_MODES = (MANUAL, ALTCTL, POSCTL, ACRO, STABILIZED)
_TITLES = {mode: name.capitalize() for mode, name in MODE_NAMES.items() if mode != AUTO_READY}
_TITLES |= {DESCEND: "Descend", TERMINATE: "Termination"}
_NOT_FOR_ARMING = (AUTO_LAND, AUTO_RTL)
"""Modes that end a flight; after it the mode before is back."""
_OFFBOARD_LOST = {
    1: ALTCTL,
    2: STABILIZED,
    3: AUTO_RTL,
    4: AUTO_LAND,
    5: AUTO_HOLD,
    6: TERMINATE,
    7: TERMINATE,
}
"""COM_OBL_RC_ACT -> mode; 0 and others: position."""
_REMOTE_CONTROL_LOST = {
    1: AUTO_HOLD,
    2: AUTO_RTL,
    3: AUTO_LAND,
    4: OFFBOARD,
    5: TERMINATE,
    6: TERMINATE,
}
"""NAV_RCL_ACT -> mode."""
_FALLBACKS = (POSCTL, ALTCTL, STABILIZED, AUTO_HOLD, AUTO_RTL, AUTO_LAND, DESCEND)
"""What cannot be flown is replaced by the next one that can."""
_NO_SIGNAL = "No offboard signal"
_NO_STICKS = "No manual control input"
_NO_POSITION = "Navigation error: No valid position estimate"
_BATTERY = ("", "Low battery", "Critical battery", "Emergency battery level")

Say = Callable[[Severity, str], None]


class CommanderInput(NamedTuple):
    """Inputs of the commander."""

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
    roll: float
    pitch: float
    """[rad]."""
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
        self._armed_tick = 0
        self._landed_tick = -1
        self._tilted_tick = -1
        self._tilt_reported = False
        self._battery_reported = 0
        self._battery_action: Mode | None = None
        self._after_disarming: Mode = AUTO_HOLD

    # --- what is possible

    def missing(self, mode: Mode, now: CommanderInput) -> str:
        """Return what a mode lacks to be flown now; "" if nothing."""
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

    def health(self, now: CommanderInput) -> ArmingHealth:
        """Return what arming in the present mode would be denied for."""
        problems = [self.missing(self.user_intended_mode, now)]
        if self.user_intended_mode in _NOT_FOR_ARMING:
            problems.append("Mode not suitable for arming")
        if now.battery.warning >= 2:
            problems.append(_BATTERY[now.battery.warning])
        if self.terminated:
            problems.append("Flight termination active")
        return ArmingHealth(
            tuple(dict.fromkeys(filter(None, problems))),
            now.attitude,
            now.local_position,
            now.global_position,
        )

    # --- commands

    def arm(self, now: CommanderInput) -> Result:
        """Arm, if nothing is in the way. Force does not help: PX4 checks commands from outside."""
        if self.armed:
            return Result.ACCEPTED
        problems = self.health(now).problems
        if problems:
            self._say(Severity.CRITICAL, "Arming denied: Resolve system health failures first")
            for problem in problems:
                self._say(Severity.CRITICAL, f"Preflight Fail: {problem}")
            return Result.TEMPORARILY_REJECTED
        self.armed = True
        self._armed_tick = now.tick
        self._landed_tick = -1
        self._battery_action = None
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
        self._battery_action = None
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
        self._battery_action = None
        self._select_mode(now)
        return Result.ACCEPTED

    # --- fail-safes and automatic changes

    def update(self, now: CommanderInput) -> None:
        """Apply fail-safes and automatic disarming."""
        self._watch_battery(now)
        if not self.armed:
            self.mode = self.user_intended_mode
            return
        self._watch_tilt(now)
        if self.armed:
            self._select_mode(now)
            self._disarm_by_itself(now)

    def _select_mode(self, now: CommanderInput) -> None:
        """Choose the mode to fly from the mode asked for and the modes that are possible."""
        if not self.armed:
            self.mode, self.failsafe = self.user_intended_mode, False
            return
        if self.terminated:
            self.mode, self.failsafe = TERMINATE, True
            return
        wanted = self._mode_fallback(self.user_intended_mode, now)
        cause = self.missing(self.user_intended_mode, now)
        if self._battery_action is not None and wanted not in (AUTO_LAND, DESCEND):
            wanted, cause = self._battery_action, _BATTERY[now.battery.warning]
        mode = self._available_mode(wanted, now)
        failsafe = mode != self.user_intended_mode
        if failsafe and (not self.failsafe or mode != self.mode):
            cause = cause or self.missing(wanted, now)
            self._say(Severity.CRITICAL, f"Failsafe activated: {cause}, {_TITLES[mode]}")
        elif self.failsafe and not failsafe:
            self._say(Severity.NOTICE, f"Failsafe cleared, {_TITLES[mode]}")
        self.mode, self.failsafe = mode, failsafe

    def _can_run(self, mode: Mode, now: CommanderInput) -> bool:
        """Return whether a mode has what it needs; sticks are none of it (`modeCanRun`)."""
        if mode in (ALTCTL, POSCTL):
            known = now.local_position or mode == ALTCTL
            return now.attitude and now.altitude and known
        if mode == AUTO_LAND and not now.altitude:
            return False
        return not self.missing(mode, now) or (mode in _MANUAL_MODES and now.attitude)

    def _mode_fallback(self, mode: Mode, now: CommanderInput) -> Mode:
        """Return what is to be flown in place of a mode, itself if it can be.

        As `checkModeFallback` of PX4 1.17, without a remote control: NAV_RCL_ACT stands for the
        position mode that COM_OBL_RC_ACT asks for, but only while that mode could be flown;
        without a position PX4 goes on to altitude and stabilized mode, which nobody steers.
        """
        action = mode
        if mode == OFFBOARD and self.missing(mode, now):
            act = int(self._parameters.get("COM_OBL_RC_ACT"))
            mode = action = _OFFBOARD_LOST.get(act, POSCTL)
            if mode in _MANUAL_MODES:
                action = _REMOTE_CONTROL_LOST[int(self._parameters.get("NAV_RCL_ACT"))]
        if mode == POSCTL and not self._can_run(POSCTL, now):
            mode = action = ALTCTL
        if mode == ALTCTL and not self._can_run(ALTCTL, now):
            mode = action = STABILIZED
        return action if self._can_run(mode, now) else AUTO_RTL

    def _available_mode(self, wanted: Mode, now: CommanderInput) -> Mode:
        """Return the mode, or else the first behind it in PX4's order that can be flown."""
        if wanted == TERMINATE or self._can_run(wanted, now):
            return wanted
        left = _FALLBACKS[_FALLBACKS.index(wanted) :] if wanted in _FALLBACKS else _FALLBACKS[3:]
        return next((mode for mode in left if self._can_run(mode, now)), DESCEND)

    def _disarm_by_itself(self, now: CommanderInput) -> None:
        get = self._parameters.get
        if self.mode == TERMINATE:
            disarms = self.user_intended_mode == OFFBOARD and int(get("COM_OBL_RC_ACT")) == 7
            self.terminated = self.terminated or not disarms
            self.disarm(now, True, "flight termination" if self.terminated else "failsafe")
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

    def _watch_tilt(self, now: CommanderInput) -> None:
        get = self._parameters.get
        rolled = 0 < get("FD_FAIL_R") < math.degrees(abs(now.roll))
        pitched = 0 < get("FD_FAIL_P") < math.degrees(abs(now.pitch))
        if not (rolled or pitched):
            self._tilted_tick, self._tilt_reported = -1, False
            return
        if self._tilted_tick < 0:
            self._tilted_tick = now.tick
        wait = get("FD_FAIL_R_TTRI") if rolled else get("FD_FAIL_P_TTRI")
        if now.tick - self._tilted_tick < TICK_HZ * wait or self._tilt_reported:
            return
        self._tilt_reported = True
        self._say(Severity.EMERGENCY, "Critical failure detected: attitude")
        early = TICK_HZ * (get("COM_SPOOLUP_TIME") + get("COM_LKDOWN_TKO"))
        if now.tick - self._armed_tick < early:
            self.disarm(now, True, "lockdown")
        elif int(get("CBRK_FLIGHTTERM")) != 121212:
            self.terminated = True

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
        self._battery_action = AUTO_LAND if land else AUTO_RTL
