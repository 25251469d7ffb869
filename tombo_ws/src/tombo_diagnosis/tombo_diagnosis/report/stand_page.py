"""A stand diagnosis as one self-contained HTML page: verdict, what would settle it, evidence."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Final

from tombo_diagnosis.diagnosis import Diagnosis, FlightSummary
from tombo_diagnosis.report import diagnosis_sections
from tombo_diagnosis.report.diagnosis_text import CLASSES, badge, causes_title
from tombo_diagnosis.stand.model_file import extends_model
from tombo_diagnosis.stand.table3 import TWO_VALUES, Table3, statement
from tombo_diagnosis.wording import DASH, counted, display_name, figure, percent, unit
from tombo_flight.report.html_page import (
    Card,
    Page,
    hint,
    meter,
    page_html,
    pictures,
    sentences,
    table,
)

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
    seen = diagnosis_sections.prechecks(d.prechecks, "table") + runs(d.flights)
    return page_html(
        Page(
            title=f"Thrust stand: {headline}",
            eyebrow="Tombo thrust stand",
            verdict=badge(d),
            verdict_class=CLASSES[d.verdict],
            headline=headline,
            summary=d.summary if study is None else statement(study),
            cards=cards(found, study),
            sections=(
                ("What would settle it", settle(found, study)),
                ("The gap", pictures(shown)),
                ("k_T and what limits it", constant(found)),
                (causes_title(d.verdict), _causes(d)),
                ("On points that neither named nor fitted it", gains),
                ("Each configuration predicted by the others", predictions(study)),
                ("All candidates", diagnosis_sections.candidates(d.candidates)),
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


def cards(found: StandDiagnosis, study: Table3 | None) -> list[Card]:
    """Return the figures that count: k_T or the gains, what the verdict rests on."""
    points, k = found.findings.problem.points, found.constant
    evidence = found.findings.search.best.evidence
    used = str(found.findings.problem.used)
    of = f"{counted(len(points.runs), 'run')}, {counted(len(points.propellers), 'propeller')}"
    if study is not None:
        mean = study.rms["their mean"]
        best = next(p for p in study.predictions if "mean" not in p.what)
        other = next(p.rmse for p in study.predictions if "mean" in p.what)
        first = [
            Card("error of the law", f"{study.rms[study.law]:.3f}", "N", study.law),
            Card("error of the mean", f"{mean:.3f}", "N", "of the soft configurations"),
            Card("best left one out", f"{best.rmse:.4f}", "N", f"mean: {other:.4f} N"),
        ]
    elif k is not None:
        first = [
            Card("k_T by rotor", f"{k.k_T:.3g}", "N s²", f"{k.low:.4g} to {k.high:.4g}"),
            Card("thrust grows with speed to the", f"{k.exponent:.2f}", "", "square law: 2"),
        ]
    else:
        first = [
            Card(
                f"{display_name(g.channel)}, held out", percent(-g.reduction), "",
                f"{figure(g.before)} → {figure(g.after)} {unit(g.unit)}",
            )
            for g in found.diagnosis.gain
        ]  # fmt: skip
    return [
        *first,
        Card("log Bayes factor", figure(evidence, 2), "", "against the model as it is"),
        Card("points", used, "", of),
    ]


def settle(found: StandDiagnosis, study: Table3 | None) -> str:
    """Return what to measure next; nothing if no question is open."""
    parts = []
    experiment = found.diagnosis.separating_experiment
    if experiment is not None and study is None:  # of Table III more is known
        text = (
            f"Expected log Bayes factor {figure(experiment.separation, 2)}; these points: "
            f"{figure(experiment.present, 2)} (5 is strong)."
        )
        parts += [f"<p><b>{escape(experiment.text)}.</b></p>", hint(text)]
    if study is not None:
        lines = [
            f'<tr><th scope="row">{escape(s.what)}</th><td>{_sized(s.sigma, s.unit)}</td>'
            f"<td>{percent(s.sigma / s.expected, 1)}</td><td>{_sized(s.difference, s.unit)}</td>"
            f"<td>{escape(display_name(s.rival))}</td></tr>"
            for s in study.settling[:6]
        ]
        head = ("measure", "noise at most", "of the reading", "they differ by", "closest rival")
        text = (
            "So well that centrifugal stiffening stands out from every other candidate fitted to "
            "the table by a log Bayes factor of 4; easiest first."
        )
        parts += [table(head, lines, "settle"), hint(text)]
    steps = {
        "unknown": "Look below: over which speeds does the residual grow, in which channel? "
        "Check mount, cable and cell, then measure again with another propeller.",
        "partly_explained": "Look below at what is left: where does it still grow with speed?",
        "named": "Measure once more at speeds these runs do not have, with --model "
        "stand_model.yaml: the verdict should be none.",
    }
    step = steps.get(found.diagnosis.verdict, "")
    if found.diagnosis.verdict == "named" and not extends_model(found.diagnosis):
        step = "Measure the same propeller again, read thermometer and barometer: does it repeat?"
    if step:
        parts.append(f"<p>{escape(step)}</p>")
    return "".join(parts)


def _sized(value: float, unit_text: str) -> str:
    if unit_text == "N m":
        value, unit_text = 1e3 * value, "mN m"
    return f"{figure(value, 2)}&nbsp;{escape(unit_text)}"


def constant(found: StandDiagnosis) -> str:
    """Return k_T with its interval and what limits it; nothing for Tombo propellers."""
    if found.constant is None:
        return ""
    k = found.constant
    largest = max((e.share for e in k.limits), default=0.0)
    lines = [
        f'<tr><th scope="row">{escape(e.what)}</th>'
        f"<td>{meter(e.share, largest, 'before')}{percent(e.share, 2)}</td></tr>"
        for e in k.limits
    ]
    return (
        f"<p><b>k_T = {k.k_T:.4g} N s² by rotor</b>, 95 % {k.low:.4g} to {k.high:.4g}; with a "
        f"free zero {k.with_offset:.4g} (zero at {k.offset_N:.2g} N).</p>"
        + table(("what limits it", "of k_T"), lines, "limits")
    )


def predictions(study: Table3 | None) -> str:
    """Return how well each extension predicts a configuration left out."""
    if study is None:
        return ""
    largest = max(p.rmse for p in study.predictions)
    lines = []
    for p in study.predictions:
        span = f"{p.low:+.3f} to {p.high:+.3f}&nbsp;N" if p.low != p.high else DASH
        kind = ' class="best"' if "mean" in p.what else ""
        lines.append(
            f'<tr{kind}><th scope="row">{escape(display_name(p.what))}</th>'
            f"<td>{meter(p.rmse, largest, 'after')}{p.rmse:.4f}&nbsp;N</td>"
            f"<td>{span.replace('-', '−')}</td><td>{escape(p.parameter)}</td></tr>"
        )
    head = ("what", "RMS error", "against the mean, 95 %", "fitted to all")
    return table(head, lines, "scores") + hint(TWO_VALUES)


def runs(notes: Sequence[FlightSummary]) -> str:
    """Return the tables that were read, and what they lack."""
    lines = [
        f'<tr><th scope="row">{escape(n.name)}</th>'
        f"<td>{escape(', '.join(map(display_name, n.missing))) or 'nothing'}</td>"
        f"<td>{escape(n.source)}</td></tr>"
        for n in notes
    ]
    return table(("table", "not measured", "file"), lines, "runs") if lines else ""
