"""A page of results as tests read it: strictly, and with blank pictures where texts are asked."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import replace
from html.parser import HTMLParser
from typing import Any

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tombo_flight.report.page import Folded, Group, Item, Page, Picture, page_html

VOID = {"meta", "link", "img", "input", "br", "hr", "line", "circle", "path", "rect", "use"}
_BLANK = Figure(figsize=(1.0, 1.0))
FigureCanvasAgg(_BLANK)


class PageReader(HTMLParser):
    """Reads a page; every element is closed, in order."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.open: list[tuple[str, str | None]] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.texts: dict[tuple[str, str | None], list[str]] = {}
        """(element, its id) → the texts right in it."""
        self.words: list[str] = []
        """Texts that a reader sees."""
        self.feed(html)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag, attributes):
        self.handle_startendtag(tag, attributes)
        if tag not in VOID:
            self.open.append((tag, dict(attributes).get("id")))

    def handle_startendtag(self, tag, attributes):
        self.elements.append((tag, dict(attributes)))

    def handle_endtag(self, tag):
        if tag not in VOID:
            assert self.open and self.open[-1][0] == tag, f"</{tag}> closes {self.open[-1:]}"
            self.open.pop()

    def handle_data(self, data):
        if self.open:
            self.texts.setdefault(self.open[-1], []).append(data)
        if not {"style", "title", "script"} & {tag for tag, _ in self.open}:
            self.words.append(data)

    @property
    def text(self) -> str:
        return re.sub(r"\s+", " ", "".join(self.words))

    def text_in(self, tag: str, name: str | None = None) -> str:
        return "".join(self.texts.get((tag, name), []))

    def block(self, name: str) -> Any:
        """Return the JSON of a script element."""
        return json.loads(self.text_in("script", name))

    def values(self, *names: str) -> list[str]:
        """Return the values of attributes, in all elements."""
        return [str(a[name]) for _, a in self.elements for name in names if name in a]


def loads_nothing(html: str, page: PageReader) -> None:
    """Assert that a page asks for nothing from anywhere."""
    assert not re.search(r"https?:|//[a-z0-9.-]+\.[a-z]{2,}/|@import|url\((?!#)", html)
    addresses = page.values("src", "href", "srcset", "action", "data", "poster", "xlink:href")
    assert all(address.startswith(("data:", "#")) for address in addresses), addresses
    assert not {"iframe", "object", "embed", "base", "form"} & {tag for tag, _ in page.elements}
    policy = next(str(a["content"]) for _, a in page.elements if a.get("http-equiv"))
    assert policy.startswith("default-src 'none'")


def blank(page: Page) -> Page:
    """Return a page with blank pictures: to draw them takes nearly all of its time."""

    def of(items: Sequence[Item]) -> list[Item]:
        return [
            replace(item, draw=lambda: _BLANK) if isinstance(item, Picture)
            else replace(item, items=of(item.items)) if isinstance(item, (Folded, Group))
            else item
            for item in items
        ]  # fmt: skip

    return replace(page, sections=[replace(s, items=of(s.items)) for s in page.sections])


def blank_html(page: Page) -> str:
    """Return a page as HTML, with blank pictures."""
    return page_html(blank(page))
