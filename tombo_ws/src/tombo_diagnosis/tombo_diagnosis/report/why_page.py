"""The page of why a flight went wrong."""

from __future__ import annotations

from tombo_diagnosis.crash.reason import CAUSES, Why, why_mapping
from tombo_diagnosis.report.page import check_items
from tombo_diagnosis.wording import display_name, listed
from tombo_flight.report.page import Page, Section, Table


def why_page(found: Why) -> Page:
    """Return the page of an answer: cause, time, chain of evidence."""
    rows = [
        [f"{s.time:.2f} s", display_name(CAUSES.get(s.kind, s.kind)), s.text]
        for s in found.timeline
    ]
    against = [finding for finding in found.findings if finding.severity != "info"]
    certain = f"{100 * found.confidence:.0f} %"
    return Page(
        title=f"Why: {found.flight.name}",
        eyebrow="Tombo why",
        headline=_headline(found),
        summary=f"Of {found.flight.source or found.flight.name}, from that log alone.",
        sections=[
            Section(
                "What was seen", [Table(["time", "speaks for", "sign"], rows)] if rows else []
            ),
            Section(
                "What the checks have against the log",
                check_items(against, "log") if against else [],
            ),
        ],
        data=why_mapping(found),
        verdict=f"{display_name(found.cause)} · {certain}",
        verdict_style="good" if found.cause == "none" else "bad",
    )


def _headline(found: Why) -> str:
    if found.time_s is None:
        return "Nothing wrong"
    causes = [CAUSES[m] for m in found.members] if found.cause == "set" else [found.cause]
    told = listed(causes, "or")
    if found.cause == "unknown":
        told = "something went wrong; the log does not tell the cause"
    return f"At {found.time_s:.2f} s: {told}"
