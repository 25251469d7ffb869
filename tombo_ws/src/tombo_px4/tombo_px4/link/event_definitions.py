"""What PX4's events say: words with places for arguments, from PX4's own file of events.

The file (version 1 or 2 of its format) comes from the vehicle; its size is bounded, and a file of
another shape is refused. For a vehicle that sends no file, as the simulated PX4, the events of a
flight by motion capture are known here by name.
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
_LARGEST_UNPACKED = 8 << 20
"""Bytes of a file of metadata; the largest of PX4 1.17 has 160 kB."""
_MEMORY = 96 << 20
"""Bytes; PX4 packs with a dictionary of 64 MiB, whatever the size of the file."""
_XZ_MAGIC = b"\xfd7zXZ\x00"
_EVENTS = 4
"""COMP_METADATA_TYPE_EVENTS."""
_ON_VEHICLE = re.compile(r"mftp://(?:\[;comp=\d+\])?(.*)")
_KINDS = {
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


class BadMetadata(ValueError):
    """A file of metadata that can't be used, and why."""


def event_number(name: str) -> int:
    """Return the number of an event: a hash (FNV-1a) of its name, as PX4 makes it."""
    value = _FNV_BASIS
    for byte in name.encode():
        value = (value ^ byte) * _FNV_PRIME & 0xFFFFFFFF
    return _AUTOPILOT | value & 0xFFFFFF


@dataclass(frozen=True)
class EventDefinition:
    """An event.

    Attributes:
        words: what it says, `{1}` for its first argument.
        format: of the arguments, as `struct` takes it.
        names: place of an argument → names of its values.
        names_modes: the first argument is the modes that a check stands in the way of.
    """

    words: str
    format: str = "<"
    names: Mapping[int, Mapping[int, str]] = field(default_factory=dict)
    names_modes: bool = False

    def text(self, arguments: bytes) -> str:
        """Return the words with the arguments in their places; absent arguments are 0."""
        size = struct.calcsize(self.format)
        values = struct.unpack_from(self.format, arguments.ljust(size, b"\0"))

        def put(place: re.Match[str]) -> str:
            at = int(place[1]) - 1
            if not 0 <= at < len(values):
                return place[0]
            value = values[at]
            if isinstance(value, float):
                value = f"{value:.{place[2] or 2}f}" if abs(value) < 1e12 else f"{value:g}"
            value = self.names.get(at, {}).get(value, value)
            unit = (place[3] or "").removesuffix("_v")
            return f"{value} {unit}" if unit else str(value)

        words = _PLACE.sub(put, _TAG.sub("", self.words))
        return _ESCAPED.sub(r"\1", words)[:_LONGEST]


CHECKS_BEGIN, CHECKS_END = "commander_arming_check_summary", "commander_health_summary"
"""All failed checks come between these two."""
ARMING_DENIED = "commander_arm_denied_resolve_failures"
_REASONS = {
    0: {
        1: "the sticks",
        2: "a switch of the remote control",
        4: "a command from outside",
        6: "landing",
        7: "itself, because it did not take off",
        8: "the kill switch",
        9: "lockdown",
        10: "the failure detector",
        14: "a fail-safe",
    }
}
"""PX4's `arm_disarm_reason_t`, as the first argument."""
_KNOWN = {
    ARMING_DENIED: EventDefinition("arming denied: a check fails"),
    "commander_disarm_denied_not_landed": EventDefinition("disarming denied: not landed"),
    "commander_armed_by": EventDefinition("armed by {1}", "<B", _REASONS),
    "commander_disarmed_by": EventDefinition("disarmed by {1}", "<B", _REASONS),
    "commander_takeoff_detected": EventDefinition("take-off detected"),
    "commander_landing_detected": EventDefinition("landing detected"),
    "commander_landing_current_pos": EventDefinition("lands where it is"),
    "commander_rtl": EventDefinition("returns to launch"),
    "commander_modeswitch_not_avail": EventDefinition("mode {2} can't be flown now", "<IB"),
    "commander_unsupported_auto_mode": EventDefinition("there is no such auto mode"),
    "commander_failsafe_enter": EventDefinition("fail-safe: cause {3}, action {2}", "<IBB"),
}
_KNOWN_CHECKS = {
    "check_modes_attitude": "no valid attitude",
    "check_modes_local_pos": "no valid position",
    "check_modes_global_pos": "no valid global position",
    "check_modes_offboard_signal": "no set points, or no position",
    "check_modes_manual_control": "no remote control",
    "check_modes_mission": "no mission",
    "check_modes_cannot_takeoff": "this mode can't take off",
    "check_rc_dl_no_dllink": "no ground station (NAV_DLL_ACT)",
    "check_battery_critical": "battery critical",
    "check_battery_emergency": "battery nearly empty",
    "check_system_flight_term_active": "flight termination",
}
"""Their arguments: the modes that they stand in the way of, and a component."""
KNOWN_NUMBERS = {event_number(name): event for name, event in _KNOWN.items()} | {
    event_number(name): EventDefinition(words, "<IB", names_modes=True)
    for name, words in _KNOWN_CHECKS.items()
}
"""Number → event that is known without PX4's file."""


