"""The page, the picture and the documentation's table of how cost grows."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from statistics import median
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_benchmarks.docs.markdown import table_markdown
from tombo_benchmarks.growth.cost_growth import Growth, Slope, column, slope, upper_half
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.page import Page, Picture, Section, Table, Text

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLUMNS: Final = {"seconds": "seconds", "size": "bytes"}
_CAPTION: Final = "Seconds and bytes against what grows; lines: the fitted powers"
_LEAST_RANGE: Final = 10.0
"""What a panel shows, largest over least value: what does not grow looks flat."""
_HEAD: Final = ("", "flown", "sizes", "seconds, slope", "bytes, slope", "not run")


def growth_page(found: Sequence[Growth]) -> Page:
    """Return the page of a measurement."""
    cores, load = len(os.sched_getaffinity(0)), os.getloadavg()[0]
    summary = (
        f"Each size in a process of its own, on {cores} cores, load {load:.1f} at the end. Values "
        "are those of the largest size, medians. A slope is the power of growth over the upper "
        "half of the decades, with its 95 % interval."
    )
    left_out = [
        f"{growth.axis.name} {size}: {why}"
        for growth in found
        for size, why in growth.left_out.items()
    ]
    sections = [
        Section("Growth", [Table(_HEAD, _rows(found))]),
        Section("Picture", [Picture(lambda: draw_growth(found), _CAPTION)], "page"),
        Section("Not run, for lack of", [Text(left_out, "list")] if left_out else []),
    ]
    return Page(
        title="How cost grows",
        eyebrow="tombo_benchmarks.growth",
        headline="Seconds and bytes against what grows",
        summary=summary,
        sections=sections,
        data=as_data(found),
    )


def growth_markdown(found: Sequence[Growth], picture: str) -> str:
    """Return the table of a page of the documentation, and the picture that lies beside it."""
    table = table_markdown(_HEAD, _rows(found))
    return f"{table}\n{growth_page(found).summary}\n\n![{_CAPTION}]({picture})\n"


def as_data(found: Sequence[Growth]) -> dict[str, Any]:
    """Return a measurement as plain values."""
    return {
        growth.axis.name: {
            "flown": growth.axis.flown,
            "bytes_of": growth.axis.kept,
            "readings": {
                str(size): [reading._asdict() for reading in rows]
                for size, rows in growth.readings.items()
            },
            "slopes": {
                name: None if (fit := slope(column(growth, key))) is None else fit._asdict()
                for key, name in _COLUMNS.items()
            },
            "not_run": {str(size): why for size, why in growth.left_out.items()},
        }
        for growth in found
    }


def _rows(found: Sequence[Growth]) -> list[list[str]]:
    rows = []
    for growth in found:
        sizes = list(growth.readings)
        values = [_value(column(growth, key), name) for key, name in _COLUMNS.items()]
        left_out = ", ".join(map(str, growth.left_out)) or "–"
        rows.append([
            growth.axis.name, growth.axis.flown, f"{sizes[0]} to {sizes[-1]}",
            values[0], f"{growth.axis.kept}: {values[1]}", left_out,
        ])  # fmt: skip
    return rows


def _value(values: Mapping[int, Sequence[float]], name: str) -> str:
    last = median(values[max(values)])
    shown = f"{last:.3g} s" if name == "seconds" else f"{1e-6 * last:.3g} MB"
    return f"{shown}; {_power(slope(values))}"


def _power(fit: Slope | None) -> str:
    return "–" if fit is None else f"{fit.power:.2f} ({fit.low:.2f} to {fit.high:.2f})"


def draw_growth(found: Sequence[Growth]) -> Figure:
    """Draw seconds above bytes, a column for each axis."""
    with new_figure(2.1 * len(found), 4.2, 130, layout="constrained") as figure:
        axes = figure.subplots(2, len(found), squeeze=False)
        for panels, growth in zip(axes.T, found, strict=True):
            for panel, (key, name) in zip(panels, _COLUMNS.items(), strict=True):
                _draw(panel, column(growth, key), name)
            panels[0].set_title(growth.axis.name)
            panels[1].set_xlabel(growth.axis.name)
        axes[0, 0].set_ylabel("seconds")
        axes[1, 0].set_ylabel("bytes")
    return figure


def _draw(panel: Any, values: Mapping[int, Sequence[float]], name: str) -> None:
    colour = style.BLUE if name == "seconds" else style.VERMILLION
    points = [(size, value) for size, readings in values.items() for value in readings]
    panel.set(xscale="log", yscale="log")
    if max(values) < 10 * min(values):
        panel.set_xticks(list(values), labels=[str(size) for size in values])
        panel.minorticks_off()
    low, high = min(value for _, value in points), max(value for _, value in points)
    room = 1.5 * max(1.0, (_LEAST_RANGE * low / high) ** 0.5)
    panel.set_ylim(low / room, high * room)
    panel.plot(*zip(*points, strict=True), ".", color=colour, alpha=0.6)
    fit = slope(values)
    if fit is not None:
        last = max(values)
        x = np.array([upper_half(values)[0], last])
        panel.plot(x, median(values[last]) * (x / last) ** fit.power, color=style.INK, lw=1.0)
        panel.text(0.04, 0.94, f"slope {fit.power:.2f}", transform=panel.transAxes, va="top")
