"""Events of PX4 that are known by name, with words of our own for a vehicle that explains none."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

_AUTOPILOT = 1 << 24
"""Events of the autopilot itself: component 1."""
_FNV_BASIS, _FNV_PRIME = 0x811C9DC5, 0x01000193


def event_number(name: str) -> int:
    """Return the number of an event: a hash (FNV-1a) of its name, as PX4 makes it."""
    value = _FNV_BASIS
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return _AUTOPILOT | value & 0xFFFFFF


class KnownEvent(NamedTuple):
    """An event, as `{1}` is its first argument."""

    words: str
    arguments: tuple[str, ...] = ()
    names: Mapping[int, str] = {}
    """Of the values of the first argument."""


_CHECK = ("uint32_t", "uint8_t")
"""What all checks begin with: the modes that it stands in the way of, and a component."""
CHECKS_BEGIN, CHECKS_END = "commander_arming_check_summary", "commander_health_summary"
"""All failed checks come between these two."""
ARMING_DENIED = "commander_arm_denied_resolve_failures"

_REASONS = {
    1: "the sticks",
    2: "a switch of the remote control",
    3: "a command of its own",
    4: "a command from outside",
    5: "the start of a mission",
    6: "landing",
    7: "itself, because it did not take off",
    8: "the kill switch",
    9: "lockdown",
    10: "the failure detector",
    11: "shutting down",
    12: "a test",
    13: "a button of the remote control",
    14: "a fail-safe",
}
"""PX4's `arm_disarm_reason_t`."""
KNOWN_EVENTS: dict[str, KnownEvent] = {
    ARMING_DENIED: KnownEvent("arming denied: a check fails"),
    "commander_arm_denied_calibrating": KnownEvent("arming denied: calibrating"),
    "commander_arm_denied_throttle_high": KnownEvent("arming denied: high throttle"),
    "commander_disarm_denied_not_landed": KnownEvent("disarming denied: not landed"),
    "commander_armed_by": KnownEvent("armed by {1}", ("uint8_t",), _REASONS),
    "commander_disarmed_by": KnownEvent("disarmed by {1}", ("uint8_t",), _REASONS),
    "commander_takeoff_detected": KnownEvent("take-off detected"),
    "commander_landing_detected": KnownEvent("landing detected"),
    "commander_landing_current_pos": KnownEvent("lands where it is"),
    "commander_rtl": KnownEvent("returns to launch"),
    "commander_gcs_lost": KnownEvent("ground station lost"),
    "commander_modeswitch_not_avail": KnownEvent(
        "mode {2} can't be flown now", ("uint32_t", "uint8_t")
    ),
    "commander_unsupported_auto_mode": KnownEvent("there is no such auto mode"),
    "commander_failsafe_enter": KnownEvent(
        "fail-safe: cause {3}, action {2}", ("uint32_t", "uint8_t", "uint8_t")
    ),
    "commander_failsafe_enter_hold": KnownEvent(
        "fail-safe: cause {4}, action {2} in {3} s", ("uint32_t", "uint8_t", "uint16_t", "uint8_t")
    ),
    "commander_failsafe_enter_generic": KnownEvent(
        "fail-safe: action {2}", ("uint32_t", "uint8_t")
    ),
    "check_modes_attitude": KnownEvent("no valid attitude", _CHECK),
    "check_modes_local_pos": KnownEvent("no valid position", _CHECK),
    "check_modes_local_alt": KnownEvent("no valid height", _CHECK),
    "check_modes_global_pos": KnownEvent("no valid global position", _CHECK),
    "check_modes_home_position": KnownEvent("no home position", _CHECK),
    "check_modes_offboard_signal": KnownEvent("no set points, or no position", _CHECK),
    "check_modes_manual_control": KnownEvent("no remote control", _CHECK),
    "check_modes_mission": KnownEvent("no mission", _CHECK),
    "check_modes_cannot_takeoff": KnownEvent("this mode can't take off", _CHECK),
    "check_modes_angular_velocity": KnownEvent("no valid body rates", _CHECK),
    "check_rc_dl_no_dllink": KnownEvent("no ground station (NAV_DLL_ACT)", _CHECK),
    "check_estimator_missing_data": KnownEvent("the estimator has not begun", _CHECK),
    "check_estimator_heading_not_stable": KnownEvent("heading not stable", _CHECK),
    "check_estimator_hor_pos_not_stable": KnownEvent("position not stable", _CHECK),
    "check_estimator_hor_vel_not_stable": KnownEvent("velocity not stable", _CHECK),
    "check_estimator_vert_vel_not_stable": KnownEvent("climb rate not stable", _CHECK),
    "check_estimator_hgt_not_stable": KnownEvent("height not stable", _CHECK),
    "check_estimator_gps_not_fusing": KnownEvent("GPS is not used", _CHECK),
    "check_battery_low": KnownEvent("battery low", _CHECK),
    "check_battery_critical": KnownEvent("battery critical", _CHECK),
    "check_battery_emergency": KnownEvent("battery nearly empty", _CHECK),
    "check_battery_unhealthy": KnownEvent("battery unhealthy", _CHECK),
    "check_missing_cpuload": KnownEvent("processor load not known", _CHECK),
    "check_cpuload_too_high": KnownEvent("processor load {3} %", (*_CHECK, "float")),
    "check_system_safety_button": KnownEvent("the safety button is not pressed", _CHECK),
    "check_system_flight_term_active": KnownEvent("flight termination", _CHECK),
    "check_system_usb_connected": KnownEvent("USB connected", _CHECK),
    "check_failure_detector_roll": KnownEvent("roll is a failure", _CHECK),
    "check_failure_detector_pitch": KnownEvent("pitch is a failure", _CHECK),
}
"""Name to words: what a flight by motion capture meets."""
