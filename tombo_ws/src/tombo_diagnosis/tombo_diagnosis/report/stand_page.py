"""A stand diagnosis as one self-contained HTML page: verdict, what would settle it, evidence."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.report import diagnosis_evidence, diagnosis_sections, stand_sections
from tombo_diagnosis.report.diagnosis_text import CLASSES, badge, causes_title
from tombo_diagnosis.stand.table3 import Table3, statement
from tombo_flight.report.html_page import Page, page_html, pictures, sentences

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis

CAPTIONS: Final = {
    "table3": "Table III: laws against measurement, each extension on a configuration it has not "
    "seen, and the speeds at which they part",
    "residuals": "Measured less model over speed, before and after",
    "stiffness": "The same over the nodus’ stiffness",
}
"""Figures of the page, in their order."""


def stand_html(
    found: StandDiagnosis, study: Table3 | None, headline: str, png: Mapping[str, bytes]
) -> str:
    """Return the page as text; it loads nothing from anywhere.

    `study` is of Table III, if that was diagnosed; `png`: pictures by the names in `CAPTIONS`.
    """
    d = found.diagnosis
    shown = [(png[name], "", caption) for name, caption in CAPTIONS.items() if name in png]
    gains = diagnosis_sections.gains(d.gain) if d.gain and d.causes else ""
    seen = diagnosis_evidence.prechecks(d.prechecks, "table") + stand_sections.runs(d.flights)
    return page_html(
        Page(
            title=f"Thrust stand: {headline}",
            eyebrow="Tombo thrust stand",
            verdict=badge(d),
            verdict_class=CLASSES[d.verdict],
            headline=headline,
            summary=d.summary if study is None else statement(study),
            cards=stand_sections.cards(found, study),
            sections=(
                ("What would settle it", stand_sections.settle(found, study)),
                ("The gap", pictures(shown)),
                ("k_T and what limits it", stand_sections.constant(found)),
                (causes_title(d.verdict), _causes(d)),
                ("On points that neither named nor fitted it", gains),
                ("Each configuration predicted by the others", stand_sections.predictions(study)),
                ("All candidates", diagnosis_evidence.candidates(d.candidates)),
                ("What can’t be certified", sentences(d.notes)),
                ("What was found in the tables", seen),
            ),
            footer=f"Residual: measured less model. Intervals are 95 %. Held against: {d.model}. "
            "The same in diagnosis.json, beside this page.",
        )
    )


def _causes(diagnosis: Diagnosis) -> str:
    content, names = diagnosis_sections.causes(diagnosis), len(diagnosis.causes)
    if diagnosis.verdict != "set" or names < 3:
        return content
    return f"<details><summary>{names} members, fitted one by one</summary>{content}</details>"
