"""`tombo runs`: what was flown and computed, when, with which version, and how it ended."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from tombo_bringup.cli.options import JsonOnly


def runs(
    folder: Annotated[Path, typer.Argument(help="Folder of the runs.")] = Path("runs"),
    as_json: JsonOnly = False,
) -> None:
    """List the runs in a folder, the newest last: what, when, version with commit, outcome."""
    from tombo_flight.run_list import list_runs

    found = list_runs(folder)
    if as_json:
        typer.echo(json.dumps([run.as_mapping() for run in found], indent=1, ensure_ascii=False))
        return
    from rich.box import SIMPLE_HEAD
    from rich.table import Column, Table
    from rich.text import Text

    from tombo_bringup.cli.tables import console

    names = Column(str(folder), no_wrap=True)
    table = Table(names, "what", "when (UTC)", "version", "outcome", box=SIMPLE_HEAD)
    for run in found:
        when = run.when[:16].replace("T", " ")
        cells = (Path(run.folder).name, run.what or run.kind, when, run.version, run.outcome)
        table.add_row(*(Text(cell, overflow="fold") for cell in cells))
    console().print(table)
