"""The lab file: vehicle, volume, obstacle, motion capture and PX4 of one lab.

It is a set of values of options: a command takes those of its options for which its command line
says nothing. Settings and those of the bridge come before the ones of the command line.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tombo_bringup import PX4_OF_LAB
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import from_mapping
from tombo_dynamics.yaml_text import parse_yaml, read_text
from tombo_flight.builtin_files import VEHICLES, builtin_file
from tombo_flight.yaml_file import check_keys, list_of, mapping_of
from tombo_mocap.params import ROS, MocapParams

FORMAT = 1
SCENARIO_SECTIONS = ("volume", "safety", "obstacle", "mission")
"""Sections of a scenario that belong to a lab."""
_KEYS = ("tombo_lab", "vehicle", "mocap", "px4", *SCENARIO_SECTIONS)
_PX4_KEYS = ("url", "parameters", "bridge")


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
    """URL of the link to PX4; empty: not given."""
    bridge: tuple[str, ...] = ()
    """KEY=VALUE of the bridge to PX4."""

    def merged(self, given: Mapping[str, Any]) -> dict[str, Any]:
        """Return values of options by name, with those of the lab where `given` has none."""
        values = dict(given)
        if "vehicle" in given:
            values["vehicle"] = given["vehicle"] or self.vehicle or None
        if "settings" in given:
            values["settings"] = [*self.settings, *(given["settings"] or [])]
        if given.get("px4") is not None:
            values["bridge"] = [*self.bridge, *(given["bridge"] or [])]
            if given["px4"] == PX4_OF_LAB and self.url:  # an explicit `--px4=sim` stays simulated
                values["px4"] = self.url
        if "system" in given and (mocap := self.mocap) is not None:
            if given["system"] is None:
                place = mocap.topic if mocap.system == ROS else mocap.host
                values |= {"system": mocap.system, "host": place}
            for name in ("body", "bodies", "up", "nose", "delay"):
                if given[name] is None:
                    values[name] = getattr(mocap, name)
            values["options"] = [*mocap.options.split(), *(given["options"] or [])]
        return values


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
    """Return a built-in name, or a path relative to the lab file made absolute."""
    if not name or builtin_file(VEHICLES, name) is not None:
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
