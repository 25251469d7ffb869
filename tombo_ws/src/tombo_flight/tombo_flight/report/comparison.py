"""The page of a comparison of two recordings, topic by topic and field by field."""

from __future__ import annotations

from tombo_bag.comparison import Comparison
from tombo_flight.report.page import Cell, Item, Page, Section, Table, TableRow, Text


def comparison_page(
    comparison: Comparison, name_a: str, name_b: str, *, fields: bool = True
) -> Page:
    """Return the page of a comparison.

    Args:
        comparison: the result.
        name_a: name of the first recording.
        name_b: name of the second recording.
        fields: add a table of the fields that differ; otherwise a remark says how to see them.
    """
    differing = sum(not topic.equal for topic in comparison.topics)
    total = len(comparison.topics)
    remark = Text(["Each field that differs: --topic NAME, or --json."])
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
        sections=[Section("", items), Section("", [remark] if differing and not fields else [])],
    )


def _topics(comparison: Comparison) -> Table:
    """Return a row for each topic: numbers of messages, and the first difference."""
    rows = []
    for topic in comparison.topics:
        rows.append((
            *(topic.topic, str(topic.messages_a), str(topic.messages_b)),
            Cell("equal", "good") if topic.equal else Cell("differs", "bad"),
            "" if topic.first_difference_s is None else _time(topic.first_difference_s),
            topic.first_difference or "",
        ))  # fmt: skip
    return Table(("topic", "in A", "in B", "", "first [s]", "first difference"), rows)


def _fields(comparison: Comparison) -> Table:
    """Return a row for each field that differs; the largest difference is in the field's unit."""
    rows: list[TableRow] = []
    for topic in comparison.topics:
        if topic.fields:
            rows.append(TableRow([topic.topic], "group"))
        for field in topic.fields:
            largest = "–" if field.largest is None else f"{field.largest:.6g}"
            first_s = _time(field.first_difference_s)
            rows.append(TableRow([field.field, str(field.messages), first_s, largest]))
    return Table(("field", "messages", "first [s]", "largest difference"), rows)


def _time(time_s: float) -> str:
    """Return a flight time with up to six digits after the point."""
    return f"{time_s:.6f}".rstrip("0").rstrip(".")
