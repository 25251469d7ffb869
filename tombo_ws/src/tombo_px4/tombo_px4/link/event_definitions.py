"""What an event means: words with places for its arguments, and the arguments' kinds.

From PX4's own file of events (version 1 or 2 of its format), which comes from the vehicle and is
trusted in nothing: bounded in size and depth, and what does not fit is left out. For a vehicle
that sends no file, the events of a flight by motion capture are known here by name.
"""

from __future__ import annotations

import json
import lzma
import re
import struct
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

_AUTOPILOT = 1 << 24
"""Events of the autopilot itself: component 1."""
_FNV_BASIS, _FNV_PRIME = 0x811C9DC5, 0x01000193


def event_number(name: str) -> int:
    """Return the number of an event: a hash (FNV-1a) of its name, as PX4 makes it."""
    value = _FNV_BASIS
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return _AUTOPILOT | value & 0xFFFFFF


LARGEST_UNPACKED = 8 << 20
"""Bytes of a file of metadata; the largest of PX4 1.17 has 160 kB."""
_MEMORY = 96 << 20
"""Bytes; PX4 packs with a dictionary of 64 MiB, whatever the size of the file."""
_EVENTS = 4
"""COMP_METADATA_TYPE_EVENTS."""
_ON_VEHICLE = "mftp://"
_COMPONENT = re.compile(r"^\[;comp=\d+\]")
_XZ_MAGIC = b"\xfd7zXZ\x00"
ARGUMENT_KINDS = {
    "uint8_t": "B",
    "int8_t": "b",
    "uint16_t": "H",
    "int16_t": "h",
    "uint32_t": "I",
    "int32_t": "i",
    "uint64_t": "Q",
    "int64_t": "q",
    "float": "f",
}
"""Type of an argument → its letter in `struct`."""
_PLACE = re.compile(r"\{(\d{1,2})(?::\.(\d))?([a-zA-Z][\w/^]*)?\}")
_TAG = re.compile(r"(?<!\\)<[^<>]{0,100}>")
_ESCAPED = re.compile(r"\\(.)")
_LONGEST = 240
"""Characters of a text."""
_FIRST_MODES = "modes"


class BadMetadata(ValueError):
    """A file of metadata that can't be used, and why."""


@dataclass(frozen=True)
class ArgumentEnum:
    """Names of the values of an argument."""

    kind: str
    names: Mapping[int, str]
    bits: bool
    """Each value is a bit; several may be set."""

    def text(self, value: int) -> str:
        """Return the name of a value, or the value."""
        if not self.bits:
            return self.names.get(value, str(value))
        return ", ".join(name for bit, name in self.names.items() if value & bit) or str(value)


@dataclass(frozen=True)
class EventDefinition:
    """An event.

    Attributes:
        words: what it says, `{1}` for its first argument.
        format: of the arguments, as `struct` takes it.
        enums: place of an argument to the names of its values.
        names_modes: the first argument is the modes that a check stands in the way of.
    """

    words: str
    format: str = "<"
    enums: Mapping[int, ArgumentEnum] = field(default_factory=dict)
    names_modes: bool = False

    def values(self, arguments: bytes) -> tuple[Any, ...]:
        """Return the arguments; those that are not there are 0."""
        size = struct.calcsize(self.format)
        return struct.unpack_from(self.format, arguments.ljust(size, b"\0"))

    def text(self, arguments: bytes) -> str:
        """Return the words with the arguments in their places."""
        values = self.values(arguments)

        def put(place: re.Match[str]) -> str:
            at = int(place[1]) - 1
            if not 0 <= at < len(values):
                return place[0]
            value = values[at]
            if at in self.enums and isinstance(value, int):
                return self.enums[at].text(value)
            if isinstance(value, float):
                digits = int(place[2]) if place[2] else 2
                value = f"{value:.{digits}f}" if abs(value) < 1e12 else f"{value:g}"
            unit = (place[3] or "").removesuffix("_v")
            return f"{value} {unit}" if unit else str(value)

        words = _PLACE.sub(put, _TAG.sub("", self.words))
        return _ESCAPED.sub(r"\1", words)[:_LONGEST]


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
_BY = {0: ArgumentEnum("uint8_t", _REASONS, False)}


