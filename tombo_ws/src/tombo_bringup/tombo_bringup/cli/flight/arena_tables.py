"""The table of `tombo arena` on the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, Final

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from tombo_bringup.cli.tables import console, print_line
from tombo_flight.arena.page import headline
from tombo_flight.arena.results import HEAD, table_rows

_SHOWN: Final = (0, 1, 3, 5)
"""Columns for which a terminal has room, of ranges the median: the page has all."""


def print_arena(results: Mapping[str, Any]) -> None:
    """Print the reactions in each collision, and how many flights each lost in all."""
    table = Table(box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("case", no_wrap=True)
    for n in _SHOWN:
        table.add_column(Text(HEAD[n]), no_wrap=True, justify="right" if n else "left")
    for case, rows in table_rows(results):
        for i, row in enumerate(rows):
            cells = (row[n] if HEAD[n] == "crashed" else row[n].split(" (")[0] for n in _SHOWN)
            table.add_row(Text(case if i == 0 else ""), *(Text(cell) for cell in cells))
    if table.row_count:
        console().print(table)
    for case, reason in results["refused"].items():
        print_line(f"{case} is not flown: {reason}", "yellow")
    print_line(f"{headline(results)}.", "bold")
