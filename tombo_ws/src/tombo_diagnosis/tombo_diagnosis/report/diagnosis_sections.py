"""The tables of the diagnosis report, as HTML text; every value is escaped here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import Cause, Diagnosis, Score
from tombo_diagnosis.report.diagnosis_text import best_gains, changes, leading
from tombo_diagnosis.wording import (
    DASH,
    certainty,
    counted,
    display_name,
    figure,
    interval,
    percent,
    sized,
    unit,
)
from tombo_flight.command_line import command_line
from tombo_flight.extended_model import FittedParameter, Gain
from tombo_flight.report.html_page import Card, command, hint, meter, table


def cards(diagnosis: Diagnosis) -> list[Card]:
    """Return the few figures of the header."""
    facts = [Card("confidence", certainty(diagnosis.confidence), "", "of the verdict")]
    for cause in leading(diagnosis)[:2]:
        for theta in cause.theta[:2]:
            value, low, high = interval(theta)
            name = f"{display_name(cause.effect)}: {theta.name}"
            facts.append(Card(name, value, unit(theta.unit), f"{low} to {high}"))
    facts = facts[:4]
    for gain in best_gains(diagnosis, 2):
        beside = f"{figure(gain.before)} → {figure(gain.after)} {unit(gain.unit)}"
        name = f"error in {display_name(gain.channel)}, {gain.horizon}"
        facts.append(Card(name, f"−{percent(gain.reduction)}", "", beside))
    used = sum(flight.used_s for flight in diagnosis.flights)
    facts.append(Card("flights", str(len(diagnosis.flights)), "", f"{used:.0f} s used"))
    return facts


def causes(diagnosis: Diagnosis) -> str:
    """Return each cause with its parameters and how it shows."""
    return "".join(_cause(cause) for cause in leading(diagnosis))


def _cause(cause: Cause) -> str:
    lines = []
    for theta in cause.theta:
        value, low, high = interval(theta)
        lines.append(
            f'<tr><th scope="row"><code>{escape(theta.name)}</code></th>'
            f"<td><b>{value}</b>&nbsp;{escape(unit(theta.unit))}</td>"
            f"<td>{low} to {high}</td><td>{figure(theta.nominal)}</td>"
            f'<td class="wide">{_whisker(theta)}</td></tr>'
        )
    head = ("parameter", "value", "95 % interval", "in the model", "from the model’s value")
    parameters = table(head, lines, "theta")
    return (
        f'<div class="cause"><h3>{escape(display_name(cause.effect))} '
        f"<small>at work: {certainty(cause.confidence)}</small></h3>"
        f'<p class="signature">Shows as: {escape(cause.signature)}</p>{parameters}</div>'
    )


def _whisker(theta: FittedParameter) -> str:
    """Return a small scale from the model's value to beyond the fitted one."""
    ends = (theta.nominal, theta.value, theta.low, theta.high)
    if not all(map(math.isfinite, ends)):
        return ""
    low, high = min(ends), max(ends)
    if high <= low:
        return ""
    at = [10.0 + 100.0 * (end - low) / (high - low) for end in ends]
    return _bullet("bullet", f"{theta.value:.3g}, model {theta.nominal:.3g}", *at)


def _bullet(kind: str, label: str, tick: float, value: float, low: float, high: float) -> str:
    """Return a small scale with a tick, a value and its interval, at places from 10 to 110."""
    return (
        f'<svg class="{kind}" viewBox="0 0 120 16" role="img" aria-label="{label}">'
        f'<line x1="10" y1="8" x2="110" y2="8"/>'
        f'<line class="tick" x1="{tick:.1f}" y1="2" x2="{tick:.1f}" y2="14"/>'
        f'<line class="reach" x1="{low:.1f}" y1="8" x2="{high:.1f}" y2="8"/>'
        f'<circle cx="{value:.1f}" cy="8" r="4"/></svg>'
    )


def experiment(diagnosis: Diagnosis, folder: str, vehicle: str) -> str:
    """Return the separating experiment with its command line."""
    found = diagnosis.separating_experiment
    if found is None:
        return ""
    names = " / ".join(escape(display_name(name)) for name in found.effects)
    parts = [f"<p><b>{names}.</b> {escape(found.text)}</p>"]
    if found.mission:
        mission = path_of(folder, "separating_experiment.yaml")
        parts.append(command(command_line(("fly", mission), [("--vehicle", vehicle)])))
        text = (
            "Flies it in simulation first; with --px4 URL it flies on the vehicle. Then "
            "diagnose the new flight together with these."
        )
        parts.append(hint(text))
    if math.isfinite(found.separation):
        text = (
            f"Expected to tell them apart by a log Bayes factor of {figure(found.separation, 2)}; "
            f"these flights: {figure(found.present, 2)} (5 is strong)."
        )
        parts.append(hint(text))
    return "".join(parts)


def path_of(folder: str, name: str) -> str:
    """Return the path of a file of the report."""
    return f"{folder}/{name}" if folder else name


def gains(gain: Sequence[Gain]) -> str:
    """Return the prediction errors before and after, one block for each horizon.

    Channels that do not change are folded away.
    """
    still = [g for g in gain if not changes(g)]
    text = _gains([g for g in gain if changes(g)])
    if still:
        title = f"{counted(len(still), 'channel')} without a change"
        text += f"<details><summary>{title}</summary>{_gains(still)}</details>"
    return text


def _gains(gain: Sequence[Gain]) -> str:
    lines: list[str] = []
    names = {"one step": "one step: force and torque", "held out": "points held out"}
    for horizon in dict.fromkeys(g.horizon for g in gain):
        group = [g for g in gain if g.horizon == horizon]
        name = names.get(horizon, f"simulated {horizon} ahead from a measured state")
        lines.append(f'<tr class="group"><th colspan="5">{escape(name)}</th></tr>')
        lines += [_gain(g, group) for g in group]
    return table(("channel", "reduction", "before", "after", "95 % interval"), lines, "gains")


