"""Every parameter of a scenario, written out as a YAML file to start from."""

from __future__ import annotations

import dataclasses
import textwrap
from typing import Any

from tombo_dynamics.effects import REGISTRY
from tombo_flight.scenario import Scenario
from tombo_sim.propeller_effects import vehicle_effects

_WIDTH = 98


def _comment(text: str, indent: str) -> list[str]:
    return textwrap.wrap(
        text, _WIDTH, initial_indent=f"{indent}# ", subsequent_indent=f"{indent}#   "
    )


def _line(field: dataclasses.Field[Any], value: object, indent: str) -> list[str]:
    meta = field.metadata
    text = str(meta.get("doc", ""))
    if "bounds" in meta:
        low, high = meta["bounds"]
        text = f"{text} [{meta['unit']}], {low:g} to {high:g}"
    source = f". {meta['source']}" if meta.get("source") else ""
    shown = str(value).lower() if isinstance(value, bool) else value
    shown = "null" if value is None else '""' if value == "" else shown
    return [*_comment(f"{text}{source}", indent), f"{indent}{field.name}: {shown}"]


def parameter_file() -> str:
    """Return the default scenario as YAML: each parameter with meaning, unit, bounds and source.

    Effects have their null values, at which they do nothing. Effects that follow from vehicle and
    propeller are commented out, or they would no longer follow.
    """
    scenario = Scenario()
    lines = [
        "# Every parameter of a scenario at its default. Generated; copy it, keep what you change",
        "# and fly it: `tombo fly my_scenario.yaml`. With `extends: paper_collision` the rest",
        "# comes from a built-in scenario.",
    ]
    for field in dataclasses.fields(Scenario):
        value = getattr(scenario, field.name)
        if field.name in ("name", "model"):
            continue
        if dataclasses.is_dataclass(value):
            lines += [
                "",
                *_comment((type(value).__doc__ or "").split("\n")[0], ""),
                f"{field.name}:",
            ]
            for inner in dataclasses.fields(value):
                lines += _line(inner, getattr(value, inner.name), "  ")
        elif field.name == "effects":
            lines += [
                "",
                *_comment("What the simulation adds to the nominal model.", ""),
                "effects:",
            ]
            implied = vehicle_effects(scenario.propeller, scenario.vehicle, {})
            for effect in REGISTRY.values():
                values = implied.get(effect.name, {})
                sign = "# " if values else ""
                lines += _comment(effect.doc.split("\n")[0], "  ")
                lines += ["  # Follows from vehicle and propeller unless given:"] * bool(values)
                lines.append(f"  {sign}{effect.name}:")
                for p in effect.theta:
                    text = f"{p.doc} [{p.unit}], {p.bounds[0]:g} to {p.bounds[1]:g}"
                    lines += _comment(text, "    ")
                    lines.append(f"  {sign}  {p.name}: {values.get(p.name, p.null)}")
        elif field.name == "description":
            lines.append(f'{field.name}: "all defaults"')
        else:
            lines += _line(field, value, "")
    return "\n".join(lines) + "\n"
