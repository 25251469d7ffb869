"""A figure in the style of all figures, and as a picture inside a page."""

from __future__ import annotations

import io
import re
from collections.abc import Iterator
from contextlib import contextmanager
from html import escape
from typing import TYPE_CHECKING, Any, Final

from tombo_flight.report import style

if TYPE_CHECKING:  # it takes long to load
    from matplotlib.figure import Figure

_PAGE_COLOURS: Final = {
    style.INK: "--ink",
    style.MUTED: "--muted",
    style.FAINT: "--line",
    style.PAPER: "--panel",
    style.BLUE: "--blue",
    style.GREEN: "--green",
    style.ORANGE: "--orange",
    style.VERMILLION: "--vermillion",
    style.PURPLE: "--purple",
    style.UNCHANGED: "--same",
}
"""Colour of a figure → that of the page's style sheet, one for light and one for dark."""
_DECIMAL: Final = re.compile(r"(?<=[ \"(])-?\d+\.\d{2,}(?=[ \",)])")
_TAG: Final = re.compile(r"<[^>]*>")
"""Coordinates are inside tags; numbers in texts stay as they are."""
_MARKERS: Final = re.compile(
    r'(?P<group><g clip-path="[^"]*")>(?P<uses> *<use [^>]*?(?P<style> style="[^"]*")/>'
    r"(?: *<use [^>]*?(?P=style)/>)*)"
)


@contextmanager
def new_figure(
    width_in: float, height_in: float, dpi: int, font_size: float = 8.5, **more: Any
) -> Iterator[Figure]:
    """Make a figure without a window, to be drawn within the context; `more` goes to it."""
    import matplotlib as mpl
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    legend = style.RC["legend.fontsize"] / style.RC["font.size"] * font_size
    with mpl.rc_context({**style.RC, "font.size": font_size, "legend.fontsize": legend}):
        figure = Figure(figsize=(width_in, height_in), dpi=dpi, **more)
        FigureCanvasAgg(figure)
        yield figure


def inline_svg(figure: Figure, name: str) -> str:
    """Return a figure as an SVG element of a page, in the page's font and colours.

    Args:
        figure: its background is left out.
        name: description, for readers who can't see it; plain text.
    """
    import matplotlib as mpl

    buffer = io.StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": "tombo"}):
        figure.savefig(buffer, format="svg", transparent=True, metadata={"Date": None})
    text = buffer.getvalue()
    size = text[text.index("viewBox=") :].split('"')[1]
    content = text[text.index("<defs>") : text.rindex("</svg>")]
    content = re.sub(r"<style[^>]*>.*?</style>|<!--.*?-->|\n\s*", " ", content, flags=re.DOTALL)
    used = set(re.findall(r"#([\w-]+)", content))
    content = re.sub(r' id="([^"]*)"', lambda m: m[0] if m[1] in used else "", content)
    content = re.sub(r"font-family: [^;\"]*;? ?", "", content)
    content = _TAG.sub(lambda tag: _DECIMAL.sub(_with_one_decimal, tag[0]), content)
    for colour, variable in _PAGE_COLOURS.items():
        content = re.sub(colour, f"var({variable})", content, flags=re.IGNORECASE)
    content = _MARKERS.sub(_with_one_style, content)
    return f'<svg viewBox="{size}" role="img" aria-label="{escape(name)}">{content}</svg>'


def _with_one_decimal(number: re.Match[str]) -> str:
    return f"{float(number[0]):.1f}"


def _with_one_style(markers: re.Match[str]) -> str:
    """Return markers of one style with it said once for all."""
    style_text = markers["style"]
    return f"{markers['group']}{style_text}>{markers['uses'].replace(style_text, '')}"
