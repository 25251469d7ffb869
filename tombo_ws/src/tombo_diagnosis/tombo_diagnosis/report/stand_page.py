"""A stand diagnosis as one self-contained HTML page: verdict, what would settle it, evidence."""

from __future__ import annotations

import base64
from collections.abc import Mapping
from html import escape
from typing import TYPE_CHECKING, Final

from tombo_diagnosis.report import diagnosis_sections, stand_sections
from tombo_diagnosis.report.diagnosis_text import CLASSES, LABELS, certainty
from tombo_flight.report.flight_report import asset, fill

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.table3 import Table3

CAPTIONS: Final = {
    "table3": "Table III: laws against measurement, each extension on a configuration it has not "
    "seen, and the speeds at which they part",
    "residuals": "Measured less model over speed, before and after",
    "stiffness": "The same over the nodus’ stiffness",
}
"""Figures of the page, in their order."""


def stand_html(
    found: StandDiagnosis, study: Table3 | None, headline: str, pictures: Mapping[str, bytes]
) -> str:
    """Return the page as text; it loads nothing from anywhere.

    Args:
        found: the diagnosis.
        study: of Table III, if that was diagnosed.
        headline: the verdict as a sentence.
        pictures: PNG files by the names in `CAPTIONS`; what is absent is not shown.
    """
    d = found.diagnosis
    shown = {name: pictures[name] for name in CAPTIONS if name in pictures}
    figures = "".join(_figure(name, png) for name, png in shown.items())
    may_be = "What it may be" if d.verdict == "set" else "What it is"
    return fill(
        asset("stand.html", __package__),
        {
            "css": asset("report.css")
            + asset("diagnosis.css", __package__)
            + asset("stand.css", __package__),
            "title": escape(f"Stand: {headline}"),
            "verdict_class": CLASSES[d.verdict],
            "verdict": escape(LABELS[d.verdict]),
            "confidence": escape(certainty(d.confidence)),
            "headline": escape(headline),
            "summary": escape(stand_sections.summary(found, study)),
            "cards": stand_sections.cards(found, study),
            "next": _panel("What would settle it", stand_sections.settle(found, study)),
            "figures": _panel("The gap", f'<div class="pictures">{figures}</div>'),
            "constant": _panel("k_T and what limits it", stand_sections.constant(found)),
            "causes": _panel(may_be, _causes(found)),
            "gains": _panel("On points that neither named nor fitted it", stand_sections.gains(d)),
            "table3": _panel(
                "Each configuration predicted by the others", stand_sections.predictions(study)
            ),
            "candidates": stand_sections.candidates(d.candidates),
            "notes": _panel("What can’t be certified", diagnosis_sections.notes(d.notes)),
            "findings": stand_sections.findings(d.prechecks),
            "runs": stand_sections.runs(d.flights),
            "model": escape(d.model),
        },
    )


def _causes(found: StandDiagnosis) -> str:
    content = diagnosis_sections.causes(found.diagnosis)
    if found.diagnosis.verdict != "set" or len(found.diagnosis.causes) < 3:
        return content
    names = len(found.diagnosis.causes)
    return f"<details><summary>{names} members, fitted one by one</summary>{content}</details>"


def _figure(name: str, png: bytes) -> str:
    data = base64.b64encode(png).decode("ascii")
    caption = escape(CAPTIONS[name])
    return (
        f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
        f"<figcaption>{caption}.</figcaption></figure>"
    )


def _panel(title: str, content: str) -> str:
    """Return a panel of the page, or nothing if there is nothing in it."""
    if not content:
        return ""
    return f'<section class="panel"><h2>{escape(title)}</h2>{content}</section>'
