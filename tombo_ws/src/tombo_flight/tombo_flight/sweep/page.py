"""The HTML page of a sweep: maps, distributions, and failures with the command of each."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_flight.campaign.campaign_plot import PANELS
from tombo_flight.report.flight_plot import figure_bytes
from tombo_flight.report.html_page import Card, Page, page_html, pictures, table
from tombo_flight.sweep.plots import Columns, draw_dependence, draw_distributions
from tombo_flight.sweep.study import Sweep

if TYPE_CHECKING:
    import pyarrow as pa

MOST_FAILURES = 200
"""Failures that are listed; the table has all of them."""
_NEEDED = ("crashed", "collided", "landed", *(key for key, _, _ in PANELS))


def write_page(path: Path, table_file: Path, sweep: Sweep) -> str:
    """Write the page of a sweep's table, and return the outcome in one line."""
    import pyarrow.parquet as pq

    keys = [axis.key for axis in sweep.design.axes]
    names = dict.fromkeys(("flight", *keys, *_NEEDED, "error"))
    read = pq.read_table(table_file, columns=list(names))
    columns = {name: _numbers(read, name, sweep) for name in names if name != "error"}
    errors = np.array(read.column("error").is_valid())
    outcome = outcome_line(columns, errors)
    text = page_html(_page(sweep, columns, errors, outcome, read))
    path.write_text(text, encoding="utf-8", newline="\n")
    return outcome


def outcome_line(columns: Columns, errors: Array) -> str:
    """Return how the flights of a sweep ended, in one line."""
    flights, crashed = errors.size, int(np.nansum(columns["crashed"]))
    line = f"{crashed} of {flights} crashed"
    return f"{line}, {int(errors.sum())} not flown" if errors.any() else line


def _numbers(read: pa.Table, name: str, sweep: Sweep) -> Array:
    """Return a column as floats: NaN for null, a level's number for text."""
    import pyarrow as pa

    column = read.column(name)
    if pa.types.is_string(column.type):
        levels = next(axis.levels for axis in sweep.design.axes if axis.key == name)
        return np.array([levels.index(value) for value in column.to_pylist()], dtype=np.float64)
    found: Array = column.cast(pa.float64()).to_numpy()
    return found


def _page(sweep: Sweep, columns: Columns, errors: Array, outcome: str, read: Any) -> Page:
    seeds = sweep.seeds[1] - sweep.seeds[0]
    kinds = {"full": "full factorial", "lhs": "Latin hypercube", "sobol": "Sobol sequence"}
    flights = errors.size
    crashed, collided = (int(np.nansum(columns[name])) for name in ("crashed", "collided"))
    recovered = int(np.isfinite(columns["recovery_time_s"]).sum())
    cards = [
        Card("flights", f"{flights}"),
        Card("crashed", f"{100.0 * crashed / flights:.1f}", "%", f"{crashed} of {flights}"),
        Card("settled", f"{recovered}", "", f"of {collided} that collided"),
    ]
    for key, name, unit in (
        ("recovery_time_s", "recovery time", "s"),
        ("max_falling_distance_m", "falling distance", "m"),
    ):
        there = columns[key][np.isfinite(columns[key])]
        if there.size:
            low, median, high = np.percentile(there, (5.0, 50.0, 95.0))
            cards.append(Card(name, f"{median:.2f}", unit, f"5 to 95 %: {low:.2f} to {high:.2f}"))
    maps = [(figure_bytes(f), "", text) for f, text in draw_dependence(sweep.design.axes, columns)]
    spread = [(figure_bytes(draw_distributions(columns)), "", "All flights; line: median")]
    return Page(
        title=f"Sweep of {sweep.label}",
        eyebrow="Sweep",
        headline=sweep.label,
        summary=(
            f"{kinds[sweep.design.kind]}: {sweep.design.points} points over "
            f"{', '.join(axis.key for axis in sweep.design.axes) or 'no axis'}, {seeds} "
            f"seeds each. {outcome}."
        ),
        cards=cards,
        sections=[
            ("How it depends on what was varied", pictures(maps)),
            ("Distributions", pictures(spread)),
            ("Failures, and how to fly them again", _failures(sweep, columns, errors, read)),
        ],
        footer=f"tombo {sweep.tombo_version}; all figures of all flights: flights.parquet",
    )


def _failures(sweep: Sweep, columns: Columns, errors: Array, read: Any) -> str:
    failed = np.flatnonzero(np.logical_or(columns["crashed"] > 0.0, errors))
    if not failed.size:
        return "<p>None.</p>"
    lines = []
    for row in failed[:MOST_FAILURES]:
        flight = int(columns["flight"][row])
        why = str(read.column("error")[int(row)].as_py()) if errors[row] else "crashed"
        cells = (str(flight), why)
        command = f"<td><code>{escape(sweep.command(flight))}</code></td>"
        cell = "".join(f"<td>{escape(text)}</td>" for text in cells)
        lines.append(f"<tr>{cell}{command}</tr>")
    more = failed.size - len(lines)
    rest = f"<p>And {more} more in the table.</p>" if more > 0 else ""
    return table(("flight", "outcome", "command"), lines) + rest
