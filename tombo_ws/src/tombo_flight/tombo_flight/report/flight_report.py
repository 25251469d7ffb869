"""The result of a flight as a page, for a browser (`report.html`) and a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from tombo_flight.report.figures import (
    FIGURES,
    MORE,
    Figure,
    Value,
    figures_of,
    fixed,
    is_paper_flight,
)
from tombo_flight.report.html import asset, page_html, write_page
from tombo_flight.report.milestones import (
    FlightMilestones,
    FlightOutcome,
    find_milestones,
    reaction_words,
)
from tombo_flight.report.page import (
    Card,
    Cell,
    Folded,
    Markup,
    Page,
    Picture,
    Section,
    Table,
    Text,
)
from tombo_flight.report.replay_data import flight_block, milestones_block, script_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from tombo_bag.flight import Flight

SCRIPTS: Final = (
    *("flight.js", "camera.js", "vehicle.js", "scene.js", "charts.js", "player.js"),
    "recorded_flight.js",
)
"""Scripts that show a flight, in the order in which they are joined."""

_STYLES: Final = {
    FlightOutcome.RECOVERED: "good",
    FlightOutcome.CRASHED: "bad",
    FlightOutcome.NO_CONTACT: "plain",
    FlightOutcome.NOT_SETTLED: "warn",
}
_CSS: Final = """
header, main, footer { max-width: 1440px; }
.panel:has(> .stage) { padding: 0; border: 0; background: none; }
.picture > img { max-width: none; min-width: 760px; }
.panel:has(> .picture) { overflow-x: auto; }
"""
_Row = tuple[Figure, Value, Value]
"""A figure, its value of the flight, and the paper's."""
_FOOTER: Final = (
    "Positions are east, north, up in metres. Everything shown is ground truth of the simulation "
    "unless it is called an estimate. Figures are defined in docs/figures.md. The paper: “Tombo "
    "Propeller: Bio-Inspired Deformable Structure toward Collision-Accommodated Control for "
    "Drones”."
)


def write_report(flight: Flight, path: Path, figure: Drawing | None = None) -> None:
    """Write the self-contained report of a flight.

    Args:
        flight: the flight.
        path: the file to write; its folder exists.
        figure: the still figure (`flight_plot`) where it is drawn already.
    """
    write_page(path, report_page(flight, figure))


def report_html(flight: Flight) -> str:
    """Return the report as text; it loads nothing from anywhere."""
    return page_html(report_page(flight))


def report_page(flight: Flight, figure: Drawing | None = None) -> Page:
    """Return the page of `report.html`: `flight_page` with the data of the 3-D replay."""
    return replace(flight_page(flight, figure), scripts=replay_scripts(flight))


def flight_page(
    flight: Flight, figure: Drawing | None = None, remarks: Sequence[str] = ()
) -> Page:
    """Return the page of a flight, but for the data of the 3-D replay.

    Args:
        flight: the flight.
        figure: the still figure where it is drawn already.
        remarks: further sentences on a terminal.
    """
    milestones, name = find_milestones(flight), str(flight.summary["scenario"])
    paper = is_paper_flight(flight.scenario)
    rows = [row for row in figures_of(flight) if paper or row[1] is not None]
    cards = _key_figures(rows)
    shown = {card.name for card in cards} | {FIGURES[0].name}
    collided = milestones.contact_s is not None
    short = [r for r in rows if r[0].name not in shown and (collided or r[1] is not None)]
    short += [row for row in figures_of(flight, MORE[:3]) if row[1] is not None]

    def draw() -> Drawing:
        from tombo_flight.report.flight_plot import draw_flight

        return figure or draw_flight(flight)

    plot = Picture(draw, "Position, height, attitude and rotor thrust against time")
    figures = "Further figures, those of the paper beside them" if paper else "Further figures"
    return Page(
        title=f"{name}: {milestones.verdict.value}",
        eyebrow="Tombo flight report",
        headline=name,
        verdict=milestones.verdict.value,
        verdict_style=_STYLES[milestones.verdict],
        summary="  ·  ".join(_facts(flight.summary, milestones)),
        cards=cards,
        sections=[
            Section("", [Markup(asset("stage.html"))], "page"),
            Section(figures, [_comparison_table(short, paper)]),
            Section("The figure", [plot], "page"),
            Section("", [Folded("Events", [_events_table(flight.events)])], "page"),
            Section("", [Text(remarks)] if remarks else [], "terminal"),
        ],
        data=flight.summary,
        footer=_FOOTER,
        css=_CSS,
    )


def replay_scripts(flight: Flight) -> str:
    """Return data and scripts for the end of a page, which show a flight on its stage."""
    milestones = find_milestones(flight)
    blocks = {"milestones": milestones_block(flight, milestones), "flight": flight_block(flight)}
    parts = [
        f'<script id="{name}" type="application/json">{script_json(block)}</script>'
        for name, block in blocks.items()
    ]
    script = "\n".join(asset(name) for name in SCRIPTS)
    parts.append(f"<script>\n{script}\n</script>")
    return "\n".join(parts)


def _comparison_table(rows: Iterable[_Row], paper: bool) -> Table:
    """Return a table of figures, with those of the paper."""
    lines = [
        [
            Cell(figure.name),
            *([Cell(figure.text(printed))] if paper else []),
            Cell(figure.text(flown)),
        ]
        for figure, flown, printed in rows
    ]
    return Table(["Figure", *(["Paper"] if paper else []), "This flight"], lines, "compare")


def _key_figures(rows: Sequence[_Row]) -> list[Card]:
    """Return the key figures of the header; none if the flight has none of them."""
    shown = [row for row in rows if row[0].card]
    if all(flown is None for _, flown, _ in shown):
        return []
    cards = []
    for figure, flown, printed in shown:
        value, _, unit = figure.text(flown).partition(" ")
        beside = f"paper {fixed(printed, 1)} {figure.unit}" if isinstance(printed, float) else ""
        cards.append(Card(figure.name, value, unit, beside))
    return cards


def _events_table(events: Iterable[Mapping[str, Any]]) -> Table:
    """Return the events of the flight in their order; each time is a button that seeks."""
    lines = []
    for event in events:
        time_s = float(event["time_s"])
        seek = f'<button data-seek="{time_s!r}">{time_s:.3f} s</button>'
        lines.append((Cell("", html=seek), event["kind"].replace("_", " "), event["text"]))
    return Table((), lines, "plain")


def _facts(summary: Mapping[str, Any], milestones: FlightMilestones) -> list[str]:
    facts = [
        f"seed {summary['seed']}",
        f"Conf. {summary['conf']} propellers" if summary["conf"] is not None else "",
        f"law {summary['law']}" if summary["law"] else "",
        f"model {summary['model']}" if summary["model"] else "",
        reaction_words(summary["reaction"]) or "",
        "with disturbances" if summary["disturbances"] else "",
        f"crashed at {milestones.crash_s:.1f} s" if milestones.crash_s is not None else "",
        "interrupted" if summary.get("interrupted") else "",
        f"{milestones.duration_s:.1f} s of flight",
    ]
    return [fact for fact in facts if fact]
