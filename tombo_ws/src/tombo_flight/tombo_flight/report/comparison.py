"""Two recordings compared: the result as a page, and a picture of the topics that differ."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tombo_bag.comparison import Comparison, TopicComparison, Trace
from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.page import Cell, Item, Page, Section, Table, TableRow, Text

WIDTH_IN: Final = 12.0
ROW_IN: Final = 1.7
DPI: Final = 120
_MOST_ROWS: Final = 60
_FEW: Final = 30
"""Below this number of points each is marked."""


def comparison_page(
    comparison: Comparison, name_a: str, name_b: str, *, fields: bool = True
) -> Page:
    """Return the page of a comparison.

    Args:
        comparison: the result.
        name_a: of the first recording.
        name_b: of the second one.
        fields: a row for each field that differs, too, not for each topic alone.
    """
    differing = sum(not topic.equal for topic in comparison.topics)
    total = len(comparison.topics)
    remarks = []
    if comparison.left_out:
        remarks.append(f"Not compared without --topic: {', '.join(comparison.left_out)}.")
    if differing and not fields:
        remarks.append("Each field that differs: --topic NAME, or --json.")
    items: list[Item] = [_topics(comparison)]
    if fields and any(topic.fields for topic in comparison.topics):
        items.append(_fields(comparison))
    return Page(
        title="Comparison of two recordings",
        eyebrow="Comparison",
        headline=f"A: {name_a}, B: {name_b}",
        verdict="differs" if differing else "equal",
        verdict_style="bad" if differing else "good",
        summary=f"{differing} of {total} topics differ."
        if differing
        else f"Nothing differs on {total} topics.",
        sections=[Section("", items), Section("", [Text(remarks)] if remarks else [])],
    )


def _topics(comparison: Comparison) -> Table:
    rows = []
    for topic in comparison.topics:
        stamp_ns, difference = topic.first or (None, "")
        rows.append((
            *(topic.topic, str(topic.messages_a), str(topic.messages_b)),
            Cell("equal", "good") if topic.equal else Cell("differs", "bad"),
            "" if stamp_ns is None else _time(comparison, stamp_ns),
            difference,
        ))  # fmt: skip
    return Table(("topic", "in A", "in B", "", "first [s]", "first difference"), rows)


def _fields(comparison: Comparison) -> Table:
    rows: list[TableRow] = []
    for topic in comparison.topics:
        if topic.fields:
            rows.append(TableRow([topic.topic], "group"))
        for field in topic.fields:
            largest = "–" if field.largest is None else f"{field.largest:.6g}"
            first_s = _time(comparison, field.first_ns)
            rows.append(TableRow([field.field, str(field.messages), first_s, largest]))
    return Table(("field", "messages", "first [s]", "largest difference"), rows)


def _time(comparison: Comparison, stamp_ns: int) -> str:
    return f"{comparison.seconds(stamp_ns):.6f}".rstrip("0").rstrip(".")


def draw_comparison(comparison: Comparison, name_a: str, name_b: str) -> Figure:
    """Draw the number that differs first on each differing topic, left; B - A, right.

    Marks at the lower edge are messages of A only, at the upper edge those of B only. More than
    60 topics: the first 60.
    """
    topics = [topic for topic in comparison.topics if not topic.equal]
    rows = topics[:_MOST_ROWS]
    height_in = 0.9 + ROW_IN * max(len(rows), 1)
    with new_figure(WIDTH_IN, height_in, DPI, layout="constrained") as figure:
        figure.suptitle(
            f"A: {name_a}   ·   B: {name_b}   ·   "
            f"{len(topics)} of {len(comparison.topics)} topics differ",
            x=0.01, ha="left", weight="bold", size=10, parse_math=False,
        )  # fmt: skip
        if not rows:
            return figure
        grid = figure.subplots(len(rows), 2, sharex=True, squeeze=False)
        for (left, right), topic in zip(grid, rows, strict=True):
            _row(left, right, comparison, topic)
        for axes in grid[-1]:
            axes.set_xlabel("flight time [s]")
        grid[0, 0].legend(loc="upper left", bbox_to_anchor=(0.0, 1.5), ncols=2)
    return figure


def _row(left: Axes, right: Axes, comparison: Comparison, topic: TopicComparison) -> None:
    def seconds(stamps: Array | NDArray[np.int64]) -> Array:
        return np.asarray((stamps - comparison.epoch_ns) / 1e9)

    nothing = np.zeros((0, 2))
    trace = topic.trace or Trace("", nothing, nothing, nothing)
    for points, colour, width, label in (
        (trace.a, style.ORANGE, 3.0, "A"),
        (trace.b, style.BLUE, 1.0, "B"),
    ):
        marker = "o" if len(points) < _FEW else ""
        left.plot(
            seconds(points[:, 0]), points[:, 1],
            color=colour, linewidth=width, marker=marker, markersize=2 + width, label=label,
        )  # fmt: skip
    first = topic.first or (comparison.epoch_ns, "")
    left.set_title(
        f"{topic.topic}   first at {comparison.seconds(first[0]):.3f} s: {first[1]}",
        loc="left",
        size=8.5,
        parse_math=False,
    )
    left.set_ylabel(trace.name.split(".")[-1], size=7.5)
    marker = "." if len(trace.difference) < _FEW else ""
    right.plot(
        seconds(trace.difference[:, 0]), trace.difference[:, 1],
        color=style.VERMILLION, marker=marker,
    )  # fmt: skip
    right.set_title(
        f"B − A, {trace.name}" if topic.trace else "no number of a paired message differs",
        loc="left",
        size=8.5,
        parse_math=False,
    )
    for stamps, height, colour in (
        (topic.only_a_ns, 0.04, style.ORANGE),
        (topic.only_b_ns, 0.96, style.BLUE),
    ):
        for axes in (left, right):
            axes.plot(
                seconds(stamps), np.full(len(stamps), height), "|", color=colour, markersize=7,
                transform=axes.get_xaxis_transform(),
            )  # fmt: skip
    if topic.trace is None:
        left.set_yticks([])
        right.set_yticks([])
