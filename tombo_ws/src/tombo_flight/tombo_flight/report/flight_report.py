"""The report of a flight: one HTML file that needs nothing but a browser."""

from __future__ import annotations

from collections.abc import Sequence
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
from tombo_flight.report.paper_comparison import Row, comparison_rows, is_paper_flight
from tombo_flight.report.replay_data import flight_block, milestones_block, script_json
from tombo_flight.report.tables import (
    Column,
    comparison_table,
    events_table,
    key_figures,
    values_table,
)

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

SCRIPTS: Final = (
    *("flight.js", "camera.js", "vehicle.js", "scene.js", "charts.js", "player.js"),
    "some_flights.js",
)
"""Scripts that show flights, in the order in which they are joined."""

_CLASSES: Final = {
    Outcome.RECOVERED: "good",
    Outcome.CRASHED: "bad",
    Outcome.NO_CONTACT: "plain",
    Outcome.NOT_SETTLED: "warn",
}


def write_report(
    flight: Flight, path: Path, plot_png: bytes, beside: Flight | None = None
) -> None:
    """Write the self-contained report of a flight.

    Args:
        flight: what was flown.
        path: the file to write; its folder exists.
        plot_png: the still figure (`flight_plot`), which the page carries.
        beside: the same flight with another reaction, to compare it with.
    """
    path.write_text(report_html(flight, plot_png, beside), encoding="utf-8", newline="\n")


def report_html(flight: Flight, plot_png: bytes, beside: Flight | None = None) -> str:
    """The report as text; it loads nothing from anywhere."""
    milestones = find_milestones(flight)
    rows: Sequence[Row] = comparison_rows(milestones, flight)
    flights, other = [flight], None
    if beside is not None:
        flights.append(beside)
        compared = find_milestones(beside)
        other = Column(str(compared.reaction), comparison_rows(compared, beside))
    paper = is_paper_flight(flight.scenario)
    if not paper:
        rows, other = _with_figures(rows, other)
    body = fill(
        asset("report.html"),
        {
            "flights": _flight_buttons(flights),
            "stage": replay_stage(),
            "name": escape(milestones.name),
            "verdict": escape(milestones.verdict.value),
            "verdict_class": _CLASSES[milestones.verdict],
            "facts": escape(_facts(flight, milestones)),
            "cards": cards(key_figures(rows, other)),
            "figures_title": "The paper beside this flight" if paper else "The figures",
            "comparison": comparison_table(rows, other, paper=paper),
            "plot": data_url(plot_png),
            "events": events_table(flight.events),
            "scenario": values_table(flight.scenario),
            "summary": values_table(flight.summary),
            "scripts": replay_scripts(flights),
        },
    )
    return document(f"{milestones.name}: {milestones.verdict.value}", body, scripts=True)


def replay_stage() -> str:
    """Return the stage on which `replay_scripts` shows flights, as HTML."""
    return asset("stage.html")


def replay_scripts(flights: Sequence[Flight]) -> str:
    """Return data and scripts for the end of a page, which show some flights on its stage.

    The first one is shown; a button with `data-flight="N"` shows the N-th, from 0.
    """
    parts = []
    for place, flight in enumerate(flights):
        milestones = find_milestones(flight)
        blocks = {
            "milestones": milestones_block(flight, milestones),
            "flight": flight_block(flight, milestones),
        }
        parts += [
            f'<script id="{name}-{place}" type="application/json">{script_json(block)}</script>'
            for name, block in blocks.items()
        ]
    script = "\n".join(asset(name) for name in SCRIPTS)
    parts.append(f"<script>\n{script}\n</script>")
    return "\n".join(parts)


def _with_figures(
    rows: Sequence[Row], other: Column | None
) -> tuple[Sequence[Row], Column | None]:
    """Leave out the rows that have no figure of any flight."""
    beside = rows if other is None else other.rows
    kept = [
        (row, compared)
        for row, compared in zip(rows, beside, strict=True)
        if row.has_figure or compared.has_figure
    ]
    if other is not None:
        other = Column(other.name, [compared for _, compared in kept])
    return [row for row, _ in kept], other


def _flight_buttons(flights: Sequence[Flight]) -> str:
    """Return a button for each flight by the name of its reaction, as HTML; one needs none."""
    if len(flights) == 1:
        return ""
    names = [str(find_milestones(flight).reaction) for flight in flights]
    buttons = "".join(
        f'<button data-flight="{place}">{escape(name)}</button>'
        for place, name in enumerate(names)
    )
    return f'  <div class="flights" role="group" aria-label="Reaction">Reaction {buttons}</div>\n'


def _facts(flight: Flight, milestones: FlightMilestones) -> str:
    facts = []
    if milestones.seed is not None:
        facts.append(f"seed {milestones.seed}")
    if milestones.conf is not None:
        facts.append(f"Conf. {milestones.conf} propellers")
    if flight.summary.get("model"):
        facts.append(f"model {flight.summary['model']}")
    reaction = reaction_words(milestones.reaction)
    if reaction is not None:
        facts.append(reaction)
    if milestones.crash_s is not None:
        facts.append(f"crashed at {milestones.crash_s:.1f} s")
    facts.append(f"{milestones.duration_s:.1f} s of flight")
    factor = number(flight.summary, "real_time_factor")
    if factor is not None:
        facts.append(f"simulated {factor:.0f} times faster than real time")
    return "  ·  ".join(facts)
