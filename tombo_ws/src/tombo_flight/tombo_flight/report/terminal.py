"""Pages of results on a terminal."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Final

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as RichTable
from rich.text import Text as RichText

from tombo_flight.report.page import (
    Card,
    Cell,
    Folded,
    Group,
    Item,
    Page,
    Table,
    Text,
    cell_of,
    row_of,
)

_STYLES: Final = {
    "good": "bold green",
    "warn": "bold yellow",
    "bad": "bold red",
    "muted": "dim",
    "best": "bold",
    "group": "dim",
}
_NUMBER: Final = re.compile(r"[-+−<>≤≥~]?\s?\d.*|[-–]?")


def print_page(page: Page, console: Console) -> None:
    """Print the headline, the summary, the cards and the sections that a terminal shows."""
    title = RichText(page.headline, _STYLES.get(page.verdict_style, "bold"))
    if page.verdict:
        title.append(f"  {page.verdict}", _STYLES.get(page.verdict_style, ""))
    console.print(title, soft_wrap=True)
    _print_lines([page.summary], "", console)
    if page.cards:
        console.print(_card_table(page.cards))
    for section in page.shown_by("terminal"):
        if section.title and not all(_silent(item) for item in section.items):
            console.print(RichText(section.title, "bold"), soft_wrap=True)
        for item in section.items:
            print_item(item, console)


def _silent(item: Item) -> bool:
    if isinstance(item, Group):
        return all(map(_silent, item.items))
    return not isinstance(item, Table | Text)


def print_item(item: Item, console: Console) -> None:
    """Print what a section has; pictures and markup are left out."""
    if isinstance(item, Table):
        if item.title:
            console.print(RichText(item.title), soft_wrap=True)
        console.print(_table(item))
        _print_lines([item.note], "dim", console)
    elif isinstance(item, Text):
        mark = "- " if item.kind == "list" else ""
        style = {"hint": "dim", "heading": "bold"}.get(item.kind, _STYLES.get(item.style, ""))
        _print_lines([f"{mark}{line}" for line in item.lines], style, console)
    elif isinstance(item, Folded):
        _print_lines([f"… {item.title}"], "dim", console)
    elif isinstance(item, Group):
        for part in item.items:
            print_item(part, console)


def _print_lines(lines: list[str], style: str, console: Console) -> None:
    for line in lines:
        if line:
            console.print(RichText(line, style), soft_wrap=True)


def _card_table(cards: Sequence[Card]) -> RichTable:
    table = RichTable(box=None, show_header=False, padding=(0, 2, 0, 0))
    for card in cards:
        value = f"{card.value} {card.unit}".rstrip()
        table.add_row(RichText(card.name), RichText(value, "bold"), RichText(card.note, "dim"))
    return table


def _table(table: Table) -> RichTable:
    rows = [row_of(row) for row in table.rows]
    texts = [[cell_of(cell).text for cell in row.cells] for row in rows]
    width = max([len(table.head), *(len(cells) for cells in texts)])
    full = [cells for cells, row in zip(texts, rows, strict=True) if row.style != "group"]
    made = RichTable(box=SIMPLE_HEAD, show_header=bool(table.head), padding=(0, 1, 0, 0))
    shown = []
    for place in range(width):
        values = [cells[place] for cells in full if place < len(cells)]
        if full and not any(values):  # of drawings alone
            continue
        shown.append(place)
        number = place > 0 and all(_NUMBER.fullmatch(value) for value in values)
        heading = table.head[place] if place < len(table.head) else ""
        made.add_column(RichText(heading), justify="right" if number else "left")
    for row in rows:
        cells = [_cell_text(row.cells[place]) for place in shown if place < len(row.cells)]
        made.add_row(*cells, style=_STYLES.get(row.style, ""))
    return made


def _cell_text(shown: str | Cell) -> RichText:
    cell = cell_of(shown)
    text = RichText(cell.text, _STYLES.get(cell.style, ""))
    if cell.small:
        text.append(f"  {cell.small}", "dim")
    return text
