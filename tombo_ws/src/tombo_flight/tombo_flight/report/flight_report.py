"""The report of a flight: one HTML file that needs nothing but a browser."""

from __future__ import annotations

import base64
import re
from collections.abc import Mapping
from html import escape
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Final

from tombo_flight.report.comparison import comparison_rows
from tombo_flight.report.payload import flight_block, script_json, story_block
from tombo_flight.report.story import FlightStory, Verdict, number, tell
from tombo_flight.report.tables import cards, comparison_table, events_table, values_table

if TYPE_CHECKING:
    from tombo_flight.flight_record import FlightRecord

SCRIPTS: Final = ("flight.js", "camera.js", "vehicle.js", "scene.js", "charts.js", "player.js")
"""Scripts of the page, in the order in which they are joined."""

_CLASSES: Final = {
    Verdict.RECOVERED: "good",
    Verdict.CRASHED: "bad",
    Verdict.NO_CONTACT: "plain",
    Verdict.NOT_SETTLED: "warn",
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
    story = tell(record)
    rows = comparison_rows(story, record.summary)
    return fill(
        asset("report.html"),
        {
            "title": escape(f"{story.name}: {story.verdict.value}"),
            "css": asset("report.css"),
            "name": escape(story.name),
            "verdict": escape(story.verdict.value),
            "verdict_class": _CLASSES[story.verdict],
            "facts": escape(_facts(record, story)),
            "cards": cards(rows),
            "comparison": comparison_table(rows),
            "plot": base64.b64encode(plot_png).decode("ascii"),
            "events": events_table(record.events),
            "scenario": values_table(record.scenario),
            "summary": values_table(record.summary),
            "story_json": script_json(story_block(record, story)),
            "flight_json": script_json(flight_block(record, story)),
            "script": "\n".join(asset(name) for name in SCRIPTS),
        },
    )


def asset(name: str, package: str = __package__) -> str:
    """Text of a file in the assets of a package of reports; default: of flights."""
    return (resources.files(package) / "assets" / name).read_text(encoding="utf-8")


def fill(template: str, values: Mapping[str, str]) -> str:
    """Put each value in place of its {{name}}; what is put in is not looked at again."""
    return re.sub(r"\{\{(\w+)\}\}", lambda match: values[match[1]], template)


def _facts(record: FlightRecord, story: FlightStory) -> str:
    facts = []
    if story.seed is not None:
        facts.append(f"seed {story.seed}")
    if story.conf is not None:
        facts.append(f"Conf. {story.conf} propellers")
    if record.summary.get("model"):
        facts.append(f"model {record.summary['model']}")
    if story.reaction is False:
        facts.append("without the reaction")
    facts.append(f"{story.duration_s:.1f} s of flight")
    factor = number(record.summary, "real_time_factor")
    if factor is not None:
        facts.append(f"simulated {factor:.0f} times faster than real time")
    return "  ·  ".join(facts)
