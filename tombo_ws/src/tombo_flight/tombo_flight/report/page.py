"""A page of results: the result of a command, for terminal, JSON and page.

Renderers: `page_html` for a browser, `terminal.print_page` for a terminal, `page_json` for
programs. All texts are plain; a renderer escapes them.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tombo_flight.json_text import as_json
from tombo_flight.process.output_folder import write_whole

if TYPE_CHECKING:
    from jinja2 import Environment
    from matplotlib.figure import Figure

Medium = Literal["both", "page", "terminal"]
"""Medium that shows a section: `page` is the HTML page."""


@dataclass(frozen=True)
class Card:
    """A figure of the header."""

    name: str
    value: str
    unit: str = ""
    note: str = ""
    """Small text below the value."""


@dataclass(frozen=True)
class Cell:
    """A cell of a table, where its text alone is not enough."""

    text: str
    style: str = ""
    """good, warn, bad or muted, also on a terminal; or a class of the style sheet."""
    small: str = ""
    """Small text after it."""
    tooltip: str = ""
    link: str = ""
    """A place in the page that it leads to: `#anchor`."""
    code: bool = False
    """It is a command or a name in code."""
    badge: bool = False
    """Its text is a verdict, shown as a badge."""
    bar: float | None = None
    """Length of a bar before the text, 0 to 1."""
    html: str = ""
    """HTML that the page shows before the text, such as a drawing."""


@dataclass(frozen=True)
class TableRow:
    """A row of a table, where its cells alone are not enough."""

    cells: Sequence[str | Cell]
    style: str = ""
    """group: one cell over the whole width, the heading of the rows below; muted; best; or a
    class of the style sheet."""
    anchor: str = ""
    """Name of its place in the page."""


def cell_of(cell: str | Cell) -> Cell:
    """Return a cell of a table; a text becomes a cell."""
    return cell if isinstance(cell, Cell) else Cell(cell)


def row_of(row: TableRow | Sequence[str | Cell]) -> TableRow:
    """Return a row of a table; a sequence of cells becomes a row."""
    return row if isinstance(row, TableRow) else TableRow(row)


@dataclass(frozen=True)
class Table:
    """A table; the first cell of a row is its heading."""

    head: Sequence[str]
    """Column headings; none: no line of headings."""
    rows: Sequence[TableRow | Sequence[str | Cell]]
    style: str = ""
    """Class of the style sheet."""
    title: str = ""
    note: str = ""
    """Small text below."""


@dataclass(frozen=True)
class Text:
    """Sentences."""

    lines: Sequence[str]
    kind: Literal["paragraphs", "list", "hint", "command", "heading"] = "paragraphs"
    """hint: small and grey; command: lines to be copied."""
    style: str = ""


@dataclass(frozen=True)
class Picture:
    """A figure with its caption; a terminal leaves it out."""

    draw: Callable[[], Figure]
    """Called when a page is made."""
    caption: str
    name: str = ""
    """Shown in bold before the caption."""
    style: str = "picture"
    """picture: as wide as the page; narrow."""


@dataclass(frozen=True)
class Markup:
    """HTML as it is, such as the stage of the 3-D replay; a terminal leaves it out."""

    html: str


@dataclass(frozen=True)
class Folded:
    """Items that the page shows when they are asked for."""

    title: str
    items: Sequence[Item]


@dataclass(frozen=True)
class Group:
    """Items that belong together: a block of the page, or pictures side by side."""

    items: Sequence[Item]
    style: str
    """Class of the style sheet; figures: pictures side by side."""


Item = Table | Text | Picture | Markup | Folded | Group


@dataclass(frozen=True)
class Section:
    """Items below a heading; a section without items is left out."""

    title: str
    items: Sequence[Item]
    medium: Medium = "both"


@dataclass(frozen=True)
class Page:
    """A page of results."""

    title: str
    """Title of the browser's tab."""
    eyebrow: str
    """Small line above the headline."""
    headline: str
    summary: str
    sections: Sequence[Section]
    data: Mapping[str, Any] = field(default_factory=dict)
    """The same for programs."""
    cards: Sequence[Card] = ()
    footer: str = ""
    verdict: str = ""
    """Badge next to the eyebrow."""
    verdict_style: str = ""
    """good, warn or bad."""
    css: str = ""
    """Beside that of all pages."""
    scripts: str = ""
    """Script elements at the end of the HTML page."""

    def shown_by(self, medium: Medium) -> list[Section]:
        """Return the sections with content that `medium` shows."""
        return [s for s in self.sections if s.items and s.medium in ("both", medium)]


def page_json(page: Page) -> str:
    """Return the page's data as the text of a JSON file."""
    return as_json(page.data)


def page_html(page: Page) -> str:
    """Return a page as HTML; it loads nothing from anywhere."""
    return _environment().get_template("results.html.j2").render(page=page)


def write_page(path: Path, page: Page) -> None:
    """Write a page as an HTML file, whole or not at all.

    Raises:
        OSError: the file can't be written.
    """
    write_whole(path, page_html(page))


def asset(name: str) -> str:
    """Return the text of a file in the template's folder."""
    return (resources.files(__package__) / "assets" / name).read_text(encoding="utf-8")


@cache
def _environment() -> Environment:
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup as SafeText

    made = Environment(
        loader=PackageLoader("tombo_flight", "report/assets"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["kind"] = _kind
    made.filters["row"] = row_of
    made.filters["cell"] = cell_of
    made.filters["png"] = _png
    made.globals["asset"] = lambda name: SafeText(asset(name))
    return made


def _png(figure: Figure) -> str:
    """Return a figure as the address of a picture inside the page."""
    from tombo_flight.report.style import figure_bytes  # it loads numpy; a command's help does not

    return f"data:image/png;base64,{base64.b64encode(figure_bytes(figure)).decode('ascii')}"


def _kind(item: Item) -> str:
    return type(item).__name__.lower()
