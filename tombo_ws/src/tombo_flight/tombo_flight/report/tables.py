"""The tables of the report, as HTML text; every value is escaped here."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any, Final

import numpy as np

from tombo_flight.report.html_page import Card
from tombo_flight.report.milestones import number
from tombo_flight.report.paper_comparison import Row, fixed

_CARDS: Final = (
    "Largest falling distance",
    "Unstable phase",
    "Recovery time",
    "Detection latency",
    "Largest tilt",
    "Settled error",
)


@dataclass(frozen=True)
class Column:
    """Figures of the same flight with another reaction."""

    name: str
    """Of the reaction."""
    rows: Sequence[Row]


def comparison_table(
    rows: Sequence[Row], other: Column | None = None, *, paper: bool = True
) -> str:
    """Return the rows as a table, with their definitions as tooltips and as numbered notes below.

    Args:
        rows: of the flight.
        other: another flight, to compare it with.
        paper: with the paper's figures.
    """
    lines, notes = [], []
    others = [""] * len(rows)
    head = ""
    if other is not None:
        others = [f"<td>{_cell(row, row.flight, row.flight_text)}</td>" for row in other.rows]
        head = f'<th scope="col">The same with <code>{escape(other.name)}</code></th>'
    for i, row in enumerate(rows, start=1):
        printed = f"<td>{_cell(row, row.paper, row.paper_text)}</td>" if paper else ""
        compared = f'<td>{_difference(row)}</td><td class="wide">{_bullet(row)}</td>'
        lines.append(
            f'<tr><th scope="row">'
            f'<abbr title="{escape(row.definition)}">{_symbols(row.name)}</abbr>'
            f'<sup><a href="#note-{i}" id="row-{i}">{i}</a></sup></th>'
            f"{printed}<td>{_cell(row, row.flight, row.flight_text)}</td>"
            f"{others[i - 1]}{compared if paper else ''}</tr>"
        )
        notes.append(
            f'<li id="note-{i}"><b>{_symbols(row.name)}.</b> {_symbols(row.definition)} '
            f'<a href="#row-{i}" aria-label="back to the table">↑</a></li>'
        )
    printed = '<th scope="col">Paper</th>' if paper else ""
    compared = (
        '<th scope="col">Difference</th><th scope="col" class="wide">0 – paper – 2 × paper</th>'
    )
    return (
        '<div class="scroll"><table class="compare"><thead><tr><th scope="col">Figure</th>'
        f'{printed}<th scope="col">This flight</th>{head}{compared if paper else ""}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
        f'<details class="notes"><summary>What each figure means</summary>'
        f"<ol>{''.join(notes)}</ol></details>"
    )


def key_figures(rows: Sequence[Row], other: Column | None = None) -> list[Card]:
    """Return the key figures of the header; none if the flight has none of them."""
    others = {} if other is None else {row.name: row.flight for row in other.rows}
    shown = [row for row in rows if row.name in _CARDS]
    if all(row.flight is None for row in shown):
        return []
    found = []
    for row in shown:
        value, unit = "–", ""
        if row.flight is not None:
            value, unit = fixed(row.flight, row.digits), row.unit
        beside = [] if row.paper is None else [f"paper {fixed(row.paper, 1)} {row.unit}"]
        compared = others.get(row.name)
        if other is not None and compared is not None:
            beside.append(f"{other.name} {fixed(compared, row.digits)} {row.unit}")
        found.append(Card(row.name, value, unit, " · ".join(beside), tooltip=row.definition))
    return found


def events_table(events: Sequence[Mapping[str, Any]]) -> str:
    """The events of the flight in their order; each time is a button that seeks."""
    lines = []
    for event in events:
        time_s = number(event, "time_s")
        seek = "" if time_s is None else f'<button data-seek="{time_s!r}">{time_s:.3f} s</button>'
        lines.append(
            f"<tr><td>{seek}</td><td>{escape(str(event.get('kind', '')).replace('_', ' '))}</td>"
            f"<td>{escape(str(event.get('text', '')))}</td></tr>"
        )
    return f'<table class="plain"><tbody>{"".join(lines)}</tbody></table>'


def values_table(values: Mapping[str, Any]) -> str:
    """A nested mapping as a two-column table with dotted keys."""
    lines: list[str] = []
    _flatten("", values, lambda key, value: lines.append(_value_row(key, value)))
    return f'<table class="plain"><tbody>{"".join(lines)}</tbody></table>'


def _flatten(prefix: str, value: Any, emit: Callable[[str, Any], None]) -> None:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            _flatten(f"{prefix}.{key}" if prefix else str(key), item, emit)
    elif isinstance(value, (list, tuple)) and value and isinstance(value[0], Mapping):
        for i, item in enumerate(value):
            emit(f"{prefix}[{i}]", item)
    else:
        emit(prefix, value)


def _value_row(key: str, value: Any) -> str:
    return f"<tr><th scope='row'>{escape(key)}</th><td>{escape(_text(value))}</td></tr>"


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.6g}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(_text(item) for item in value) + "]"
    if isinstance(value, Mapping) and value:
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    return str(value)


def _cell(row: Row, value: float | None, text: str | None) -> str:
    if text is not None:
        return escape(text)
    return "–" if value is None else f"{fixed(value, row.digits)}&nbsp;{escape(row.unit)}"


def _difference(row: Row) -> str:
    if not row.paper or row.flight is None:
        return ""
    change = round(row.flight - row.paper, row.digits)
    if change == 0.0:
        return "none"
    percent = round(100.0 * (row.flight / row.paper - 1.0))
    share = f" ({_signed(percent, 0)}&nbsp;%)" if percent else ""
    return f"{_signed(change, row.digits)}&nbsp;{escape(row.unit)}{share}"


def _bullet(row: Row) -> str:
    """A small scale from nothing to twice the paper's figure, with this flight as a dot."""
    if not row.paper or row.flight is None:
        return ""
    x = 100.0 * min(max(row.flight / (2.0 * row.paper), 0.0), 1.0)
    return (
        '<svg class="bullet" viewBox="0 0 120 16" role="img" '
        f'aria-label="{row.flight / row.paper:.2f} of the paper\'s figure">'
        '<line x1="10" y1="8" x2="110" y2="8"/><line class="tick" x1="60" y1="2" x2="60" y2="14"/>'
        f'<circle cx="{10.0 + x:.1f}" cy="8" r="4.5"/></svg>'
    )


def _signed(value: float, digits: int) -> str:
    return f"{'+' if value > 0 else '−'}{abs(value):.{digits}f}"


def _symbols(text: str) -> str:
    """Escaped text with the paper's symbols set as symbols."""
    marked = escape(text)
    for letter, index in (("x", "c"), ("x", "r"), ("d", "r"), ("n", "r")):
        marked = marked.replace(f"{letter}_{index}", f"<var>{letter}</var><sub>{index}</sub>")
    return marked