def _check(words: str, more: str = "") -> EventDefinition:
    """Return a check: the modes that it stands in the way of, a component, and more arguments."""
    return EventDefinition(words, f"<IB{more}", names_modes=True)


KNOWN_EVENTS: dict[str, EventDefinition] = {
    ARMING_DENIED: EventDefinition("arming denied: a check fails"),
    "commander_arm_denied_calibrating": EventDefinition("arming denied: calibrating"),
    "commander_arm_denied_throttle_high": EventDefinition("arming denied: high throttle"),
    "commander_disarm_denied_not_landed": EventDefinition("disarming denied: not landed"),
    "commander_armed_by": EventDefinition("armed by {1}", "<B", _BY),
    "commander_disarmed_by": EventDefinition("disarmed by {1}", "<B", _BY),
    "commander_takeoff_detected": EventDefinition("take-off detected"),
    "commander_landing_detected": EventDefinition("landing detected"),
    "commander_landing_current_pos": EventDefinition("lands where it is"),
    "commander_rtl": EventDefinition("returns to launch"),
    "commander_gcs_lost": EventDefinition("ground station lost"),
    "commander_modeswitch_not_avail": EventDefinition("mode {2} can't be flown now", "<IB"),
    "commander_unsupported_auto_mode": EventDefinition("there is no such auto mode"),
    "commander_failsafe_enter": EventDefinition("fail-safe: cause {3}, action {2}", "<IBB"),
    "commander_failsafe_enter_hold": EventDefinition(
        "fail-safe: cause {4}, action {2} in {3} s", "<IBHB"
    ),
    "commander_failsafe_enter_generic": EventDefinition("fail-safe: action {2}", "<IB"),
    "check_modes_attitude": _check("no valid attitude"),
    "check_modes_local_pos": _check("no valid position"),
    "check_modes_local_alt": _check("no valid height"),
    "check_modes_global_pos": _check("no valid global position"),
    "check_modes_home_position": _check("no home position"),
    "check_modes_offboard_signal": _check("no set points, or no position"),
    "check_modes_manual_control": _check("no remote control"),
    "check_modes_mission": _check("no mission"),
    "check_modes_cannot_takeoff": _check("this mode can't take off"),
    "check_modes_angular_velocity": _check("no valid body rates"),
    "check_rc_dl_no_dllink": _check("no ground station (NAV_DLL_ACT)"),
    "check_estimator_missing_data": _check("the estimator has not begun"),
    "check_estimator_heading_not_stable": _check("heading not stable"),
    "check_estimator_hor_pos_not_stable": _check("position not stable"),
    "check_estimator_hor_vel_not_stable": _check("velocity not stable"),
    "check_estimator_vert_vel_not_stable": _check("climb rate not stable"),
    "check_estimator_hgt_not_stable": _check("height not stable"),
    "check_estimator_gps_not_fusing": _check("GPS is not used"),
    "check_battery_low": _check("battery low"),
    "check_battery_critical": _check("battery critical"),
    "check_battery_emergency": _check("battery nearly empty"),
    "check_battery_unhealthy": _check("battery unhealthy"),
    "check_missing_cpuload": _check("processor load not known"),
    "check_cpuload_too_high": _check("processor load {3} %", "f"),
    "check_system_safety_button": _check("the safety button is not pressed"),
    "check_system_flight_term_active": _check("flight termination"),
    "check_system_usb_connected": _check("USB connected"),
    "check_failure_detector_roll": _check("roll is a failure"),
    "check_failure_detector_pitch": _check("pitch is a failure"),
}
"""Name to words: what a flight by motion capture meets."""
KNOWN_NUMBERS = {event_number(name): event for name, event in KNOWN_EVENTS.items()}
"""The same by number."""


