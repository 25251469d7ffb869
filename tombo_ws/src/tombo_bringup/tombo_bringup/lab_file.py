"""The lab file: vehicle, volume, obstacle, motion capture and PX4 of one lab.

It is a set of options: a command that gets a lab file behaves as if they were written before those
of its command line, which win.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_dynamics.params import from_mapping
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.vehicle_file import is_builtin_vehicle
from tombo_flight.yaml_file import check_keys, list_of, mapping_of
from tombo_mocap.params import ROS, SYSTEMS, MocapParams

FORMAT = 1
SCENARIO_SECTIONS = ("volume", "safety", "obstacle", "mission")
"""Sections of a scenario that belong to a lab."""
_KEYS = ("tombo_lab", "vehicle", "mocap", "px4", *SCENARIO_SECTIONS)
_PX4_KEYS = ("url", "parameters", "bridge")
_VEHICLE, _SETTINGS, _PX4, _MOCAP = "vehicle", "settings", "px4", "mocap"
TAKES: Mapping[str, tuple[str, ...]] = {
    "fly": (_VEHICLE, _SETTINGS, _PX4),
    "up": (_VEHICLE, _SETTINGS, _PX4),
    "sweep": (_VEHICLE, _SETTINGS),
    "diagnose": (_VEHICLE,),
    "px4": (_SETTINGS,),
    "hil": (_SETTINGS,),
    "mocap": (_MOCAP,),
}
"""Command → parts of a lab file that it takes."""


@dataclass(frozen=True)
class Lab:
    """A lab file, read."""

    path: Path
    vehicle: str = ""
    """Name or file, absolute; empty: that of the scenario."""
    settings: tuple[str, ...] = ()
    """KEY=VALUE of the scenario."""
    mocap: MocapParams | None = None
    url: str = ""
    """Of the link to PX4; empty: not said."""
    bridge: tuple[str, ...] = ()
    """KEY=VALUE of the bridge to PX4."""


def read_lab(path: Path) -> Lab:
    """Read a lab file.

    Raises:
        InputError: it can't be read, or a key or a value is not accepted.
    """
    label = f"'{path}'"
    values = mapping_of(parse_yaml(read_text(path, label), label), label)
    check_keys(values, _KEYS, label)
    if values.get("tombo_lab") != FORMAT:
        raise InputError(
            f"{label}: tombo_lab {values.get('tombo_lab')}; accepted: tombo_lab: {FORMAT}, as "
            "`tombo lab new` writes it"
        )
    settings = [
        f"{section}.{key}={json.dumps(value)}"
        for section in SCENARIO_SECTIONS
        for key, value in mapping_of(values.get(section, {}), f"{label}: {section}").items()
    ]
    mocap = None
    if "mocap" in values:
        mocap = from_mapping(
            MocapParams, mapping_of(values["mocap"], f"{label}: mocap"), f"{label}: mocap"
        )
        mocap.check()
    px4 = mapping_of(values.get("px4", {}), f"{label}: px4")
    check_keys(px4, _PX4_KEYS, f"{label}: px4")
    return Lab(
        path,
        _vehicle(str(values.get("vehicle", "")), path.parent),
        tuple(settings),
        mocap,
        str(px4.get("url", "")),
        tuple(_bridge(px4, mocap, label)),
    )


def _vehicle(name: str, folder: Path) -> str:
    """Return a built-in name, or the path of a file beside the lab file."""
    if not name or is_builtin_vehicle(name):
        return name
    return str((folder / name).absolute())


def _bridge(px4: Mapping[str, Any], mocap: MocapParams | None, label: str) -> Iterator[str]:
    """Yield KEY=VALUE of the bridge; it proves the axes of the body that is tracked."""
    if mocap is not None and mocap.body:
        yield f"px4.tracked_body={mocap.body}"
    parameters = list_of(px4.get("parameters"), f"{label}: px4.parameters")
    if parameters:
        yield f"px4_parameters={json.dumps(parameters)}"
    for section, values in mapping_of(px4.get("bridge", {}), f"{label}: px4.bridge").items():
        for key, value in mapping_of(values, f"{label}: px4.bridge.{section}").items():
            yield f"{section}.{key}={json.dumps(value)}"


def with_lab(arguments: Sequence[str], lab: Lab) -> list[str]:
    """Return a command line with the options of a lab behind the command's name.

    Raises:
        InputError: a command that takes none.
    """
    command, *given = arguments
    if command not in TAKES:
        raise InputError(f"--lab with `tombo {command}`; accepted: with {', '.join(TAKES)}")
    words: list[str] = []
    for part in TAKES[command]:
        if part == _VEHICLE and lab.vehicle:
            words += ["--vehicle", lab.vehicle]
        elif part == _SETTINGS:
            words += [word for setting in lab.settings for word in ("--set", setting)]
        elif part == _MOCAP and lab.mocap is not None:
            words += _mocap_words(lab.mocap, given)
        elif part == _PX4 and any(word.partition("=")[0] == "--px4" for word in given):
            words += [word for setting in lab.bridge for word in ("--bridge", setting)]
            given = _with_url(given, lab.url)
    return [command, *words, *given]


def _mocap_words(mocap: MocapParams, given: Sequence[str]) -> list[str]:
    place = mocap.topic if mocap.system == ROS else mocap.host
    words = []
    if not SYSTEMS.keys() & set(given):
        words += [mocap.system, *([place] if place else [])]
    for name in ("body", "up", "nose", "frame", "delay"):
        if getattr(mocap, name) != getattr(MocapParams(), name):
            words += [f"--{name}", str(getattr(mocap, name))]
    return [*words, *(word for text in mocap.options.split() for word in ("--option", text))]


def _with_url(given: Sequence[str], url: str) -> list[str]:
    """Return the words with the lab's URL behind a `--px4` that has none."""
    words = list(given)
    place = words.index("--px4") if "--px4" in words else None
    if url and place is not None and not any("://" in word for word in words[place + 1 :][:1]):
        words[place] = f"--px4={url}"
    return words
