"""The evidence of a verdict as HTML text: candidates, pre-checks, flights; all escaped here."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

from tombo_bag.flight import Finding
from tombo_diagnosis.diagnosis import Diagnosis, Score
from tombo_diagnosis.wording import DASH, certainty, display_name, figure, percent, sized
from tombo_flight.report.html_page import hint, meter, table

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
