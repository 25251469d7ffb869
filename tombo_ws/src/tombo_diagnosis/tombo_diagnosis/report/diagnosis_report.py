"""The report of a diagnosis: one HTML file that needs nothing but a browser, and no script."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import Final

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.report import diagnosis_evidence, diagnosis_sections, diagnosis_svg_plots
from tombo_diagnosis.report.diagnosis_text import (
    CLASSES,
    LABELS,
    certainty,
    extends,
    figure,
    headline,
    next_steps,
)
from tombo_flight.report.flight_report import asset, fill

_WORTH: Final = "What it is worth: prediction error on flights held out from naming and fit"


def write_diagnosis_report(diagnosis: Diagnosis, path: Path, folder: str = "") -> None:
    """Write the self-contained report of a diagnosis.

    Args:
        diagnosis: what was found.
        path: the file to write; its folder exists.
        folder: where mission and model will lie, as the reader would type it.
    """
    text = diagnosis_html(diagnosis, folder)
    path.write_text(text, encoding="utf-8", newline="\n")


def diagnosis_html(diagnosis: Diagnosis, folder: str = "") -> str:
    """Return the report as text; it loads nothing from anywhere."""
    words = headline(diagnosis)
    drivers = diagnosis_svg_plots.drivers(diagnosis)
    causes = diagnosis_sections.causes(diagnosis)
    several = "What it may be" if diagnosis.verdict == "set" else "What it is"
    notes = diagnosis_sections.notes(diagnosis.notes)
    return fill(
        asset("diagnosis.html", __package__),
        {
            "title": escape(f"Diagnosis: {words}"),
            "css": asset("report.css") + asset("diagnosis.css", __package__),
            "verdict_class": CLASSES.get(diagnosis.verdict, "warn"),
            "verdict": escape(LABELS.get(diagnosis.verdict, diagnosis.verdict)),
            "confidence": escape(certainty(diagnosis.confidence)),
            "headline": escape(words),
            "summary": escape(diagnosis.summary),
            "cards": diagnosis_sections.cards(diagnosis),
            "hero": diagnosis_svg_plots.main_plot(diagnosis),
            "next": _panel("What to fly next", _next(diagnosis, folder)),
            "causes": _panel(several, causes),
            "notes": _panel("What can’t be certified", notes),
            "gains": _panel(_WORTH, _gains(diagnosis)),
            "drivers": _panel("What drives it", drivers),
            "overview": _panel("All channels", diagnosis_svg_plots.overview(diagnosis)),
            "candidates": diagnosis_evidence.candidates(diagnosis.candidates),
            "prechecks": diagnosis_evidence.prechecks(diagnosis),
            "flights": diagnosis_evidence.flights(diagnosis),
            "model": escape(diagnosis.model or "the suite’s own"),
            "seconds": figure(diagnosis.seconds, 2),
        },
    )


def _gains(diagnosis: Diagnosis) -> str:
    if diagnosis.gain:
        return diagnosis_sections.gains(diagnosis.gain)
    none = "Too little was held out: no gain could be measured."
    return f'<p class="hint">{none}</p>' if extends(diagnosis) else ""


def _next(diagnosis: Diagnosis, folder: str) -> str:
    parts = [diagnosis_sections.experiment(diagnosis, folder)]
    if extends(diagnosis):
        line = f"tombo fly --model {diagnosis_sections.shown(folder, 'model.yaml')}"
        parts.append("<p>The extended model is written; fly it:</p>")
        parts.append(diagnosis_sections.command(line))
    parts.append(diagnosis_sections.notes(next_steps(diagnosis)))
    return "".join(parts)


def _panel(title: str, content: str) -> str:
    """Return a panel of the page, or nothing if there is nothing in it."""
    if not content:
        return ""
    return f'<section class="panel"><h2>{escape(title)}</h2>{content}</section>'