def unpacked(content: bytes) -> bytes:
    """Return a file of metadata as it was before it was compressed, if it was.

    Raises:
        BadMetadata: too large, or damaged.
    """
    if not content.startswith(_XZ_MAGIC):
        return content
    unpacker = lzma.LZMADecompressor(lzma.FORMAT_XZ, memlimit=_MEMORY)
    try:
        data = unpacker.decompress(content, _LARGEST_UNPACKED)
    except (lzma.LZMAError, MemoryError) as error:
        raise BadMetadata(f"damaged: {error}") from error
    if not unpacker.eof:
        raise BadMetadata(f"more than {_LARGEST_UNPACKED} bytes, or not complete")
    return data


def path_of(uri: str) -> str:
    """Return the path of a file on the vehicle; "" if it is not there."""
    found = _ON_VEHICLE.fullmatch(uri)
    return found[1] if found else ""


def events_file(general: bytes) -> str:
    """Return the path of the file of events, from the general metadata; "": none on the vehicle.

    Raises:
        BadMetadata: the file can't be read.
    """
    try:
        kinds = {
            entry["type"]: str(entry["uri"]) for entry in json.loads(general)["metadataTypes"]
        }
    except (ValueError, LookupError, TypeError, RecursionError) as error:
        raise BadMetadata(f"no general metadata: {error}") from error
    return path_of(kinds.get(_EVENTS, ""))


def definitions(content: bytes) -> dict[int, EventDefinition]:
    """Return the events of a file of events, by number.

    Raises:
        BadMetadata: the file can't be read.
    """
    try:
        components = json.loads(content)["components"]
        enums = {}
        for component in components.values():
            for name, enum in component.get("enums", {}).items():
                enums[f"{component.get('namespace')}::{name}"] = enums[name] = enum
        return {
            int(number) << 24 | int(sub): _definition(event, enums)
            for number, component in components.items()
            for group in component.get("event_groups", {}).values()
            for sub, event in group["events"].items()
        }
    except (ValueError, LookupError, TypeError, AttributeError, RecursionError) as error:
        raise BadMetadata(f"no file of events: {error}") from error


def _definition(event: Mapping[str, Any], enums: Mapping[str, Any]) -> EventDefinition:
    arguments = event.get("arguments") or []
    kinds, names = "<", {}
    for at, argument in enumerate(arguments):
        enum = enums.get(argument["type"], {})
        kind = _KINDS.get(enum.get("type", argument["type"]))
        if kind is None:
            break  # nothing behind it can be found
        kinds += kind
        names[at] = {
            int(value): entry.get("description") or entry["name"]
            for value, entry in enum.get("entries", {}).items()
        }
    names_modes = bool(arguments) and arguments[0].get("name") == "modes"
    return EventDefinition(event.get("message") or event["name"], kinds, names, names_modes)
