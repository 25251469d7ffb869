"""The scenarios that come with the suite, by name; reading them needs no model, so it is quick."""

from __future__ import annotations

from importlib import resources

from tombo_dynamics.yaml_text import parse_yaml


def builtin_scenarios() -> dict[str, str]:
    """Return the names of the scenarios that come with the suite, and what each is for."""
    table = {}
    for path in sorted(resources.files("tombo_flight").joinpath("scenarios").iterdir(), key=str):
        if path.name.endswith(".yaml"):
            values = parse_yaml(path.read_text(encoding="utf-8"), path.name)
            table[path.name[: -len(".yaml")]] = str(values.get("description", ""))
    return table
