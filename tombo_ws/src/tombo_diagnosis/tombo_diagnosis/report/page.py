"""The page of a diagnosis: verdict, figures, causes, gains, candidates, and what to fly next."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import (
    MODEL,
    VARIABLES,
    Cause,
    Diagnosis,
    FlightSummary,
    Residual,
    Score,
    diagnosis_mapping,
)
from tombo_diagnosis.extend_model import extends
from tombo_diagnosis.report import figures, residual_data
from tombo_diagnosis.report.controller_items import controller_items
from tombo_diagnosis.report.residual_data import Pair, corrected, rms
from tombo_diagnosis.report.words import (
    LEFTOVER_UNITS,
    STYLES,
    badge,
    best_gains,
    causes_title,
    changes,
    compared_with,
    dependence_text,
    detectable_text,
    headline,
    leading,
    next_steps,
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
from tombo_flight.extended_model import FittedParameter, Gain
from tombo_flight.report.page import (
    Card,
    Cell,
    Folded,
    Group,
    Item,
    Markup,
    Page,
    Picture,
    Section,
    Table,
    TableRow,
    Text,
)

_LARGE_SET: Final = 3
_MOST_RIVALS: Final = 3
_CANDIDATES_SHOWN: Final = 8
"""Candidates in sight; the others are folded away."""
_CHECKS_SHOWN: Final = 12
_MOST_NAMES: Final = 3
"""Flights that a line names; of more it says how many."""
_SEVERITIES: Final = {"fault": "bad", "warning": "warn", "info": "plain"}


def diagnosis_page(diagnosis: Diagnosis, folder: str = "", vehicle: str = "") -> Page:
    """Return the page of a diagnosis.

    Args:
        diagnosis: its content.
        folder: where mission and model will lie, as the reader would type it.
        vehicle: as it was given, a name or file; empty: the suite's own.
    """
    zeros = {f.name: residual_data.zero_s(diagnosis, f.name) for f in diagnosis.flights}
    shown = detectable_text(diagnosis) if diagnosis.verdict == "none" else ""
    model, seconds = diagnosis.model or "the suite’s own", figure(diagnosis.seconds, 2)
    passes = f"Analysed again {', then '.join(diagnosis.passes)}. " if diagnosis.passes else ""
    pairs = residual_data.pairs(diagnosis, 7)
    several = diagnosis.verdict != "set" and len(diagnosis.causes) > 1
    candidates = candidate_items(diagnosis.candidates, several)
    return Page(
        title=f"Diagnosis: {headline(diagnosis)}",
        eyebrow="Tombo diagnosis",
        verdict=badge(diagnosis),
        verdict_style=STYLES[diagnosis.verdict],
        headline=headline(diagnosis),
        summary=" ".join(filter(None, (compared_with(diagnosis), diagnosis.summary, shown))),
        cards=_cards(diagnosis),
        sections=[
            Section("The gap", _gap(diagnosis, pairs[:1]), "page"),
            Section("What is left over", _leftover(diagnosis)),
            Section("What to fly next", _next_flight(diagnosis, folder, vehicle)),
            Section(causes_title(diagnosis.verdict), cause_items(diagnosis)),
            Section(
                "Cross-validated prediction error: on flights held out from selection and fit",
                _gains(diagnosis),
            ),
            Section("What can’t be certified", sentences(diagnosis.notes)),
            Section("The controller", controller_items(diagnosis.controller)),
            Section("", _opened("What drives it", _drivers(diagnosis, pairs[1:])), "page"),
            Section("", _opened("All channels", _channels(diagnosis)), "page"),
            Section("Other candidates", _rivals(diagnosis)),
            Section("", _opened("All candidates", candidates), "page"),
            Section("The logs", check_items(diagnosis.prechecks, "flight", zeros)),
            Section("", _opened("Flights used", flight_items(diagnosis.flights)), "page"),
        ],
        data=diagnosis_mapping(diagnosis),
        footer="Residual: measured minus model, all channels through the same zero-phase "
        f"filter. Intervals are 95 %. Held against: {model}. {passes}Diagnosed in {seconds} s "
        "after loading. The same in diagnosis.json, beside this page.",
    )


def sentences(lines: Sequence[str]) -> list[Item]:
    """Return sentences as a list; nothing for none."""
    return [Text(lines, "list")] if lines else []


def _cards(diagnosis: Diagnosis) -> list[Card]:
    cards = [Card("confidence", certainty(diagnosis.confidence), "", "of the verdict")]
    for cause in leading(diagnosis)[:2]:
        for theta in cause.theta[:2]:
            value, low, high = interval(theta)
            name = f"{display_name(cause.effect)}: {theta.name}"
            cards.append(Card(name, value, unit(theta.unit), f"{low} to {high}"))
    cards = cards[:4]
    for gain in best_gains(diagnosis, 2):
        beside = f"{figure(gain.before)} → {figure(gain.after)} {unit(gain.unit)}"
        name = f"error in {display_name(gain.channel)}, {gain.horizon}"
        cards.append(Card(name, f"−{percent(gain.reduction)}", "", beside))
    used = sum(flight.used_s for flight in diagnosis.flights)
    logs, parts = len({f.source for f in diagnosis.flights}), len(diagnosis.flights)
    # a single flight is cut into parts that are held out in turn
    beside = f"{used:.0f} s used" + (f", in {parts} parts" if logs < parts else "")
    cards.append(Card("flights", str(logs), "", beside))
    return cards


def _opened(title: str, items: Sequence[Item]) -> list[Item]:
    """Return items below a title that opens them; nothing where there are none."""
    return [Folded(title, items)] if items else []


def _gap(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> list[Item]:
    """Return one residual against its driver and against time."""
    groups = residual_data.by_channel(diagnosis.residuals)
    if not groups:
        return [Text(["No residual to show: nothing could be compared."], "hint")]
    residuals = groups[pairs[0].channel if pairs else next(iter(groups))]
    name = display_name(residuals[0].channel)
    against_time = _channel_picture(diagnosis, residuals, "Against time")
    pictures = [*map(_pair_picture, pairs), against_time]
    text, noise = _rms_text(residuals), residual_data.noise_of(residuals)
    if math.isfinite(noise):
        text = f"{text}; noise alone makes {figure(noise)}"
    return [
        _legend(corrected(residuals)),
        Group(pictures, "figures"),
        Text([f"{capital(name)}: {text}, all flights together."], style="told"),
    ]


def _pair_picture(pair: Pair) -> Picture:
    return Picture(
        partial(figures.draw_pair, pair),
        "All flights; mean in slices with 95 % interval",
        f"{display_name(pair.channel)} against {display_name(pair.driver)}",
        "narrow",
    )


def _legend(extended: bool, *, same: bool = False, faults: bool = False) -> Markup:
    """Return the meaning of the colours, once for all pictures of a section."""
    named = [("before", "before: model as it was" if extended else "measured minus model")]
    named += [("after", "after: extended model")] if extended else []
    named += [("same", "the same before and after")] if same else []
    named += [("noise", "±2σ of measurement noise")]
    named += [("apart", "fault or doubt in the log")] if faults else []
    keys = "".join(f'<span><i class="{kind}"></i>{name}</span>' for kind, name in named)
    return Markup(f'<p class="legend">{keys}</p>')


def _drivers(diagnosis: Diagnosis, pairs: Sequence[Pair]) -> list[Item]:
    if not pairs:
        return []
    legend = _legend(corrected(diagnosis.residuals))
    return [legend, Group([_pair_picture(pair) for pair in pairs], "figures")]


def _channels(diagnosis: Diagnosis) -> list[Item]:
    """Return every channel against time, in the flight that shows it best."""
    groups = residual_data.by_channel(diagnosis.residuals)
    if not groups:
        return []
    extended = corrected(diagnosis.residuals)
    same = extended and not all(corrected([r]) for r in diagnosis.residuals)
    faults = any(map(residual_data.spans, diagnosis.prechecks))
    pictures = [_channel_picture(diagnosis, group, _rms_text(group)) for group in groups.values()]
    return [_legend(extended, same=same, faults=faults), Group(pictures, "figures")]


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
    return [*items, *sentences(next_steps(diagnosis))]


def cause_items(diagnosis: Diagnosis) -> list[Item]:
    """Return each cause with its parameters and how it shows; a large set as one table first."""
    causes = leading(diagnosis)
    items: list[Item] = [_cause(cause) for cause in causes]
    if diagnosis.verdict != "set" or len(causes) < _LARGE_SET:
        return items
    table = possibility_table(
        [(display_name(c.effect), c.confidence, c.theta) for c in diagnosis.causes]
    )
    return [table, Folded(f"{len(causes)} members, fitted one by one", items)]


def possibility_table(possible: Iterable[tuple[str, float, Sequence[FittedParameter]]]) -> Table:
    """Return the possible causes, each with name, probability and parameters."""
    rows = []
    for what, probability, parameters in possible:
        sure = certainty(probability)
        for theta in parameters:
            value, low, high = interval(theta)
            size = f"{value} {unit(theta.unit)}".strip()
            rows.append((what, sure, display_name(theta.name), size, f"{low} to {high}"))
        if not parameters:
            rows.append((what, sure, "", "", ""))
    return Table(("it may be", "probability", "parameter", "value", "95 % interval"), rows)


def _cause(cause: Cause) -> Group:
    rows: list[list[str | Cell]] = []
    for theta in cause.theta:
        value, low, high = interval(theta)
        rows.append(
            [
                Cell(theta.name, code=True), f"{value} {unit(theta.unit)}".strip(),
                f"{low} to {high}", figure(theta.nominal),
            ]
        )  # fmt: skip
    head = ("parameter", "value", "95 % interval", "in the model")
    return Group(
        [
            Text([f"{display_name(cause.effect)}, at work: {certainty(cause.confidence)}"],
                 "heading"),
            Text([f"Shows as: {cause.signature}"], style="signature"),
            Table(head, rows, "theta"),
        ],
        "cause",
    )  # fmt: skip


def _gains(diagnosis: Diagnosis) -> list[Item]:
    if diagnosis.gain:
        return gain_items(diagnosis.gain)
    text = "Too little was held out: no gain could be measured."
    return [Text([text], "hint")] if extends(diagnosis) else []


def gain_items(gains: Sequence[Gain]) -> list[Item]:
    """Return the prediction errors before and after, one block for each horizon.

    Channels that do not change are folded away.
    """
    unchanged = [g for g in gains if not changes(g)]
    changed = [g for g in gains if changes(g)]
    items: list[Item] = [_gain_table(changed)] if changed else []
    if unchanged:
        title = f"{counted(len(unchanged), 'channel')} without a change"
        items.append(Folded(title, [_gain_table(unchanged)]))
    return items


def _gain_table(gains: Sequence[Gain]) -> Table:
    names = {"one step": "one step: force and torque", "held out": "points held out"}
    rows: list[TableRow | Sequence[str | Cell]] = []
    for horizon in dict.fromkeys(g.horizon for g in gains):
        group = [g for g in gains if g.horizon == horizon]
        name = names.get(horizon, f"simulated {horizon} ahead from a measured state")
        rows.append(TableRow([name], "group"))
        rows += [_gain_row(gain, group) for gain in group]
    return Table(("channel", "reduction", "before", "after", "95 % interval"), rows, "gains")


def _gain_row(gain: Gain, group: Sequence[Gain]) -> list[str | Cell]:
    known = [g.before for g in group if g.unit == gain.unit and math.isfinite(g.before)]
    largest = max(known, default=0.0)
    return [
        display_name(gain.channel),
        percent(gain.reduction),
        _error_cell(gain.before, largest, gain.unit, "before"),
        _error_cell(gain.after, largest, gain.unit, "after"),
        _reduction_cell(gain),
    ]


def _error_cell(error: float, largest: float, unit_text: str, style: str) -> Cell:
    return Cell(
        f"{figure(error)} {unit(unit_text)}".strip(), style, bar=bar_length(error, largest)
    )


def bar_length(value: float, largest: float) -> float:
    """Return the length of a bar, as a share of the bar of the largest value."""
    return value / largest if largest > 0.0 and math.isfinite(value) else 0.0


def _reduction_cell(gain: Gain) -> Cell:
    """Return the interval of the reduction."""
    if not all(map(math.isfinite, (gain.low, gain.high, gain.reduction))):
        return Cell(f"{gain.flights} held out", "muted")
    sure = gain.low > 0.0 or gain.high < 0.0
    text = f"{percent(gain.low)} to {percent(gain.high)}"
    return Cell(text, ("good" if gain.low > 0.0 else "bad") if sure else "muted")


def _rivals(diagnosis: Diagnosis) -> list[Item]:
    """Return who else was likely, and how many could not be seen."""
    members = {cause.effect for cause in diagnosis.causes}
    rivals = [
        f"{display_name(score.effect)} ({certainty(score.probability)})"
        for score in diagnosis.candidates
        if score.effect not in members and score.excited and score.probability >= 0.005
    ][:_MOST_RIVALS]
    lines = []
    # Of several causes, the probability of being the only one says nothing.
    if rivals and (len(members) < 2 or diagnosis.verdict == "set"):
        lines.append(f"Next likely: {', '.join(rivals)}.")
    blind = sum(not score.excited for score in diagnosis.candidates)
    if blind:
        total = len(diagnosis.candidates)
        lines.append(f"{blind} of {total} candidates can’t be seen in these flights.")
    return [Text(lines)] if lines else []


def candidate_items(scores: Sequence[Score], several: bool = False) -> list[Item]:
    """Return all candidates; the unlikely ones are folded.

    `several`: more than one cause was found: a probability of being the only one says nothing.
    """
    head = (
        "candidate, as the only cause", *(() if several else ("probability",)),
        "removes, held out", "log evidence", "would show from", "remark",
    )  # fmt: skip
    text = (
        "Each candidate is compared as the only cause; several causes may be present together, "
        "and their probabilities, above, are of each being at work."
        if several
        else "Probability: of being the only cause, among all candidates and none. Removes: share "
        "of the excess residual in flights held out, of candidates that were fitted."
    )
    rows = [_score(score, several) for score in scores]
    return [Text([text], "hint"), *_folded(head, rows, _CANDIDATES_SHOWN, "scores", "others")]


def _score(score: Score, several: bool) -> TableRow:
    known = score.probability if math.isfinite(score.probability) else 0.0
    remark = score.remark if score.excited else f"not shown by these data: {score.remark}"
    least = score.detectable
    cells: list[str | Cell] = [
        display_name(score.effect),
        Cell(certainty(score.probability), "after", bar=known),
        percent(score.gain) if score.excited else DASH,
        figure(score.evidence) if score.excited else DASH,
        DASH if least is None else f"{least.parameter} {sized(least.size, least.unit)}",
        remark.rstrip(": "),
    ]
    if several:
        del cells[1]
    return TableRow(cells, "" if score.excited else "blind")


def check_items(
    findings: Sequence[Finding], what: str, zeros: Mapping[str, float] | None = None
) -> list[Item]:
    """Return the findings of the checks of flights or tables, the worst first.

    One line for what several have alike. Flights without faults and doubts are folded behind the
    others.

    Args:
        findings: of all flights.
        what: flight or table.
        zeros: name of a flight → time that is its zero [s]; None: nothing has a time.
    """
    if not findings:
        return [Text(["Nothing was found."], "hint")]
    names: dict[Finding, list[str]] = {}
    for finding in findings:
        zero = 0.0 if zeros is None else zeros.get(finding.flight, 0.0)
        start, end = _time_since(finding.start_s, zero), _time_since(finding.end_s, zero)
        alike = replace(finding, flight="", start_s=start, end_s=end)
        names.setdefault(alike, []).append(finding.flight)
    order = [*_SEVERITIES, *(f.severity for f in findings)]
    worst_first = sorted(names.items(), key=lambda item: order.index(item[0].severity))
    rows = [_check(f, flights, timed=zeros is not None) for f, flights in worst_first]
    head = ("severity", what, *(() if zeros is None else ("time",)), "check", "what was seen")
    serious = sum(f.severity != "info" for f in names) if what == "flight" else 0
    return _folded(head, rows, min(serious or _CHECKS_SHOWN, _CHECKS_SHOWN), "checks", "more")


def _time_since(time_s: float, zero_s: float) -> float:
    return time_s - zero_s if math.isfinite(time_s) else math.nan  # one object: NaN is a key


def _check(finding: Finding, flights: Sequence[str], *, timed: bool) -> list[str | Cell]:
    more = len(flights) - _MOST_NAMES
    shown = [*flights[:_MOST_NAMES], *([counted(more, "other")] if more > 0 else [])]
    return [
        Cell(finding.severity, _SEVERITIES.get(finding.severity, "plain"), badge=True),
        Cell(", ".join(shown), tooltip=", ".join(flights) if more > 0 else ""),
        *([_time_text(finding)] if timed else []),
        display_name(finding.check),
        finding.message,
    ]


def _time_text(finding: Finding) -> str:
    start, end = finding.start_s, finding.end_s
    if not math.isfinite(start):
        return "whole flight"
    if not math.isfinite(end) or end - start < 0.005:
        return f"{start:.2f} s"
    return f"{start:.2f}–{end:.2f} s"


def _folded(
    head: Sequence[str],
    rows: Sequence[TableRow | Sequence[str | Cell]],
    shown: int,
    style: str,
    others: str,
) -> list[Item]:
    """Return a table of which the first rows are in sight, the others folded away."""
    items: list[Item] = [Table(head, rows[:shown], style)]
    if len(rows) > shown:
        rest = Table(head, rows[shown:], style)
        items.append(Folded(f"{len(rows) - shown} {others}", [rest]))
    return items


def flight_items(flights: Sequence[FlightSummary]) -> list[Item]:
    """Return the flights: the time used, the sensors, and the missing channels."""
    rows = [
        (
            f.name, f"{f.used_s:.1f} of {f.duration_s:.1f} s", f.formulation,
            ", ".join(map(display_name, f.missing)) or "nothing", f.source,
        )
        for f in flights
    ]  # fmt: skip
    head = ("flight", "used", "measured by", "missing", "file")
    return [Table(head, rows, "flights")] if rows else []
