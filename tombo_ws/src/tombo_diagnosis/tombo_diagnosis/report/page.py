"""Pages of diagnoses: that of flights, and the sections that those of all data have."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np

from tombo_bag.flight import Finding
from tombo_diagnosis.control.controller import ControllerReport
from tombo_diagnosis.diagnosis import (
    MODEL,
    VARIABLES,
    Cause,
    Change,
    Diagnosis,
    FlightSummary,
    Residual,
    Score,
    diagnosis_mapping,
)
from tombo_diagnosis.extend_model import extends
from tombo_diagnosis.report import figures, residual_data
from tombo_diagnosis.report.residual_data import corrected, rms
from tombo_diagnosis.report.words import (
    LEFTOVER_UNITS,
    NEXT_STEPS,
    STYLES,
    badge,
    dependence_text,
    headline,
)
from tombo_diagnosis.wording import (
    DASH,
    capital,
    certainty,
    counted,
    display_name,
    figure,
    interval,
    listed,
    percent,
    sized,
    unit,
)
from tombo_flight.command_line import command_line
from tombo_flight.extended_model import Gain
from tombo_flight.report.page import (
    Cell,
    Folded,
    Group,
    Item,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
)

_MOST_NAMES: Final = 3
"""Flights that a line names; of more it says how many."""
_SEVERITIES: Final = {"fault": "bad", "warning": "warn", "info": "plain"}
COLOURS: Final = (
    "Vermillion: the model as it was; blue: the extended model; grey: ±2σ of measurement noise; "
    "purple: fault or doubt in the log."
)


def diagnosis_page(diagnosis: Diagnosis, folder: str = "", vehicle: str = "") -> Page:
    """Return the page of a diagnosis of flights.

    Args:
        diagnosis: its content.
        folder: where mission and model will lie, as the reader would type it.
        vehicle: as it was given, a name or file; empty: the suite's own.
    """
    return report_page(
        diagnosis,
        headline(diagnosis),
        [
            Section("The gap", _gap(diagnosis), "page"),
            Section("What is left over", _leftover(diagnosis)),
            Section("What to fly next", _next_flight(diagnosis, folder, vehicle)),
            *cause_sections(diagnosis),
            Section("", _channels(diagnosis), "page"),
        ],
    )


def report_page(
    diagnosis: Diagnosis,
    title: str,
    sections: Sequence[Section],
    *,
    what: str = "flight",
    data: Mapping[str, Any] | None = None,
) -> Page:
    """Return a page of a diagnosis, of flights or of tables.

    Args:
        diagnosis: its content.
        title: the verdict as one sentence.
        sections: the first ones, that depend on the kind of data.
        what: the data are of: flight or table.
        data: for programs; None: that of the diagnosis.
    """
    candidates = candidate_items(diagnosis.candidates)
    flew = diagnosis.vehicle if what == "flight" else ""
    vehicle = f", vehicle {flew}" if flew else ""
    return Page(
        title=title,
        eyebrow="Tombo diagnosis" if what == "flight" else "Tombo thrust stand",
        verdict=badge(diagnosis),
        verdict_style=STYLES[diagnosis.verdict],
        headline=title,
        summary=diagnosis.summary,
        sections=[
            *sections,
            Section("What can’t be certified", sentences(diagnosis.notes)),
            Section("The controller", controller_items(diagnosis.controller)),
            Section("", [Folded("All candidates", candidates)], "page"),
            Section(f"The {'log' if what == 'flight' else what}s",
                    check_items(diagnosis.prechecks, what)),
            Section(f"{capital(what)}s used", flight_items(diagnosis.flights, what), "page"),
        ],
        data=diagnosis_mapping(diagnosis) if data is None else data,
        footer="Residual: measured minus model. Intervals are 95 %. Held against: "
        f"{diagnosis.model or 'the suite’s own'}{vehicle}. Diagnosed in "
        f"{figure(diagnosis.seconds, 2)} s after loading. The same in diagnosis.json.",
    )  # fmt: skip


def cause_sections(diagnosis: Diagnosis) -> list[Section]:
    """Return the causes with their parameters and how they show, and the gain."""
    causes = diagnosis.causes
    shows = [f"{capital(display_name(c.effect))} shows as: {c.signature}." for c in causes]
    named = [cause_table(causes), *sentences(shows)] if causes else []
    gain: list[Item] = [gain_table(diagnosis.gain)] if diagnosis.gain else []
    if not gain and extends(diagnosis):
        gain = [Text(["Too little was held out: no gain could be measured."], "hint")]
    return [
        Section("What it may be" if diagnosis.verdict == "set" else "What it is", named),
        Section("Cross-validated prediction error: on data held out from selection and fit", gain),
    ]


def sentences(lines: Sequence[str]) -> list[Item]:
    """Return sentences as a list; nothing for none."""
    return [Text(lines, "list")] if lines else []


def _gap(diagnosis: Diagnosis) -> list[Item]:
    """Return one residual against its driver and against time."""
    groups = residual_data.by_channel(diagnosis.residuals)
    if not groups:
        return [Text(["No residual to show: nothing could be compared."], "hint")]
    pair = residual_data.best_pair(groups)
    residuals = groups[pair.channel] if pair else next(iter(groups.values()))
    pictures = [_channel_picture(diagnosis, residuals, "Against time")]
    if pair is not None:
        draw, caption = partial(figures.draw_pair, pair), "Mean in slices with 95 % interval"
        against = f"{display_name(pair.channel)} against {display_name(pair.driver)}"
        pictures.insert(0, Picture(draw, caption, against, "narrow"))
    name, text = capital(display_name(residuals[0].channel)), _rms_text(residuals)
    noise = residual_data.noise_of(residuals)
    if math.isfinite(noise):
        text = f"{text}; noise alone makes {figure(noise)}"
    return [
        Text([COLOURS], "hint"),
        Group(pictures, "figures"),
        Text([f"{name}: {text}, all flights together."]),
    ]


def _channels(diagnosis: Diagnosis) -> list[Item]:
    """Return every channel against time, in the flight that shows it best."""
    groups = residual_data.by_channel(diagnosis.residuals).values()
    pictures = [_channel_picture(diagnosis, group, _rms_text(group)) for group in groups]
    return [Folded("All channels", [Group(pictures, "figures")])] if pictures else []


def _channel_picture(diagnosis: Diagnosis, group: Sequence[Residual], caption: str) -> Picture:
    name = f"{display_name(group[0].channel)} in {residual_data.clearest(group).flight}"
    draw = partial(figures.draw_channel, diagnosis, group)
    return Picture(draw, caption, name, "narrow")


def _rms_text(residuals: Sequence[Residual]) -> str:
    """Return the RMS of a channel over all its flights in words."""
    before = rms(np.concatenate([r.before for r in residuals]))
    after = rms(np.concatenate([r.after for r in residuals]))
    where = unit(residuals[0].unit)
    if not corrected(residuals):
        return f"RMS {figure(before)} {where}"
    share = percent(1.0 - after / before) if before else DASH
    return f"RMS {figure(before)} → {figure(after)} {where} ({share} less)"


def _leftover(diagnosis: Diagnosis) -> list[Item]:
    """Return the leftover of flights that are not fully explained; empty for others."""
    leftover = diagnosis.leftover
    if leftover is None:
        return []
    sizes = listed([f"{quantity} {figure(size)} {LEFTOVER_UNITS[quantity]}"
                    for quantity, size in leftover.rms.items()])  # fmt: skip
    text = f"Left over: {sizes} (root mean square). {dependence_text(leftover)}"
    pictures = [
        Picture(
            partial(figures.draw_dependence, leftover, each), "All flights; mean in slices",
            f"{each.quantity} left over against {VARIABLES[each.variable].text}", "narrow",
        )
        for each in leftover.dependences
    ]  # fmt: skip
    return [Text([text]), *([Group(pictures, "figures")] if pictures else [])]


def _next_flight(diagnosis: Diagnosis, folder: str, vehicle: str) -> list[Item]:
    items: list[Item] = []
    prefix = f"{folder}/" if folder else ""
    experiment = diagnosis.separating_experiment
    if experiment is not None:
        items.append(Text([experiment.text]))
    if extends(diagnosis):
        options = [("--model", prefix + MODEL), ("--vehicle", vehicle)]
        items.append(Text(["The extended model is written; fly it:"]))
        items.append(Text([command_line(("fly",), options)], "command"))
    return [*items, *sentences(NEXT_STEPS.get(diagnosis.verdict, []))]


def cause_table(causes: Iterable[Cause | Change]) -> Table:
    """Return causes or changes, each with its probability and parameters."""
    rows: list[list[str | Cell]] = []
    for cause in causes:
        name = display_name(cause.effect if isinstance(cause, Cause) else cause.label)
        first: list[str | Cell] = [name, certainty(cause.confidence)]
        for theta in cause.theta:
            value, low, high = interval(theta)
            rows.append(
                [
                    *first, Cell(theta.name, code=True), f"{value} {unit(theta.unit)}".strip(),
                    f"{low} to {high}", figure(theta.nominal),
                ]
            )  # fmt: skip
        if not cause.theta:
            rows.append(first)
    head = ("cause", "at work", "parameter", "value", "95 % interval", "in the model")
    return Table(head, rows, "theta")


def gain_table(gains: Sequence[Gain]) -> Table:
    """Return the prediction errors before and after, of each channel and horizon."""
    names = {"one step": "one step: force and torque", "held out": "points held out"}
    rows: list[list[str | Cell]] = [
        [
            display_name(gain.channel), percent(gain.reduction),
            *(f"{figure(e)} {unit(gain.unit)}".strip() for e in (gain.before, gain.after)),
            f"{percent(gain.low)} to {percent(gain.high)}"
            if math.isfinite(gain.low + gain.high) else f"{gain.flights} held out",
            names.get(gain.horizon, f"simulated {gain.horizon} ahead from a measured state"),
        ]
        for gain in gains
    ]  # fmt: skip
    head = ("channel", "reduction", "before", "after", "95 % interval", "predicted")
    return Table(head, rows, "gains")


def candidate_items(scores: Sequence[Score]) -> list[Item]:
    """Return all candidates, the most probable first."""
    head = (
        "candidate, as the only cause", "probability", "removes, held out", "log evidence",
        "would show from", "remark",
    )  # fmt: skip
    text = (
        "Probability: of being the only cause, among all candidates and none; several causes may "
        "be present together. Removes: share of the excess residual in data held out, of "
        "candidates that were fitted."
    )
    return [Text([text], "hint"), Table(head, [_score(score) for score in scores], "scores")]


def _score(score: Score) -> TableRow:
    known = score.probability if math.isfinite(score.probability) else 0.0
    remark = score.remark if score.excited else f"not shown by these data: {score.remark}"
    least = score.detectable
    return TableRow(
        [
            display_name(score.effect),
            Cell(certainty(score.probability), "after", bar=known),
            percent(score.gain) if score.excited else DASH,
            figure(score.evidence) if score.excited else DASH,
            DASH if least is None else f"{least.parameter} {sized(least.size, least.unit)}",
            remark.rstrip(": "),
        ],
        "" if score.excited else "blind",
    )


def controller_items(report: ControllerReport | None) -> list[Item]:
    """Return gains with intervals, oscillations, and the unknown gains."""
    if report is None:
        return []
    items: list[Item] = []
    lines = [report.summary] if report.summary else []
    if report.compared_with and not report.changed:
        lines.append(f"By its gains the controller is the same as {report.compared_with}.")
    if lines:
        items.append(Text(lines, "list"))
    expected = {c.gain.label: f"{c.expected.value:.3g}" for c in report.changed}
    rows = [
        [g.loop, g.axis, g.term, f"{g.value:.3g}", f"{g.low:.3g} to {g.high:.3g}", g.unit,
         expected.get(g.label, "")]
        for g in report.gains
    ]  # fmt: skip
    if rows:
        head = ("loop", "axis", "gain", "value", "95 % interval", "unit", "expected")
        items.append(Table(head, rows))
    if report.unknown:
        items.append(Text([f"Not known: {'; '.join(report.unknown)}."], "list"))
    return items


def check_items(findings: Sequence[Finding], what: str) -> list[Item]:
    """Return the findings of the checks, the worst first; one line for what several have alike.

    `what` the findings are of: flight, log or table. Remarks on flights are folded away.
    """
    if not findings:
        return [Text(["Nothing was found."], "hint")]
    seen: dict[tuple[str, str, str, str], list[str]] = {}
    for f in findings:
        times = f"{f.start_s:.2f}–{f.end_s:.2f} s" if math.isfinite(f.start_s + f.end_s) else ""
        key = (f.severity, times, display_name(f.check), f.message)
        seen.setdefault(key, []).append(f.flight)
    order = list(_SEVERITIES)
    rows: dict[bool, list[list[str | Cell]]] = {False: [], True: []}
    for (severity, *told), flights in sorted(seen.items(), key=lambda x: order.index(x[0][0])):
        badge_cell = Cell(severity, _SEVERITIES[severity], badge=True)
        folded = severity == "info" and what == "flight"
        rows[folded].append([badge_cell, _names(flights), *told])
    head = ("severity", what, "time", "check", "what was seen")
    shown, more = (Table(head, rows[folded], "checks") for folded in (False, True))
    remarks = Folded(counted(len(more.rows), "remark"), [more])
    return [*([shown] if shown.rows else []), *([remarks] if more.rows else [])]


def _names(flights: Sequence[str]) -> Cell:
    more = len(flights) - _MOST_NAMES
    shown = [*flights[:_MOST_NAMES], *([counted(more, "other")] if more > 0 else [])]
    return Cell(", ".join(shown), tooltip=", ".join(flights) if more > 0 else "")


def flight_items(flights: Sequence[FlightSummary], what: str) -> list[Item]:
    """Return the data: the time used, the sensors, and the missing channels."""
    rows = [
        (
            f.name, f"{figure(f.used_s)} of {figure(f.duration_s)} s", f.formulation,
            ", ".join(map(display_name, f.missing)) or "nothing", f.source,
        )
        for f in flights
    ]  # fmt: skip
    head = (what, "used", "measured by", "missing", "file")
    return [Table(head, rows, "flights")] if rows else []
