"""The page of a sweep: maps, distributions, and failures with the command of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import combinations, islice, pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_flight.campaign.campaign import PANELS, draw_histogram, histograms
from tombo_flight.process.study import Task
from tombo_flight.process.study_folder import Fly, StudyFolder
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.page import Card, Cell, Item, Page, Picture, Section, Table, Text
from tombo_flight.sweep.study import Axis, SweepStudy

if TYPE_CHECKING:
    import pyarrow as pa


_MOST_CELLS = 40
"""Levels that are shown one by one; more are put together."""
_BINS = 12
_MOST_MAPS = 3
_MOST_TICKS = 12
_SHOWN = (
    ("crashed", "crashed [%]", "mean"),
    ("recovery_time_s", "recovery time, median [s]", "median"),
    ("max_falling_distance_m", "largest falling distance, median [m]", "median"),
)
"""Figure, label, what is made of it in a cell."""
Columns = Mapping[str, Array]
"""Name → (N,) floats, NaN for null."""


class AxisCells:
    """The cells of an axis: its levels, or bins of equal width."""

    def __init__(self, axis: Axis, values: Array) -> None:
        self.key = axis.key
        if axis.levels and len(axis.levels) <= _MOST_CELLS:
            self.labels = list(axis.levels)
            keys = np.array([float(v) for v in axis.levels]) if axis.numeric else None
            self.cell = (
                np.argmin(np.abs(values[:, None] - keys), axis=1)
                if keys is not None
                else values.astype(np.int64)
            )
            self.centres = keys if keys is not None else np.arange(len(axis.levels), dtype=float)
            return
        low, high = float(values.min()), float(values.max())
        edges = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
        self.cell = np.clip(np.searchsorted(edges, values, "right") - 1, 0, _BINS - 1)
        self.centres = 0.5 * (edges[1:] + edges[:-1])
        self.labels = [f"{centre:.3g}" for centre in self.centres]


def dependence_pictures(axes: Sequence[Axis], columns: Columns) -> list[Picture]:
    """Return maps over each pair of axes, or curves over the only one."""
    scales = [AxisCells(axis, columns[axis.key]) for axis in axes]
    if len(scales) == 1:
        words = f"Over {scales[0].key}; band: 5 to 95 %"
        return [Picture(partial(_curves, scales[0], columns), words)]
    return [
        Picture(
            partial(_maps, across, up, columns),
            f"Over {across.key} and {up.key}, all else together",
        )
        for up, across in islice(combinations(scales, 2), _MOST_MAPS)
    ]


def draw_distributions(columns: Columns) -> Figure:
    """Draw a histogram of each of the collision's figures."""
    with new_figure(12.0, 7.0, 110) as figure:
        for axes, (key, label, scale, printed) in zip(histograms(figure), PANELS, strict=True):
            values = scale * columns[key]
            draw_histogram(axes, values[np.isfinite(values)], label, printed)
    return figure


def _curves(scale: AxisCells, columns: Columns) -> Figure:
    with new_figure(12.0, 3.6, 110, layout="constrained") as figure:
        for axes, (key, label, kind) in zip(figure.subplots(1, 3), _SHOWN, strict=True):
            factor = 100.0 if kind == "mean" else 1.0
            cells = [scale.cell == cell for cell in range(len(scale.centres))]
            found = [factor * columns[key][cell] for cell in cells]
            middle = [_value(values, kind) for values in found]
            axes.plot(scale.centres, middle, color=style.BLUE, lw=1.8, marker=".")
            if kind == "median":
                low, high = ([_value(v, f"p{share}") for v in found] for share in (5, 95))
                axes.fill_between(scale.centres, low, high, color=style.FAINT, lw=0.0)
            axes.set(xlabel=scale.key, ylabel=label)
            if len(scale.labels) <= _MOST_TICKS:
                axes.set_xticks(scale.centres, scale.labels)
    return figure


def _maps(across: AxisCells, up: AxisCells, columns: Columns) -> Figure:
    with new_figure(12.0, 4.2, 110, layout="constrained") as figure:
        for axes, (key, label, kind) in zip(figure.subplots(1, 3), _SHOWN, strict=True):
            _map(figure, axes, across, up, columns[key], label, kind)
    return figure


