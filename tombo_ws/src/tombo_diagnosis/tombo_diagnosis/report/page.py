"""The page of a diagnosis: one HTML file that needs nothing but a browser, and no script."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.report.diagnosis_text import CLASSES, LABELS, certainty
from tombo_flight.report.flight_report import asset, fill

Card = tuple[str, str, str, str]
"""Name, value, unit, and what is said beside it."""


@dataclass(frozen=True)
class Page:
    """What a kind of data puts on its page; titles and texts are plain, sections are HTML."""

    eyebrow: str
    """What was diagnosed."""
    headline: str
    summary: str
    cards: Sequence[Card]
    sections: Sequence[tuple[str, str]]
    """Title and content in their order; those without content are left out."""
    footer: str
    style: str = ""
    """Further CSS."""


def page_html(diagnosis: Diagnosis, page: Page) -> str:
    """Return the page as text; it loads nothing from anywhere."""
    css = asset("report.css") + asset("diagnosis.css", __package__) + page.style
    return fill(
        asset("diagnosis.html", __package__),
        {
            "title": escape(f"{page.eyebrow}: {page.headline}"),
            "css": css,
            "eyebrow": escape(f"Tombo {page.eyebrow.lower()}"),
            "verdict_class": CLASSES.get(diagnosis.verdict, "warn"),
            "verdict": escape(LABELS.get(diagnosis.verdict, diagnosis.verdict)),
            "confidence": escape(certainty(diagnosis.confidence)),
            "headline": escape(page.headline),
            "summary": escape(page.summary),
            "cards": f'<div class="cards">{"".join(_card(*card) for card in page.cards)}</div>',
            "sections": "".join(_panel(*section) for section in page.sections),
            "footer": escape(page.footer),
        },
    )


def _card(name: str, value: str, unit_text: str, beside: str) -> str:
    small = f"<small> {escape(unit_text)}</small>" if unit_text else ""
    return (
        f'<div class="card"><span class="name">{escape(name)}</span>'
        f'<span class="value">{escape(value)}{small}</span>'
        f'<span class="beside">{escape(beside)}&nbsp;</span></div>'
    )


def _panel(title: str, content: str) -> str:
    if not content:
        return ""
    return f'<section class="panel"><h2>{escape(title)}</h2>{content}</section>'
