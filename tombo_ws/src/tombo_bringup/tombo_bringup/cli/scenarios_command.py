"""`tombo scenarios`: what can be flown by name."""

from __future__ import annotations

import json

import typer

from tombo_bringup.cli.options import JsonOnly


def scenarios(as_json: JsonOnly = False) -> None:
    """List the scenarios that come with the suite."""
    from tombo_flight.scenario_catalogue import builtin_scenarios

    table = builtin_scenarios()
    if as_json:
        listed = [{"name": name, "description": text} for name, text in table.items()]
        typer.echo(json.dumps(listed, indent=1))
        return
    width = max(map(len, table))
    for name, text in table.items():
        typer.echo(f"{typer.style(name.ljust(width), bold=True)}  {text}")
    typer.echo("\nYour own file: tombo fly my_scenario.yaml, with `extends: paper_collision`.")
