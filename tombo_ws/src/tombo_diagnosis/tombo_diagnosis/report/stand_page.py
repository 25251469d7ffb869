"""The page and the files of a stand diagnosis: verdict, what would settle it, evidence."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_diagnosis.diagnosis import JSON, REPORT, Diagnosis, diagnosis_mapping
from tombo_diagnosis.report.page import (
    bar_length,
    candidate_items,
    cause_items,
    check_items,
    gain_items,
    sentences,
)
from tombo_diagnosis.report.stand_figures import (
    draw_residuals,
    draw_stiffness,
    draw_table3,
    has_stiffness,
)
from tombo_diagnosis.report.words import STYLES, badge, causes_title
from tombo_diagnosis.stand.model_file import (
    differences_from_model,
    extends_model,
    stand_model_text,
)
from tombo_diagnosis.stand.table3 import MEAN, TWO_VALUES, statement
from tombo_diagnosis.wording import (
    DASH,
    capital,
    counted,
    display_name,
    figure,
    listed,
    percent,
    unit,
)
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import CHANNELS
from tombo_flight.json_text import plain
from tombo_flight.report.flight_plot import figure_bytes
from tombo_flight.report.html import write_page
from tombo_flight.report.page import (
    Card,
    Cell,
    Item,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
    page_json,
)
from tombo_flight.version import tombo_version

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.table3 import Table3
    from tombo_flight.process.output_folder import OutputFolder

MODEL: Final = "stand_model.yaml"
RESIDUALS, STIFFNESS, TABLE3 = "plots/residuals.png", "plots/stiffness.png", "plots/table3.png"
STAND_FILES: Final = (REPORT, JSON, MODEL, RESIDUALS, STIFFNESS, TABLE3)
"""All names that a stand diagnosis may write."""
_CAPTIONS: Final = {
    TABLE3: "Table III: laws against measurement, each extension on a configuration it has not "
    "seen, and the speeds at which they part",
    RESIDUALS: "Measured less model over speed, before and after",
    STIFFNESS: "The same over the nodus’ stiffness",
}
_MOST_NAMED: Final = 4
"""Members of a set that a headline names."""
_SLICES: Final = 8
"""Of speed, in the table of residuals."""
_SETTLING_SHOWN: Final = 8


def write_stand(
    folder: OutputFolder, stand: StandDiagnosis, study: Table3 | None, date: str
) -> None:
    """Write the files of a stand diagnosis into an output folder, which the caller publishes.

    Raises:
        OSError: the files can't be written.
    """
    page = stand_page(stand, study)
    (folder / JSON).write_text(page_json(page), encoding="utf-8", newline="\n")
    if extends_model(stand.diagnosis):
        tool = f"tombo propeller diagnose {tombo_version()}"
        model = stand_model_text(stand.diagnosis, tool, date, stand.given)
        (folder / MODEL).write_text(model, encoding="utf-8", newline="\n")
    (folder / "plots").mkdir()
    for name, draw in _plots(stand, study).items():
        (folder / name).write_bytes(figure_bytes(draw()))
    write_page(folder / REPORT, page)


def _plots(stand: StandDiagnosis, study: Table3 | None) -> dict[str, Callable[[], Figure]]:
    """Return the plots by their names; Table III, at one speed only, has none over speed."""
    plots: dict[str, Callable[[], Figure]] = (
        {RESIDUALS: partial(draw_residuals, stand, headline(stand.diagnosis))}
        if study is None
        else {TABLE3: partial(draw_table3, study)}
    )
    if has_stiffness(stand):
        plots[STIFFNESS] = partial(draw_stiffness, stand)
    return plots


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
    return {
        "none": "The model agrees with these runs",
        "unknown": "Something is wrong that no known effect explains",
        "named": f"It is {listed(causes, 'and')}",
        "set": f"It is {listed(diagnosis.set, 'or')}: these runs can’t tell",
        "partly_explained": f"Part of it is {listed(causes, 'and')}; something else is left",
    }[diagnosis.verdict]


def stand_mapping(stand: StandDiagnosis, study: Table3 | None = None) -> dict[str, Any]:
    """Return the content of `diagnosis.json`: that of flights, `runs` for their `flights`."""
    mapping = diagnosis_mapping(stand.diagnosis)
    mapping["runs"] = mapping.pop("flights")
    mapping.pop("vehicle")
    if stand.constant is not None:
        mapping["thrust_constant"] = plain(asdict(stand.constant))
    if study is not None:
        mapping["table3"] = plain(asdict(study)) | {"statement": statement(study)}
    return mapping


def stand_page(stand: StandDiagnosis, study: Table3 | None = None) -> Page:
    """Return the page of a stand diagnosis; `study`: of Table III, if that was diagnosed."""
    diagnosis = stand.diagnosis
    title = headline(diagnosis)
    plots = _plots(stand, study)
    pictures = [
        Picture(plots[name], caption, style="narrow" if name == STIFFNESS else "picture")
        for name, caption in _CAPTIONS.items()
        if name in plots
    ]
    checks = check_items(diagnosis.prechecks, "table")
    return Page(
        title=f"Thrust stand: {title}",
        eyebrow="Tombo thrust stand",
        verdict=badge(diagnosis),
        verdict_style=STYLES[diagnosis.verdict],
        headline=title,
        summary=diagnosis.summary if study is None else f"{statement(study)} {diagnosis.summary}",
        cards=_cards(stand, study),
        sections=[
            Section("What would settle it", _settling(stand, study)),
            Section(
                "The gap",
                [*pictures, *([_residual_table(stand)] if study is None else _laws(study))],
            ),
            Section("k_T and what limits it", _constant(stand)),
            Section(causes_title(diagnosis.verdict), cause_items(diagnosis)),
            Section(
                "On points that neither named nor fitted it",
                gain_items(diagnosis.gain) if diagnosis.gain else [],
            ),
            Section(
                "Each configuration predicted by the others",
                [] if study is None else [_predictions(study)],
            ),
            Section("All candidates", candidate_items(diagnosis.candidates), "page"),
            Section("What can’t be certified", sentences(diagnosis.notes)),
            Section("What was found in the tables", [*checks, *_tables_read(diagnosis)]),
        ],
        data=stand_mapping(stand, study),
        footer=f"Residual: measured less model. Intervals are 95 %. Held against: "
        f"{diagnosis.model}. The same in diagnosis.json, beside this page.",
    )


def _cards(stand: StandDiagnosis, study: Table3 | None) -> list[Card]:
    """Return the figures that count: k_T or the gains, what the verdict rests on."""
    points, k = stand.findings.problem.points, stand.constant
    if study is not None:
        best = next(p for p in study.predictions if p.what != MEAN)
        mean = next(p for p in study.predictions if p.what == MEAN)
        law, of_mean = study.rms[study.law], study.rms["their mean"]
        cards = [
            Card("error of the law", f"{law:.3f}", "N", study.law),
            Card("error of the mean", f"{of_mean:.3f}", "N", "of the soft configurations"),
            Card("best left one out", f"{best.rmse:.4f}", "N", f"mean: {mean.rmse:.4f} N"),
        ]
    elif k is not None:
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


def _settling(stand: StandDiagnosis, study: Table3 | None) -> list[Item]:
    """Return what to measure next; nothing if no question is open."""
    items: list[Item] = []
    verdict, experiment = stand.diagnosis.verdict, stand.diagnosis.separating_experiment
    if experiment is not None:
        text = (
            f"Expected log Bayes factor {figure(experiment.separation, 2)}; these points: "
            f"{figure(experiment.present, 2)} (5 is strong)."
        )
        items += [Text([f"{capital(experiment.text)}."]), Text([text], "hint")]
    if study is not None:
        rows = [
            (
                s.what, _sized(s.sigma, s.unit), percent(s.sigma / s.expected, 1),
                _sized(s.difference, s.unit), display_name(s.rival),
            )
            for s in study.settling[:_SETTLING_SHOWN]
        ]  # fmt: skip
        head = ("measure", "noise at most", "of the reading", "they differ by", "closest rival")
        text = (
            "So well that centrifugal stiffening stands out from every other candidate fitted to "
            "the table by a log Bayes factor of 4; easiest first."
        )
        items.append(Table(head, rows, "settle", note=text))
    steps = {
        "unknown": "Look below: over which speeds does the residual grow, in which channel? "
        "Check mount, cable and cell, then measure again with another propeller.",
        "partly_explained": "Look below at what is left: where does it still grow with speed?",
        "named": "Measure once more at speeds these runs do not have, with --model "
        "stand_model.yaml: the verdict should be none."
        if extends_model(stand.diagnosis)
        else "Measure the same propeller again, read thermometer and barometer: does it repeat?",
    }
    return [*items, *([Text([steps[verdict]])] if verdict in steps else [])]


def _sized(value: float, unit_text: str) -> str:
    if unit_text == "N m":
        value, unit_text = 1e3 * value, "mN m"
    return f"{figure(value, 2)} {unit_text}"


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


def _laws(study: Table3) -> list[Item]:
    rows = [
        (
            str(conf), f"{study.measured[k]:.3f} ± {study.deviations[k]:.2f}",
            *(f"{thrust[k]:.3f}" for thrust in study.laws.values()),
        )
        for k, conf in enumerate(study.confs)
    ]  # fmt: skip
    soft = len(study.confs) - 1
    lines = [
        f"{name}: RMS error {study.rms[name]:.3f} N over the soft ones, chi² "
        f"{study.chi2[name]:.1f} of {soft}"
        for name in study.rms
    ]
    rank = (
        f"Rank correlation of measured thrust with stiffness: {study.spearman:.2f} "
        f"(p = {study.spearman_p:.2f})"
    )
    head = ("conf", "measured", *study.laws)
    return [
        Table(head, rows, title="Table III at 2000 rpm: thrust [N]"),
        Text([*lines, rank], "list"),
    ]


def _constant(stand: StandDiagnosis) -> list[Item]:
    """Return k_T with its interval and what limits it; nothing for Tombo propellers."""
    k = stand.constant
    if k is None:
        return []
    largest = max((e.share for e in k.limits), default=0.0)
    rows = [
        (e.what, Cell(percent(e.share, 2), "before", bar=bar_length(e.share, largest)))
        for e in k.limits
    ]
    text = (
        f"k_T = {k.k_T:.4g} N s² by rotor, 95 % {k.low:.4g} to {k.high:.4g}; with a "
        f"free zero {k.with_offset:.4g} (zero at {k.offset_N:.2g} N)."
    )
    return [Text([text]), Table(("what limits it", "of k_T"), rows, "limits")]


def _predictions(study: Table3) -> Table:
    """Return how well each extension predicts a configuration left out."""
    largest = max(p.rmse for p in study.predictions)
    rows = []
    for p in study.predictions:
        span = f"{p.low:+.3f} to {p.high:+.3f} N" if p.low != p.high else DASH
        error = Cell(f"{p.rmse:.4f} N", "after", bar=bar_length(p.rmse, largest))
        cells = (display_name(p.what), error, span.replace("-", "−"), p.parameter)
        rows.append(TableRow(cells, "best" if p.what == MEAN else ""))
    head = ("what", "RMS error", "against the mean, 95 %", "fitted to all")
    return Table(head, rows, "scores", note=TWO_VALUES)


def _tables_read(diagnosis: Diagnosis) -> list[Item]:
    """Return the tables that were read, and what they lack."""
    rows = [
        (f.name, ", ".join(map(display_name, f.missing)) or "nothing", f.source)
        for f in diagnosis.flights
    ]
    return [Table(("table", "not measured", "file"), rows, "runs")] if rows else []
