"""`tombo runs`, `scenarios`, `effects` and `reactions`: lists of what there is."""

from __future__ import annotations

import dataclasses
import inspect
import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tombo_bringup.cli.options import Imports, JsonOnly

if TYPE_CHECKING:
    from tombo_collision.reactions import Reaction
    from tombo_dynamics.effects import Effect

app = typer.Typer()


@app.command()
def runs(
    folder: Annotated[Path, typer.Argument(help="Folder of the runs.")] = Path("runs"),
    as_json: JsonOnly = False,
) -> None:
    """List the runs in a folder, the newest last: what, when, version with commit, outcome."""
    from tombo_flight.run_list import list_runs

    listed = list_runs(folder)
    if as_json:
        typer.echo(json.dumps([run.as_mapping() for run in listed], indent=1, ensure_ascii=False))
        return
    from rich.box import SIMPLE_HEAD
    from rich.table import Column, Table
    from rich.text import Text

    from tombo_bringup.cli.tables import console

    names = Column(str(folder), no_wrap=True)
    table = Table(names, "what", "when (UTC)", "version", "outcome", box=SIMPLE_HEAD)
    for run in listed:
        when = run.when[:16].replace("T", " ")
        cells = (Path(run.folder).name, run.what or run.kind, when, run.version, run.outcome)
        table.add_row(*(Text(cell, overflow="fold") for cell in cells))
    console().print(table)


@app.command()
def scenarios(as_json: JsonOnly = False) -> None:
    """List the scenarios that come with the suite."""
    from tombo_bringup.cli.tables import print_names
    from tombo_flight.scenario_catalogue import builtin_scenarios

    own = "Your own file: tombo fly my_scenario.yaml, with `extends: paper_collision`."
    print_names(builtin_scenarios(), own, as_json)


@app.command()
def effects(imports: Imports = None, as_json: JsonOnly = False) -> None:
    """List every effect that a scenario can switch on, with its parameters.

    Each is set by `effects.NAME.PARAMETER` in a scenario file or with --set. With all parameters
    at their null value an effect adds exactly nothing.
    """
    from tombo_bringup.cli.tables import print_parameters
    from tombo_dynamics.effects import REGISTRY

    print_parameters("effect", "null", [_effect(e) for e in REGISTRY.values()], as_json)


@app.command()
def reactions(imports: Imports = None, as_json: JsonOnly = False) -> None:
    """List every reaction to a collision, with its parameters and what it needs.

    `tombo fly --reaction NAME` chooses one, as `reaction: {name: NAME}` in a scenario file does;
    its parameters stand beside the name, or are --set as `reaction.KEY=VALUE`.
    """
    from tombo_bringup.cli.tables import print_parameters
    from tombo_collision.reactions import REGISTRY

    table = [_reaction(kind) for kind in REGISTRY.values()]
    print_parameters("reaction", "default", table, as_json)


def _effect(effect: Effect) -> dict[str, Any]:
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


def _reaction(kind: type[Reaction]) -> dict[str, Any]:
    return {
        "name": kind.name,
        "doc": inspect.getdoc(kind) or "",
        "needs": list(kind.needs),
        "parameters": [
            {"name": f.name, "default": f.default}
            | {key: f.metadata.get(key) for key in ("unit", "bounds", "doc", "source")}
            for f in dataclasses.fields(kind)
        ],
    }
