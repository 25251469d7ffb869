"""Parts of a page that are written from the code: what stands between their markers."""

from __future__ import annotations

from collections.abc import Mapping

from tombo_dynamics.errors import InputError


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
