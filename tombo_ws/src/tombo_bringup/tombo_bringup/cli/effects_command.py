"""`tombo effects`: what the simulation can switch on, from the registry itself."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from tombo_dynamics.effects import Effect


def effects(
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON only.")] = False,
) -> None:
    """List every effect that a scenario can switch on, with its parameters.

    Each is set by `effects.NAME.PARAMETER` in a scenario file or with --set. With all parameters
    at their null value an effect adds exactly nothing.
    """
    from tombo_dynamics.effects import REGISTRY

    if as_json:
        typer.echo(json.dumps([_as_object(effect) for effect in REGISTRY.values()], indent=1))
        return
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    table = Table(title="Effects", show_lines=False)
    for heading in ("effect", "parameter", "unit"):
        table.add_column(heading, no_wrap=True)
    for heading in ("null", "bounds"):
        table.add_column(heading, justify="right", no_wrap=True)
    table.add_column("meaning", ratio=1)
    for effect in REGISTRY.values():
        table.add_section()
        name = f"[bold]{effect.name}[/bold]"
        for p in effect.theta:
            low, high = p.bounds
            table.add_row(
                name, p.name, p.unit, f"{p.null:g}", f"{low:g} to {high:g}", escape(p.doc)
            )
            name = ""
    Console().print(table)


def _as_object(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "stage": effect.stage.value,
        "doc": effect.doc,
        "signature": effect.signature,
        "parameters": [
            {
                "name": p.name,
                "unit": p.unit,
                "null": p.null,
                "bounds": list(p.bounds),
                "doc": p.doc,
            }
            for p in effect.theta
        ],
    }
