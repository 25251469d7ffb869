"""A flown scenario as a file that `tombo fly` flies again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tombo_flight.command_line import command_line
from tombo_flight.own_files import imported_files
from tombo_flight.scenario import Scenario, as_mapping
from tombo_flight.version import tombo_version
from tombo_flight.yaml_file import yaml_of

SCENARIO_FILE = "scenario.yaml"


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
    """Return a scenario as written to a file of any folder: without a model, paths absolute."""
    values = as_mapping(scenario)
    values.pop("model", None)
    library = values["propeller"].get("library")
    if library:
        values["propeller"]["library"] = str(Path(library).absolute())
    return values
