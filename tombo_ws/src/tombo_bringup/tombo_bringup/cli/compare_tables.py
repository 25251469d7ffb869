"""A comparison of two recordings on the terminal: a table of topics, a table of fields."""

from __future__ import annotations

from rich.box import SIMPLE_HEAD
from rich.table import Column, Table
from rich.text import Text

from tombo_bag.comparison import Comparison
from tombo_bringup.cli.tables import console, print_line, right


def print_comparison(found: Comparison, a: str, b: str) -> None:
    """Print a row per topic and, below, a row per field that differs."""
    out = console()
    table = Table(box=SIMPLE_HEAD, title=Text(f"A: {a}, B: {b}"), padding=(0, 1, 0, 0))
    for heading in ("topic", "in A", "in B", "", "first [s]", "first difference"):
        number = heading.startswith(("in", "first ["))
        table.add_column(heading, justify="right" if number else "left", overflow="fold")
    for topic in found.topics:
        first = ("", "") if topic.first is None else (_time(found, topic.first[0]), topic.first[1])
        verdict = Text("equal", "green") if topic.equal else Text("differs", "bold red")
        counts = [str(topic.messages_a), str(topic.messages_b)]
        table.add_row(Text(topic.topic), *counts, verdict, *map(Text, first))
    out.print(table)
    if any(topic.fields for topic in found.topics):
        out.print(_fields(found))
    if found.left_out:
        print_line(f"Not compared without --topic: {', '.join(found.left_out)}.")
    count = sum(not topic.equal for topic in found.topics)
    total = len(found.topics)
    if count:
        out.print(Text(f"{count} of {total} topics differ.", "bold red"))
    else:
        out.print(Text(f"Nothing differs on {total} topics.", "bold green"))


def _fields(found: Comparison) -> Table:
    numbers = right("messages", "first [s]", "largest difference", overflow="fold")
    table = Table(
        Column("field", overflow="fold"), *numbers, box=SIMPLE_HEAD, padding=(0, 1, 0, 0)
    )
    for topic in found.topics:
        if topic.fields:
            table.add_row(Text(topic.topic, "bold"))
        for field in topic.fields:
            table.add_row(
                Text(f"  {field.field}"),
                str(field.messages),
                _time(found, field.first_ns),
                "–" if field.largest is None else f"{field.largest:.6g}",
            )
    return table


def _time(found: Comparison, stamp_ns: int) -> str:
    return f"{found.seconds(stamp_ns):.6f}".rstrip("0").rstrip(".")
