"""A flown scenario as a file that `tombo fly` flies again, and what it changes in another one."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_flight.command_line import command_line
from tombo_flight.own_files import imported_files
from tombo_flight.scenario import Scenario, as_mapping, load_scenario
from tombo_flight.version import tombo_version
from tombo_flight.yaml_file import yaml_of

SCENARIO_FILE = "scenario.yaml"
_SAID_ELSEWHERE = ("name", "description", "model")


def write_scenario(path: Path, scenario: Scenario, seeds: str) -> None:
    """Write the complete scenario: the same flight comes from it, whatever the defaults become.

    Args:
        path: of the file.
        scenario: what was flown; the effects of a model are among its own.
        seeds: the option that gives its seeds, as in "--seed 3".

    Raises:
        OSError: it can't be written.
    """
    imports = [("--import", file) for file, _ in imported_files()]
    again = command_line(("fly", SCENARIO_FILE, *seeds.split()), imports)
    head = f"# tombo {tombo_version()}; to fly it again: {again}\n"
    if scenario.model:
        head += f"# Effects with those of the model '{scenario.model}'.\n"
    path.write_text(head + yaml_of(complete_mapping(scenario)), encoding="utf-8", newline="\n")


def complete_mapping(scenario: Scenario) -> dict[str, Any]:
    """Return a scenario as it stands in a file of any folder: without a model, paths absolute."""
    values = as_mapping(scenario)
    values.pop("model", None)
    library = values["propeller"].get("library")
    if library:
        values["propeller"]["library"] = str(Path(library).absolute())
    return values


def changes(name: str, flown: Scenario, vehicle: str | None = None) -> list[str]:
    """Return what was changed of a scenario, as short texts: ["vehicle_s500", "mass_1.4"].

    Args:
        name: of the scenario, or its file, as given.
        flown: what became of it.
        vehicle: name or file of the vehicle that was put in place of its own.
    """
    found = [] if vehicle is None else [f"vehicle_{Path(vehicle).stem}"]
    left_out = (*_SAID_ELSEWHERE, *(("effects",) if flown.model else ()))
    found += ["model"] if flown.model else []
    with contextlib.suppress(InputError):  # it may be complete only with what was changed
        plain = load_scenario(name, vehicle=vehicle)
        whole = []  # what stands for several values
        if flown.reaction.name != plain.reaction.name:
            found.append(f"reaction_{flown.reaction.name}")
            whole.append(f"reaction.name={flown.reaction.name}")
        if flown.disturbances and not plain.disturbances:
            found.append("disturbances")
            whole.append("disturbances=true")
        plain = load_scenario(name, whole, vehicle=vehicle)
        before = dict(_leaves(as_mapping(plain), left_out))
        after = dict(_leaves(as_mapping(flown), left_out))
        for key, value in after.items():
            if key not in before or before[key] != value:
                found.append(f"{key[-1]}_{value}")
        found += [f"no_{key[-1]}" for key in before if key not in after]
    return found


def _leaves(
    values: Mapping[str, Any], left_out: tuple[str, ...] = (), above: tuple[str, ...] = ()
) -> Iterator[tuple[tuple[str, ...], Any]]:
    """Return each value that is no mapping, with its keys from the outside in."""
    for key, value in values.items():
        if not above and key in left_out:
            continue
        if isinstance(value, Mapping):
            yield from _leaves(value, (), (*above, key))
        else:
            yield (*above, key), value