def _gain(gain: Gain, group: Sequence[Gain]) -> str:
    largest = max(
        [g.before for g in group if g.unit == gain.unit and math.isfinite(g.before)], default=0.0
    )
    share = percent(gain.reduction)
    where = escape(unit(gain.unit))
    return (
        f'<tr><th scope="row">{escape(display_name(gain.channel))}</th><td><b>{share}</b></td>'
        f"<td>{meter(gain.before, largest, 'before')}{figure(gain.before)}&nbsp;{where}</td>"
        f"<td>{meter(gain.after, largest, 'after')}{figure(gain.after)}&nbsp;{where}</td>"
        f"<td>{_reach(gain)}</td></tr>"
    )


def _reach(gain: Gain) -> str:
    """Return the interval of the reduction on a scale from −20 to 100 %."""
    if not all(map(math.isfinite, (gain.low, gain.high, gain.reduction))):
        return f'<span class="hint">{gain.flights} held out</span>'
    at = (
        10.0 + 100.0 * (min(max(v, -0.2), 1.0) + 0.2) / 1.2
        for v in (0.0, gain.reduction, gain.low, gain.high)
    )
    kind = "sure" if gain.low > 0.0 else "worse" if gain.high < 0.0 else "unsure"
    text = f"{percent(gain.low)} to {percent(gain.high)}"
    return f"{_bullet(f'bullet {kind}', text, *at)}<small>{text}</small>"


_SHOWN: Final = 8
"""Candidates in sight; the others are folded away."""
_CHECKS_SHOWN: Final = 12
_SEVERITIES: Final = {"fault": "bad", "warning": "warn", "info": "plain"}


def candidates(scores: Sequence[Score], causes: int = 1) -> str:
    """Return all candidates; the unlikely ones are folded.

    `causes`: how many were found; of several, a probability of being the only one says nothing.
    """
    several = causes > 1
    rows = [_score(score, several) for score in scores]
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
    return hint(text) + _folded(head, rows, _SHOWN, "scores", "others")


def _score(score: Score, several: bool) -> str:
    known = math.isfinite(score.probability)
    kind = "" if score.excited else ' class="blind"'
    remark = score.remark if score.excited else f"not shown by these data: {score.remark}"
    share = score.probability if known else 0.0
    likely = f"<td>{meter(share, 1.0, 'after')}{certainty(score.probability)}</td>"
    least = score.detectable
    size = DASH if least is None else f"{least.parameter} {sized(least.size, least.unit)}"
    return (
        f'<tr{kind}><th scope="row">{escape(display_name(score.effect))}</th>'
        f"{'' if several else likely}"
        f"<td>{percent(score.gain) if score.excited else DASH}</td>"
        f"<td>{figure(score.evidence) if score.excited else DASH}</td>"
        f"<td>{escape(size)}</td><td>{escape(remark.rstrip(': '))}</td></tr>"
    )


def prechecks(
    findings: Sequence[Finding], what: str, zeros: Mapping[str, float] | None = None
) -> str:
    """Return what the pre-checks of a flight or table found, the worst first.

    `zeros`: name of a flight -> time that is its zero [s]; None: nothing has a time.
    """
    if not findings:
        return hint("Nothing was found.")
    order = [*_SEVERITIES, *(f.severity for f in findings)]
    lines = []
    for finding in sorted(findings, key=lambda f: order.index(f.severity)):
        time = ""
        if zeros is not None:
            zero = zeros.get(finding.flight, 0.0)
            time = f"<td>{_when(finding.start_s - zero, finding.end_s - zero)}</td>"
        lines.append(
            f'<tr><td><span class="verdict {_SEVERITIES.get(finding.severity, "plain")}">'
            f"{escape(finding.severity)}</span></td><td>{escape(finding.flight)}</td>{time}"
            f"<td>{escape(display_name(finding.check))}</td><td>{escape(finding.message)}</td></tr>"
        )
    head = ("severity", what, *(() if zeros is None else ("time",)), "check", "what was seen")
    return _folded(head, lines, _CHECKS_SHOWN, "checks", "more")


def _folded(head: Sequence[str], lines: Sequence[str], shown: int, style: str, others: str) -> str:
    """Return a table of which the first lines are in sight, the others folded away."""
    text = table(head, lines[:shown], style)
    if len(lines) > shown:
        rest = table(head, lines[shown:], style)
        text += f"<details><summary>{len(lines) - shown} {others}</summary>{rest}</details>"
    return text


def _when(start_s: float, end_s: float) -> str:
    if not math.isfinite(start_s):
        return "whole flight"
    if not math.isfinite(end_s) or end_s - start_s < 0.005:
        return f"{start_s:.2f}&nbsp;s"
    return f"{start_s:.2f}–{end_s:.2f}&nbsp;s"


def flights(diagnosis: Diagnosis) -> str:
    """Return the flights: how much of each was used, how, and what it lacked."""
    lines = [
        f'<tr><th scope="row">{escape(f.name)}</th>'
        f"<td>{f.used_s:.1f} of {f.duration_s:.1f}&nbsp;s</td><td>{escape(f.formulation)}</td>"
        f"<td>{escape(', '.join(map(display_name, f.missing))) or 'nothing'}</td>"
        f"<td>{escape(f.source)}</td></tr>"
        for f in diagnosis.flights
    ]
    return table(("flight", "used", "measured by", "missing", "file"), lines, "flights")
