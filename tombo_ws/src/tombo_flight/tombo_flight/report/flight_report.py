"""The report of a flight: one HTML file that needs nothing but a browser."""

from __future__ import annotations

from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tombo_flight.report.html_page import asset, cards, data_url, document, fill
from tombo_flight.report.milestones import (
    FlightMilestones,
    Outcome,
    find_milestones,
    number,
    reaction_words,
)
from tombo_flight.report.paper_comparison import comparison_rows
from tombo_flight.report.report_data import flight_block, milestones_block, script_json
from tombo_flight.report.tables import comparison_table, events_table, key_figures, values_table

if TYPE_CHECKING:
    from tombo_flight.flight_record import FlightRecord

SCRIPTS: Final = ("flight.js", "camera.js", "vehicle.js", "scene.js", "charts.js", "player.js")
"""Scripts of the page, in the order in which they are joined."""

_CLASSES: Final = {
    Outcome.RECOVERED: "good",
    Outcome.CRASHED: "bad",
    Outcome.NO_CONTACT: "plain",
    Outcome.NOT_SETTLED: "warn",
}


def write_report(record: FlightRecord, path: Path, plot_png: bytes) -> None:
    """Write the self-contained report of a flight.

    Args:
        record: the flight.
        path: the file to write; its folder exists.
        plot_png: the still figure (`flight_plot`), which the page carries.
    """
    path.write_text(report_html(record, plot_png), encoding="utf-8", newline="\n")


def report_html(record: FlightRecord, plot_png: bytes) -> str:
    """The report as text; it loads nothing from anywhere."""
    milestones = find_milestones(record)
    rows = comparison_rows(milestones, record.summary)
    body = fill(
        asset("report.html"),
        {
            "name": escape(milestones.name),
            "verdict": escape(milestones.verdict.value),
            "verdict_class": _CLASSES[milestones.verdict],
            "facts": escape(_facts(record, milestones)),
            "cards": cards(key_figures(rows)),
            "comparison": comparison_table(rows),
            "plot": data_url(plot_png),
            "events": events_table(record.events),
            "scenario": values_table(record.scenario),
            "summary": values_table(record.summary),
            "milestones_json": script_json(milestones_block(record, milestones)),
            "flight_json": script_json(flight_block(record, milestones)),
            "script": "\n".join(asset(name) for name in SCRIPTS),
        },
    )
    return document(f"{milestones.name}: {milestones.verdict.value}", body, scripts=True)


def _facts(record: FlightRecord, milestones: FlightMilestones) -> str:
    facts = []
    if milestones.seed is not None:
        facts.append(f"seed {milestones.seed}")
    if milestones.conf is not None:
        facts.append(f"Conf. {milestones.conf} propellers")
    if record.summary.get("model"):
        facts.append(f"model {record.summary['model']}")
    reaction = reaction_words(milestones.reaction)
    if reaction is not None:
        facts.append(reaction)
    facts.append(f"{milestones.duration_s:.1f} s of flight")
    factor = number(record.summary, "real_time_factor")
    if factor is not None:
        facts.append(f"simulated {factor:.0f} times faster than real time")
    return "  ·  ".join(facts)
