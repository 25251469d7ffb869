"""Markdown of the documentation's tables."""

from __future__ import annotations

from collections.abc import Iterable, Sequence


def table_markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown, a line each for head and rows."""
    lines = (head, ["---"] * len(head), *rows)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)
