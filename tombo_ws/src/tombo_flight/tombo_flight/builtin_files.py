"""The scenarios and vehicles that come with the suite, by name; reading them needs no model."""

from __future__ import annotations

import re
from importlib import resources
from pathlib import Path
from typing import Any

from tombo_dynamics.yaml_text import parse_yaml

SCENARIOS = Path(str(resources.files("tombo_flight"))) / "scenarios"
VEHICLES = SCENARIOS.with_name("vehicles")


def builtin_file(folder: Path, name: str) -> Path | None:
    """Return the file of a scenario or vehicle that comes with the suite; None: there is none.

    Args:
        folder: `SCENARIOS` or `VEHICLES`.
        name: as users give it, maybe a path.
    """
    file = folder / f"{name}.yaml"
    return file if re.fullmatch(r"\w+", name) and file.is_file() else None


def builtin_scenarios() -> dict[str, str]:
    """Return the names of the scenarios that come with the suite, and what each is for."""
    return {name: str(v.get("description", "")) for name, v in _contents(SCENARIOS).items()}


def builtin_vehicles() -> dict[str, str]:
    """Return the names of the vehicles that come with the suite, and what each is."""
    return {name: f"{v['name']}: {v['about']}" for name, v in _contents(VEHICLES).items()}


def _contents(folder: Path) -> dict[str, Any]:
    files = sorted(folder.glob("*.yaml"))
    return {file.stem: parse_yaml(file.read_text(encoding="utf-8"), file.name) for file in files}