def unpacked(content: bytes) -> bytes:
    """Return a file of metadata as it was before it was compressed, if it was.

    Raises:
        BadMetadata: too large, or damaged.
    """
    if not content.startswith(_XZ_MAGIC):
        return content
    unpacker = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MEMORY)
    try:
        data = unpacker.decompress(content, LARGEST_UNPACKED)
    except (lzma.LZMAError, MemoryError) as error:
        raise BadMetadata(f"damaged: {error}") from error
    if not unpacker.eof:
        raise BadMetadata(f"more than {LARGEST_UNPACKED} bytes, or not complete")
    return data


def events_file(general: bytes) -> str:
    """Return the path of the file of events, from the general metadata; "": none on the vehicle.

    Raises:
        BadMetadata: the file can't be read.
    """
    for entry in _list(_mapping(_parsed(general)).get("metadataTypes")):
        kind = _mapping(entry)
        if kind.get("type") == _EVENTS:
            return path_of(str(kind.get("uri", "")))
    return ""


def path_of(uri: str) -> str:
    """Return the path of a file on the vehicle; "" if it is not there."""
    if not uri.startswith(_ON_VEHICLE):
        return ""
    return _COMPONENT.sub("", uri.removeprefix(_ON_VEHICLE))


def definitions(content: bytes) -> dict[int, EventDefinition]:
    """Return the events of a file of events, by number.

    Raises:
        BadMetadata: the file can't be read.
    """
    components = _mapping(_mapping(_parsed(content)).get("components"))
    enums: dict[str, ArgumentEnum] = {}
    for component in map(_mapping, components.values()):
        space = component.get("namespace")
        for name, entry in _mapping(component.get("enums")).items():
            made = _enum(_mapping(entry))
            if made is not None:
                enums[f"{space}::{name}"] = made
                enums.setdefault(str(name), made)
    events: dict[int, EventDefinition] = {}
    for number, component in components.items():
        for group in _mapping(_mapping(component).get("event_groups")).values():
            for sub, event in _mapping(_mapping(group).get("events")).items():
                if _is_number(number) and _is_number(sub):
                    key = int(number) << 24 | int(sub)
                    events[key] = _definition(_mapping(event), enums)
    return events


def _definition(event: Mapping[str, Any], enums: Mapping[str, ArgumentEnum]) -> EventDefinition:
    kinds, named = "<", {}
    arguments = [_mapping(argument) for argument in _list(event.get("arguments"))]
    for at, argument in enumerate(arguments):
        kind = str(argument.get("type"))
        if kind in enums:
            named[at] = enums[kind]
            kind = enums[kind].kind
        if kind not in ARGUMENT_KINDS:
            break  # nothing behind it can be found
        kinds += ARGUMENT_KINDS[kind]
    first = str(arguments[0].get("name")) if arguments else ""
    words = str(event.get("message") or event.get("name") or "")
    return EventDefinition(words, kinds, named, first == _FIRST_MODES)


def _enum(entry: Mapping[str, Any]) -> ArgumentEnum | None:
    kind = str(entry.get("type"))
    if kind not in ARGUMENT_KINDS:
        return None
    names = {}
    for value, fields in _mapping(entry.get("entries")).items():
        if _is_number(value):
            words = _mapping(fields)
            names[int(value)] = str(words.get("description") or words.get("name"))
    return ArgumentEnum(kind, names, bool(entry.get("is_bitfield")))


def _is_number(text: Any) -> bool:
    return str(text).isdecimal() and len(str(text)) <= 10


def _parsed(content: bytes) -> Any:
    try:
        return json.loads(content)
    except (ValueError, RecursionError) as error:
        raise BadMetadata(f"no JSON: {error}") from error


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, dict) else {}


def _list(value: Any) -> list[Any]:
    return value if isinstance(value, list) else []
