"""Tables and lines on the terminal, for all commands."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import typer
from rich.console import Console
from rich.text import Text

from tombo_flight.json_text import as_json as as_json_text

if TYPE_CHECKING:
    from tombo_flight.report.page import Page, Table

_ONE_LINE: Final = 10_000
"""Columns of a console that nobody looks at: no row of a table is wider."""


def console(**more: Any) -> Console:
    """Return standard output for tables: as wide as the terminal; elsewhere a row is one line.

    Args:
        more: further arguments of `Console`.
    """
    made = Console(**more)
    return made if made.is_terminal else Console(width=_ONE_LINE, **more)


def print_names(table: Mapping[str, str], hint: str, as_json: bool) -> None:
    """Print names with their descriptions; as JSON, or for readers with a hint behind them."""
    if as_json:
        listed = [{"name": name, "description": text} for name, text in table.items()]
        print(json.dumps(listed, indent=1))
        return
    width = max(map(len, table))
    for name, text in table.items():
        typer.echo(f"{typer.style(name.ljust(width), bold=True)}  {text}")
    print(f"\n{hint}")


def print_parameters(
    what: str, value: str, entries: Sequence[Mapping[str, Any]], as_json: bool
) -> None:
    """Print named things with their parameters, as a table or as JSON.

    Args:
        what: they are called.
        value: key and heading of a parameter's value: null, default.
        entries: name, doc (its first line is printed) and parameters: name, unit, `value`,
            bounds, doc.
        as_json: the entries as they are, more than these keys included.
    """
    if as_json:
        print(json.dumps(entries, indent=1))
        return
    from tombo_flight.report.page import Table, TableRow

    rows: list[TableRow] = []
    for entry in entries:
        rows.append(TableRow([entry["name"], "", "", "", entry["doc"].partition("\n")[0]], "best"))
        for p in entry["parameters"]:
            bounds = f"{p['bounds'][0]:g} to {p['bounds'][1]:g}" if p["bounds"] else ""
            number = "" if p[value] is None else f"{p[value]:g}"
            rows.append(TableRow([f"  {p['name']}", p["unit"] or "", number, bounds, p["doc"]]))
    print_table(Table((what, "unit", value, "bounds", "meaning"), rows))


def show_page(
    page: Page, as_json: bool, folder: Path | None = None, files: Sequence[str] = ()
) -> None:
    """Show the result of a command: its data as JSON, or its page on the terminal.

    Args:
        page: the result.
        as_json: print JSON alone.
        folder: where its files are; None: nothing was written.
        files: their names.
    """
    if as_json:
        place = {} if folder is None else {"folder": str(folder)}
        print(as_json_text({**place, **page.data}), end="")
        return
    from tombo_flight.report.terminal import print_page

    print_page(page, console())
    if folder is not None:
        print_line(f"{folder}: {', '.join(files)}")


def print_table(table: Table) -> None:
    """Print a table as a page of results shows it."""
    from tombo_flight.report.terminal import print_item

    print_item(table, console())


def print_line(text: str, style: str = "") -> None:
    """Print a line, however long it gets."""
    console().print(Text(text, style), soft_wrap=True)
