"""Markdown of the documentation: tables, and the parts of a page that are written from code."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from tombo_dynamics.errors import InputError


def table_markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table as Markdown, a line each for head and rows."""
    lines = (head, ["---"] * len(head), *rows)
    return "".join(f"| {' | '.join(line)} |\n" for line in lines)


def table_rows(text: str) -> list[list[str]]:
    """Return the cells of the one table of a text, without its head."""
    lines = [line for line in text.splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines[2:]]


def updated(page: str, tables: Mapping[str, str]) -> str:
    """Return a page with the tables between `<!-- NAME -->` and `<!-- /NAME -->`.

    Raises:
        InputError: a table has no markers.
    """
    for name, table in tables.items():
        begin, end = _between(page, name)
        page = page[:begin] + table + page[end:]
    return page


def marked(page: str, name: str) -> str:
    """Return what stands between a page's `<!-- NAME -->` and `<!-- /NAME -->`."""
    begin, end = _between(page, name)
    return page[begin:end]


def _between(page: str, name: str) -> tuple[int, int]:
    head, tail = f"<!-- {name} -->\n", f"<!-- /{name} -->"
    begin = page.find(head) + len(head)
    end = page.find(tail, begin)
    if begin < len(head) or end < 0:
        raise InputError(f"the page has no <!-- {name} --> ... <!-- /{name} -->")
    return begin, end
