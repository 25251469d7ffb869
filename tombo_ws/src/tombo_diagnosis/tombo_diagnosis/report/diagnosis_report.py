"""The report of a diagnosis: one HTML file that needs nothing but a browser, and no script."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.extend_model import extends
from tombo_diagnosis.report import diagnosis_pictures, diagnosis_sections, leftover_plot
from tombo_diagnosis.report.diagnosis_plot_data import zero_s
from tombo_diagnosis.report.diagnosis_text import (
    CLASSES,
    badge,
    causes_title,
    compared_with,
    detectable_text,
    headline,
    next_steps,
)
from tombo_diagnosis.wording import figure
from tombo_flight.command_line import command_line
from tombo_flight.report.html_page import Page, command, hint, page_html, sentences

_WORTH: Final = "Cross-validated prediction error: on flights held out from selection and fit"


def write_diagnosis_report(
    diagnosis: Diagnosis, path: Path, folder: str = "", vehicle: str = ""
) -> None:
    """Write the self-contained report of a diagnosis, as `diagnosis_html` returns it."""
    path.write_text(diagnosis_html(diagnosis, folder, vehicle), encoding="utf-8", newline="\n")


def diagnosis_html(diagnosis: Diagnosis, folder: str = "", vehicle: str = "") -> str:
    """Return the report as text; it loads nothing from anywhere.

    `folder` is where mission and model will lie, as the reader would type it.
    """
    zeros = {f.name: zero_s(diagnosis, f.name) for f in diagnosis.flights}
    shown = detectable_text(diagnosis) if diagnosis.verdict == "none" else ""
    model, seconds = diagnosis.model or "the suite’s own", figure(diagnosis.seconds, 2)
    return page_html(
        Page(
            title=f"Diagnosis: {headline(diagnosis)}",
            eyebrow="Tombo diagnosis",
            verdict=badge(diagnosis),
            verdict_class=CLASSES[diagnosis.verdict],
            headline=headline(diagnosis),
            summary=" ".join(filter(None, (compared_with(diagnosis), diagnosis.summary, shown))),
            cards=diagnosis_sections.cards(diagnosis),
            sections=(
                ("The gap", diagnosis_pictures.main_plot(diagnosis)),
                ("What is left over", leftover_plot.leftover(diagnosis)),
                ("What to fly next", _next(diagnosis, folder, vehicle)),
                (causes_title(diagnosis.verdict), diagnosis_sections.causes(diagnosis)),
                (_WORTH, _gains(diagnosis)),
                ("What can’t be certified", sentences(diagnosis.notes)),
                ("What drives it", diagnosis_pictures.drivers(diagnosis)),
                ("All channels", diagnosis_pictures.overview(diagnosis)),
                ("All candidates", _candidates(diagnosis)),
                ("The logs", diagnosis_sections.prechecks(diagnosis.prechecks, "flight", zeros)),
                ("Flights used", diagnosis_sections.flights(diagnosis)),
            ),
            footer="Residual: measured minus model, all channels through the same zero-phase "
            f"filter. Intervals are 95 %. Held against: {model}. Diagnosed in {seconds} s after "
            "loading. The same in diagnosis.json, beside this page.",
        )
    )


def _gains(diagnosis: Diagnosis) -> str:
    if diagnosis.gain:
        return diagnosis_sections.gains(diagnosis.gain)
    none = "Too little was held out: no gain could be measured."
    return hint(none) if extends(diagnosis) else ""


def _candidates(diagnosis: Diagnosis) -> str:
    found = 1 if diagnosis.verdict == "set" else len(diagnosis.causes)
    return diagnosis_sections.candidates(diagnosis.candidates, found)


def _next(diagnosis: Diagnosis, folder: str, vehicle: str) -> str:
    parts = [diagnosis_sections.experiment(diagnosis, folder, vehicle)]
    if extends(diagnosis):
        model = diagnosis_sections.path_of(folder, "model.yaml")
        line = command_line(("fly",), [("--model", model), ("--vehicle", vehicle)])
        parts += ["<p>The extended model is written; fly it:</p>", command(line)]
    parts.append(sentences(next_steps(diagnosis)))
    return "".join(parts)
