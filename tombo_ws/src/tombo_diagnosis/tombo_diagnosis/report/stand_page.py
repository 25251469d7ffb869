"""The page of a stand diagnosis: verdict, what would settle it, evidence."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_diagnosis.diagnosis import Diagnosis, diagnosis_mapping
from tombo_diagnosis.report import words
from tombo_diagnosis.report.files import REPORT_FILES, write_report
from tombo_diagnosis.report.page import (
    bar_length,
    candidate_items,
    cause_items,
    check_items,
    gain_items,
    sentences,
)
from tombo_diagnosis.report.stand_figures import draw_residuals, draw_stiffness, has_stiffness
from tombo_diagnosis.stand.model_file import (
    differences_from_model,
    extends_model,
    stand_model_text,
)
from tombo_diagnosis.wording import capital, counted, display_name, figure, listed, percent, unit
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import CHANNELS
from tombo_flight.json_text import plain
from tombo_flight.report.page import Card, Cell, Item, Page, Picture, Section, Table, Text
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_flight.process.output_folder import OutputFolder

MODEL: Final = "stand_model.yaml"
STAND_FILES: Final = (*REPORT_FILES, MODEL)
"""All names that a stand diagnosis may write."""
_MOST_NAMED: Final = 4
"""Members of a set that a headline names."""
_SLICES: Final = 8
"""Of speed, in the table of residuals."""


def write_stand(folder: OutputFolder, stand: StandDiagnosis, date: str) -> None:
    """Write the files of a stand diagnosis into an output folder, which the caller publishes.

    Raises:
        OSError: the files can't be written.
    """
    if extends_model(stand.diagnosis):
        tool = f"tombo propeller diagnose {tombo_version()}"
        model = stand_model_text(stand.diagnosis, tool, date, stand.given)
        (folder / MODEL).write_text(model, encoding="utf-8", newline="\n")
    write_report(folder, stand_page(stand))


def headline(diagnosis: Diagnosis) -> str:
    """Return the verdict as one sentence."""
    causes = [display_name(c.effect) for c in diagnosis.causes]
    differences = differences_from_model(diagnosis.causes)
    if differences and diagnosis.verdict == "named":
        new = [display_name(c.effect) for c in diagnosis.causes if not differences_from_model([c])]
        parts = [*differences, *([f"it is {listed(new, 'and')}"] if new else [])]
        return capital("; ".join(parts))
    if diagnosis.verdict == "set" and len(diagnosis.set) > _MOST_NAMED:
        count = len(diagnosis.set)
        return f"One of {count} causes, {causes[0]} likeliest: these runs can’t tell"
    return words.headline(diagnosis, "these runs", "The model")


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
    diagnosis = stand.diagnosis
    title = headline(diagnosis)
    pictures = []
    if np.ptp(stand.findings.problem.points.setup.speed) > 0.0:
        caption = "Measured less model over speed, before and after"
        pictures.append(Picture(partial(draw_residuals, stand, title), caption))
    if has_stiffness(stand):
        caption = "The same over the nodus’ stiffness"
        pictures.append(Picture(partial(draw_stiffness, stand), caption, style="narrow"))
    checks = check_items(diagnosis.prechecks, "table")
    return Page(
        title=f"Thrust stand: {title}",
        eyebrow="Tombo thrust stand",
        verdict=words.badge(diagnosis),
        verdict_style=words.STYLES[diagnosis.verdict],
        headline=title,
        summary=diagnosis.summary,
        cards=_cards(stand),
        sections=[
            Section("What would settle it", _settling(diagnosis)),
            Section("The gap", [*pictures, _residual_table(stand)]),
            Section("k_T and what limits it", _constant(stand)),
            Section(words.causes_title(diagnosis.verdict), cause_items(diagnosis)),
            Section("On points that neither named nor fitted it", gain_items(diagnosis.gain)),
            Section("All candidates", candidate_items(diagnosis.candidates), "page"),
            Section("What can’t be certified", sentences(diagnosis.notes)),
            Section("What was found in the tables", [*checks, *_tables_read(diagnosis)]),
        ],
        data=stand_mapping(stand),
        footer=f"Residual: measured less model. Intervals are 95 %. Held against: "
        f"{diagnosis.model}. The same in diagnosis.json, beside this page.",
    )


def _cards(stand: StandDiagnosis) -> list[Card]:
    """Return the figures that count: k_T or the gains, and the evidence of the verdict."""
    points, k = stand.findings.problem.points, stand.constant
    if k is not None:
        cards = [
            Card("k_T by rotor", f"{k.k_T:.3g}", "N s²", f"{k.low:.4g} to {k.high:.4g}"),
            Card("thrust grows with speed to the", f"{k.exponent:.2f}", "", "square law: 2"),
        ]
    else:
        cards = [
            Card(
                f"{display_name(g.channel)}, held out", percent(-g.reduction), "",
                f"{figure(g.before)} → {figure(g.after)} {unit(g.unit)}",
            )
            for g in stand.diagnosis.gain
        ]  # fmt: skip
    evidence = figure(stand.findings.search.best.evidence, 2)
    data = f"{counted(len(points.runs), 'run')}, {counted(len(points.propellers), 'propeller')}"
    return [
        *cards,
        Card("log Bayes factor", evidence, "", "against the model as it is"),
        Card("points", str(stand.findings.problem.used), "", data),
    ]


def _settling(diagnosis: Diagnosis) -> list[Item]:
    """Return what to measure next; nothing if no question is open."""
    experiment = diagnosis.separating_experiment
    steps = {
        "unknown": "Look below: over which speeds does the residual grow, in which channel? "
        "Check mount, cable and cell, then measure again with another propeller.",
        "partly_explained": "Look below at what is left: where does it still grow with speed?",
        "named": "Measure once more at speeds these runs do not have, with --model "
        "stand_model.yaml: the verdict should be none."
        if extends_model(diagnosis)
        else "Measure the same propeller again, read thermometer and barometer: does it repeat?",
    }
    texts = [experiment.text if experiment else "", steps.get(diagnosis.verdict, "")]
    return [Text([text]) for text in texts if text]


def _residual_table(stand: StandDiagnosis) -> Table:
    """Return the mean residual of the first channel in slices of speed, before and after."""
    problem = stand.findings.problem
    points, c = problem.points, problem.points.measured[0]
    speed = points.setup.speed
    before = problem.residual(problem.final(problem.null_hypothesis))[:, c]
    after = problem.unexplained(stand.findings.search.best.fit)[:, c]
    rows = []
    edges = np.linspace(0.0, float(speed.max()) * (1.0 + 1e-9), _SLICES + 1)
    for low, high in pairwise(edges):
        inside = problem.seen[:, c] & (speed >= low) & (speed < high)
        if inside.any():
            noise = float(np.median(points.sigma[inside, c]))
            rows.append(
                (
                    f"{low / RPM:.0f}–{high / RPM:.0f}", str(int(inside.sum())),
                    f"{before[inside].mean():+.2g}", f"{after[inside].mean():+.2g}",
                    f"{noise:.1g}",
                )
            )  # fmt: skip
    name = f"{display_name(CHANNELS[c])}, measured less model [{('N', 'N m', 'rad', 'rad/s')[c]}]"
    return Table(("rpm", "points", "model", "extended", "noise"), rows, title=name)


def _constant(stand: StandDiagnosis) -> list[Item]:
    """Return k_T with its interval and what limits it; nothing for Tombo propellers."""
    k = stand.constant
    if k is None:
        return []
    largest = max((e.share for e in k.limits), default=0.0)
    rows = [
        (e.cause, Cell(percent(e.share, 2), "before", bar=bar_length(e.share, largest)))
        for e in k.limits
    ]
    text = (
        f"k_T = {k.k_T:.4g} N s² by rotor, 95 % {k.low:.4g} to {k.high:.4g}; with a "
        f"free zero {k.with_offset:.4g} (zero at {k.offset_N:.2g} N)."
    )
    return [Text([text]), Table(("what limits it", "of k_T"), rows, "limits")]


def _tables_read(diagnosis: Diagnosis) -> list[Item]:
    """Return the tables that were read, and their missing channels."""
    rows = [
        (f.name, ", ".join(map(display_name, f.missing)) or "nothing", f.source)
        for f in diagnosis.flights
    ]
    return [Table(("table", "not measured", "file"), rows, "runs")] if rows else []