def _map(
    figure: Figure,
    axes: Axes,
    across: AxisCells,
    up: AxisCells,
    values: Array,
    label: str,
    kind: str,
) -> None:
    shape = (len(up.labels), len(across.labels))
    cells = np.full(shape, np.nan)
    place = up.cell * shape[1] + across.cell
    order = np.argsort(place, kind="stable")
    first = np.searchsorted(place[order], np.arange(shape[0] * shape[1] + 1))
    for cell, (a, b) in enumerate(pairwise(first)):
        cells.flat[cell] = _value(values[order[a:b]], kind)
    limits = (0.0, 100.0) if kind == "mean" else (None, None)
    shown = axes.imshow(
        100.0 * cells if kind == "mean" else cells,
        origin="lower", aspect="auto", cmap="viridis", vmin=limits[0], vmax=limits[1],
    )  # fmt: skip
    figure.colorbar(shown, ax=axes)
    axes.set(title=label, xlabel=across.key, ylabel=up.key)
    axes.grid(visible=False)
    _ticks(axes.set_xticks, across.labels)
    _ticks(axes.set_yticks, up.labels)


def _ticks(set_ticks: Callable[..., Any], labels: Sequence[str]) -> None:
    every = -(-len(labels) // _MOST_TICKS)
    set_ticks(range(0, len(labels), every), labels[::every])


def _value(values: Array, kind: str) -> float:
    values = values[np.isfinite(values)]
    if not values.size:
        return np.nan
    if kind == "mean":
        return float(values.mean())
    return float(np.percentile(values, 50.0 if kind == "median" else float(kind[1:])))


MOST_FAILURES = 200
"""Failures that are listed; the table has all of them."""
_NEEDED = ("crashed", "collided", "landed", *(key for key, *_ in PANELS))


def analyse_sweep(sweep: SweepStudy, opened: StudyFolder, fly: Fly) -> Page:
    """Fly all points and return their page."""
    fly((Task(n, *sweep.place(n)) for n in range(sweep.flights)), sweep.flights)
    opened.finish()
    return sweep_page(opened.table, sweep)


def sweep_page(table_file: Path, sweep: SweepStudy) -> Page:
    """Return the page of a sweep's table."""
    import pyarrow.parquet as pq

    keys = [axis.key for axis in sweep.design.axes]
    names = dict.fromkeys(("flight", *keys, *_NEEDED, "error"))
    read = pq.read_table(table_file, columns=list(names))
    columns = {name: _numbers(read, name, sweep) for name in names if name != "error"}
    return _page(sweep, columns, read.column("error"))


def _outcome(columns: Columns, errors: pa.ChunkedArray) -> str:
    """Return how the flights of a sweep ended, in one line."""
    line = f"{int(np.nansum(columns['crashed']))} of {len(errors)} crashed"
    not_flown = len(errors) - errors.null_count
    return f"{line}, {not_flown} not flown" if not_flown else line


def _numbers(read: pa.Table, name: str, sweep: SweepStudy) -> Array:
    """Return a column as floats: NaN for null, a level's number for text."""
    import pyarrow as pa

    column = read.column(name)
    if pa.types.is_string(column.type):
        levels = next(axis.levels for axis in sweep.design.axes if axis.key == name)
        return np.array([levels.index(value) for value in column.to_pylist()], dtype=np.float64)
    found: Array = column.cast(pa.float64()).to_numpy()
    return found


def _page(sweep: SweepStudy, columns: Columns, errors: pa.ChunkedArray) -> Page:
    seeds = sweep.seeds[1] - sweep.seeds[0]
    kinds = {"full": "full factorial", "lhs": "Latin hypercube", "sobol": "Sobol sequence"}
    flights, outcome = len(errors), _outcome(columns, errors)
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
    spread = Picture(partial(draw_distributions, columns), "All flights; line: median")
    return Page(
        title=f"Sweep of {sweep.label}",
        eyebrow="Sweep",
        headline=sweep.label,
        summary=(
            f"{kinds[sweep.design.kind]}: {sweep.design.points} points over "
            f"{', '.join(axis.key for axis in sweep.design.axes) or 'no axis'}, {seeds} "
            f"seeds each; {flights} flights: {outcome}."
        ),
        cards=cards,
        sections=[
            Section(
                "How it depends on what was varied",
                dependence_pictures(sweep.design.axes, columns),
            ),
            Section("Distributions", [spread]),
            Section(
                "Failures, and how to fly them again", _failures(sweep, columns, errors), "page"
            ),
        ],
        data={"flights": flights, "outcome": outcome},
        footer=f"tombo {sweep.tombo_version}; all figures of all flights: flights.parquet",
    )


def _failures(sweep: SweepStudy, columns: Columns, errors: pa.ChunkedArray) -> list[Item]:
    failed = np.flatnonzero((columns["crashed"] > 0.0) | np.array(errors.is_valid()))
    if not failed.size:
        return [Text(["None."])]
    rows = []
    for row in failed[:MOST_FAILURES].tolist():
        flight = int(columns["flight"][row])
        why = errors[row].as_py() or "crashed"
        rows.append((str(flight), why, Cell(sweep.command(flight), code=True)))
    more = failed.size - len(rows)
    note = f"And {more} more in the table." if more > 0 else ""
    return [Table(("flight", "outcome", "command"), rows, note=note)]
