"""Pages of results: HTML files that need nothing but a browser; their head, cards and tables."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources


@dataclass(frozen=True)
class Card:
    """A figure of the header; plain text."""

    name: str
    value: str
    unit: str = ""
    beside: str = ""
    """Small text below the value."""
    kind: str = ""
    """Further CSS class."""
    tooltip: str = ""


@dataclass(frozen=True)
class Page:
    """A page of results. Sections are HTML, everything else is plain text."""

    title: str
    """Of the browser's tab."""
    eyebrow: str
    """Small line above the headline."""
    headline: str
    summary: str
    cards: Sequence[Card]
    sections: Sequence[tuple[str, str]]
    """Title and content in their order; those without content are left out."""
    footer: str
    verdict: str = ""
    """Badge beside the eyebrow."""
    verdict_class: str = ""
    """Its colour: good, warn or bad."""
    css: str = ""
    """Beside that of all pages."""
    scripts: str = ""
    """Script elements, HTML, at the end."""


def page_html(page: Page) -> str:
    """Return a page of results as text; it loads nothing from anywhere."""
    badge = ""
    if page.verdict:
        badge = f' <span class="verdict {page.verdict_class}">{escape(page.verdict)}</span>'
    body = (
        f'<header>\n  <p class="eyebrow">{escape(page.eyebrow)}{badge}</p>\n'
        f'  <h1 class="large">{escape(page.headline)}</h1>\n'
        f'  <p class="summary">{escape(page.summary)}</p>\n  {cards(page.cards)}\n</header>\n\n'
        f"<main>\n{''.join(_panel(*section) for section in page.sections)}\n</main>\n\n"
        f"<footer>\n  <p>{escape(page.footer)}</p>\n</footer>\n{page.scripts}"
    )
    css = asset("results.css") + page.css
    return document(page.title, body, css, scripts=bool(page.scripts))


def document(title: str, body: str, css: str = "", *, scripts: bool = False) -> str:
    """Return an HTML document that loads nothing from anywhere.

    Args:
        title: plain text.
        body: HTML.
        css: beside that of all pages.
        scripts: the body has scripts.
    """
    return fill(
        asset("page.html"),
        {
            "title": escape(title),
            "css": asset("report.css") + css,
            "scripts": "script-src 'unsafe-inline'; " if scripts else "",
            "body": body,
        },
    )


def asset(name: str, package: str = __package__) -> str:
    """Return the text of a file in the assets of a package."""
    return (resources.files(package) / "assets" / name).read_text(encoding="utf-8")


def fill(template: str, values: Mapping[str, str]) -> str:
    """Put each value in place of its {{name}}; what is put in is not looked at again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: values[match[1]], template)


def cards(shown: Sequence[Card]) -> str:
    """Return figures for the header; nothing for none."""
    parts = []
    for card in shown:
        unit = f"<small> {escape(card.unit)}</small>" if card.unit else ""
        tooltip = f' title="{escape(card.tooltip)}"' if card.tooltip else ""
        parts.append(
            f'<div class="{f"card {card.kind}".strip()}"{tooltip}>'
            f'<span class="name">{escape(card.name)}</span>'
            f'<span class="value">{escape(card.value)}{unit}</span>'
            f'<span class="beside">{escape(card.beside)}&nbsp;</span></div>'
        )
    return f'<div class="cards">{"".join(parts)}</div>' if parts else ""


def table(head: Sequence[str], lines: Sequence[str], style: str = "") -> str:
    """Return a table that scrolls sideways where it has to; head is escaped, lines are HTML."""
    cells = "".join(f'<th scope="col">{escape(text)}</th>' for text in head)
    return (
        f'<div class="scroll"><table class="{style}"><thead><tr>{cells}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def meter(value: float, largest: float, style: str) -> str:
    """Return a bar that is as long as the value is of the largest."""
    share = 100.0 * value / largest if largest > 0.0 and math.isfinite(value) else 0.0
    return f'<i class="meter {style}" style="--share:{min(max(share, 0.0), 100.0):.1f}%"></i>'


def sentences(lines: Iterable[str]) -> str:
    """Return sentences as a list; nothing for none."""
    items = "".join(f"<li>{escape(line)}</li>" for line in lines)
    return f"<ul>{items}</ul>" if items else ""


def hint(text: str) -> str:
    """Return a sentence in small grey type."""
    return f'<p class="hint">{escape(text)}</p>'


def command(line: str) -> str:
    """Return a command line, to be copied."""
    return f'<pre class="command">{escape(line)}</pre>'


def pictures(shown: Iterable[tuple[bytes, str, str]]) -> str:
    """Return PNG pictures below each other; nothing for none.

    Args:
        shown: of each its bytes, its name in bold (may be empty), and its caption.
    """
    figures = []
    for png, name, caption in shown:
        bold = f"<b>{escape(name)}.</b> " if name else ""
        figures.append(
            f'<figure><img alt="{escape(caption)}" src="{data_url(png)}">'
            f"<figcaption>{bold}{escape(caption)}.</figcaption></figure>"
        )
    return f'<div class="pictures">{"".join(figures)}</div>' if figures else ""


def data_url(png: bytes) -> str:
    """Return a PNG as the text of a URL that holds it."""
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"


def _panel(title: str, content: str) -> str:
    if not content:
        return ""
    return f'<section class="panel"><h2>{escape(title)}</h2>{content}</section>'
