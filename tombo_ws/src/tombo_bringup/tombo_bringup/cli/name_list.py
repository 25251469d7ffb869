"""A list of what comes with the suite: names, and what each is."""

from __future__ import annotations

import json
from collections.abc import Mapping

import typer


def print_names(table: Mapping[str, str], own: str, as_json: bool) -> None:
    """Print names with their descriptions; as JSON, or for readers with what to do for `own`."""
    if as_json:
        listed = [{"name": name, "description": text} for name, text in table.items()]
        typer.echo(json.dumps(listed, indent=1))
        return
    width = max(map(len, table))
    for name, text in table.items():
        typer.echo(f"{typer.style(name.ljust(width), bold=True)}  {text}")
    typer.echo(f"\n{own}")
