"""`tombo effects`: what the simulation can switch on, from the registry itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import typer

from tombo_bringup.cli.options import JsonOnly

if TYPE_CHECKING:
    from tombo_dynamics.effects import Effect


def effects(as_json: JsonOnly = False) -> None:
    """List every effect that a scenario can switch on, with its parameters.

    Each is set by `effects.NAME.PARAMETER` in a scenario file or with --set. With all parameters
    at their null value an effect adds exactly nothing.
    """
    from tombo_dynamics.effects import REGISTRY

    if as_json:
        typer.echo(json.dumps([_as_object(effect) for effect in REGISTRY.values()], indent=1))
        return
    from rich.box import SIMPLE_HEAD
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("effect", "unit", "null", "bounds"):
        right = heading in ("null", "bounds")
        table.add_column(heading, justify="right" if right else "left", no_wrap=True)
    table.add_column("meaning", ratio=1)
    for effect in REGISTRY.values():
        first, _, _ = effect.doc.partition("\n")
        table.add_row(Text(effect.name, "bold"), "", "", "", Text(first, "bold"))
        for p in effect.theta:
            low, high = p.bounds
            bounds = f"{low:g} to {high:g}"
            table.add_row(Text(f"  {p.name}"), Text(p.unit), f"{p.null:g}", bounds, Text(p.doc))
    Console().print(table)


def _as_object(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "stage": effect.stage.value,
        "doc": effect.doc,
        "signature": effect.signature,
        "parameters": [
            {key: getattr(p, key) for key in ("name", "unit", "null", "bounds", "doc")}
            for p in effect.theta
        ],
    }
