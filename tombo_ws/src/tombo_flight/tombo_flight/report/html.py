"""Pages of results as HTML files that need nothing but a browser."""

from __future__ import annotations

import base64
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Final

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup as SafeText

from tombo_flight.process.output_folder import write_whole
from tombo_flight.report.figure import figure_bytes
from tombo_flight.report.page import Item, Page, cell_of, row_of

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEMPLATE: Final = "results.html.j2"


def page_html(page: Page) -> str:
    """Return a page as HTML; it loads nothing from anywhere."""
    return _environment().get_template(_TEMPLATE).render(page=page)


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
    return f"data:image/png;base64,{base64.b64encode(figure_bytes(figure)).decode('ascii')}"


def _kind(item: Item) -> str:
    return type(item).__name__.lower()
