"""The page of a stand diagnosis, and its files."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from typing import TYPE_CHECKING, Any, Final

from tombo_diagnosis.diagnosis import Diagnosis, diagnosis_mapping
from tombo_diagnosis.extend_model import extends, model_of
from tombo_diagnosis.report.files import REPORT_FILES, write_report
from tombo_diagnosis.report.page import cause_cards, cause_sections, report_page
from tombo_diagnosis.report.stand_figures import draw_residuals
from tombo_diagnosis.report.words import headline
from tombo_diagnosis.stand.diagnose import of_other_runs
from tombo_diagnosis.wording import counted, percent
from tombo_dynamics.propeller.effects import STAND_EFFECTS
from tombo_flight.json_text import plain
from tombo_flight.model_file import write_model
from tombo_flight.report.page import Card, Item, Page, Picture, Section, Table, Text
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.thrust_constant import ThrustConstant
    from tombo_flight.process.output_folder import OutputFolder

MODEL: Final = "stand_model.yaml"
STAND_FILES: Final = (*REPORT_FILES, MODEL)
"""All names that a stand diagnosis may write."""


def write_stand(folder: OutputFolder, stand: StandDiagnosis, date: str) -> None:
    """Write the files of a stand diagnosis into an output folder, which the caller publishes.

    Raises:
        OSError: the files can't be written.
    """
    lasting = of_other_runs(stand.diagnosis)
    if extends(lasting):
        tool = f"tombo propeller diagnose {tombo_version()}"
        model = model_of(
            lasting, tool=tool, date=date, scenario=lasting.model, base=stand.given,
            registry=STAND_EFFECTS,
        )  # fmt: skip
        write_model(folder / MODEL, model)
    write_report(folder, stand_page(stand))


def stand_mapping(stand: StandDiagnosis) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: that of flights, `runs` for their `flights`."""
    mapping = diagnosis_mapping(stand.diagnosis)
    mapping["runs"] = mapping.pop("flights")
    for of_flights in ("vehicle", "passes"):
        del mapping[of_flights]
    if stand.constant is not None:
        mapping["thrust_constant"] = plain(asdict(stand.constant))
    return mapping


def stand_page(stand: StandDiagnosis) -> Page:
    """Return the page of a stand diagnosis."""
    diagnosis, points = stand.diagnosis, stand.findings.problem.points
    k = stand.constant
    cards = cause_cards(diagnosis.causes)
    if k is not None:
        cards = [
            Card("k_T by rotor", f"{k.k_T:.3g}", "N s²", f"{k.low:.4g} to {k.high:.4g}"),
            Card("thrust grows with speed to the", f"{k.exponent:.2f}", "", "square law: 2"),
        ]
    data = f"{counted(len(points.runs), 'run')}, {counted(len(points.propellers), 'propeller')}"
    caption = "Measured less model over speed, before and after; grey: twice the noise of a point"
    return report_page(
        diagnosis,
        headline(diagnosis, "these runs", "The model"),
        [
            Section("What would settle it", _settling(diagnosis)),
            Section("The gap", [Picture(partial(draw_residuals, stand), caption)], "page"),
            Section("k_T and what limits it", [] if k is None else _constant(k)),
            *cause_sections(diagnosis),
        ],
        eyebrow="Tombo thrust stand",
        cards=[*cards, Card("points", str(stand.findings.problem.used), "", data)],
        what="table",
        data=stand_mapping(stand),
    )


def _settling(diagnosis: Diagnosis) -> list[Item]:
    """Return what to measure next; nothing if no question is open."""
    experiment = diagnosis.separating_experiment
    steps = {
        "unknown": "Look below: over which speeds does the residual grow, in which channel? "
        "Check mount, cable and cell, then measure again with another propeller.",
        "partly_explained": "Look below at what is left: where does it still grow with speed?",
        "named": "Measure once more at speeds these runs do not have, with --model "
        "stand_model.yaml: the verdict should be none."
        if extends(of_other_runs(diagnosis))
        else "Measure the same propeller again, read thermometer and barometer: does it repeat?",
    }
    texts = [experiment.text if experiment else "", steps.get(diagnosis.verdict, "")]
    return [Text([text]) for text in texts if text]


def _constant(k: ThrustConstant) -> list[Item]:
    """Return k_T with its interval and what limits it."""
    text = (
        f"k_T = {k.k_T:.4g} N s² by rotor, 95 % {k.low:.4g} to {k.high:.4g}; with a "
        f"free zero {k.with_offset:.4g} (zero at {k.offset_N:.2g} N)."
    )
    rows = [(limit.cause, percent(limit.share, 2)) for limit in k.limits]
    return [Text([text]), Table(("what limits it", "of k_T"), rows, "limits")]
