"""The result of a flight as a page, for a browser (`report.html`) and a terminal."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_flight.report.html import asset, page_html, write_page
from tombo_flight.report.milestones import (
    FlightMilestones,
    FlightOutcome,
    find_milestones,
    number,
    reaction_words,
)
from tombo_flight.report.page import (
    Card,
    Cell,
    Folded,
    Item,
    Markup,
    Page,
    Picture,
    Section,
    Table,
    Text,
)
from tombo_flight.report.paper_comparison import FigureRow, comparison_rows, fixed, is_paper_flight
from tombo_flight.report.replay_data import flight_block, milestones_block, script_json

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from tombo_bag.flight import Flight

SCRIPTS: Final = (
    *("flight.js", "camera.js", "vehicle.js", "scene.js", "charts.js", "player.js"),
    "some_flights.js",
)
"""Scripts that show flights, in the order in which they are joined."""

_STYLES: Final = {
    FlightOutcome.RECOVERED: "good",
    FlightOutcome.CRASHED: "bad",
    FlightOutcome.NO_CONTACT: "plain",
    FlightOutcome.NOT_SETTLED: "warn",
}
_CARDS: Final = (
    "Largest falling distance",
    "Unstable phase",
    "Recovery time",
    "Detection latency",
    "Largest tilt",
    "Settled error",
)
_CSS: Final = """
header, main, footer { max-width: 1440px; }
.panel:has(> .stage) { padding: 0; border: 0; background: none; }
.picture > svg { max-width: none; min-width: 760px; }
.panel:has(> .picture) { overflow-x: auto; }
"""
_FOOTER: Final = (
    "Positions are east, north, up in metres. Everything shown is ground truth of the simulation "
    "unless it is called an estimate. The paper: “Tombo Propeller: Bio-Inspired Deformable "
    "Structure toward Collision-Accommodated Control for Drones”."
)
_COMPARED: Final = ("Difference", "0 – paper – 2 × paper")


def write_report(
    flight: Flight, path: Path, figure: Figure | None = None, beside: Flight | None = None
) -> None:
    """Write the self-contained report of a flight.

    Args:
        flight: what was flown.
        path: the file to write; its folder exists.
        figure: the still figure (`flight_plot`) where it is drawn already.
        beside: the same flight with another reaction, to compare it with.
    """
    write_page(path, report_page(flight, figure, beside))


def report_html(flight: Flight, beside: Flight | None = None) -> str:
    """Return the report as text; it loads nothing from anywhere."""
    return page_html(report_page(flight, None, beside))


def report_page(flight: Flight, figure: Figure | None, beside: Flight | None) -> Page:
    """Return the page of `report.html`: `flight_page` with the data of the 3-D replay."""
    flights = [flight] if beside is None else [flight, beside]
    return replace(flight_page(flight, beside, figure), scripts=replay_scripts(flights))


def flight_page(
    flight: Flight,
    beside: Flight | None = None,
    figure: Figure | None = None,
    remarks: Sequence[str] = (),
) -> Page:
    """Return the page of a flight, but for the data of the 3-D replay.

    Args:
        flight: what was flown.
        beside: the same flight with another reaction, to compare it with.
        figure: the still figure where it is drawn already.
        remarks: further sentences on a terminal.
    """
    milestones = find_milestones(flight)
    paper = is_paper_flight(flight.scenario)
    flights = [flight] if beside is None else [flight, beside]
    names = ["This flight", *(f"With {flown.summary.get('reaction')}" for flown in flights[1:])]
    columns = [comparison_rows(find_milestones(flown), flown) for flown in flights]
    rows = [row for row in zip(*columns, strict=True) if paper or any(r.has_figure for r in row)]
    cards = _key_figures(rows, names)
    shown = {card.name for card in cards} | {"Outcome"}
    short = [row for row in rows if row[0].name not in shown and _on_terminal(row, milestones)]
    errors = zip(*(_errors(flown.summary) for flown in flights), strict=True)
    short += [row for row in errors if row[0].flight is not None]

    def draw() -> Figure:
        from tombo_flight.report.flight_plot import draw_flight

        return figure or draw_flight(flight, beside)

    plot = Picture(draw, "Position, height, attitude and rotor thrust against time")
    stage = [*_flight_buttons(flight, beside), Markup(asset("stage.html"))]
    figures: list[Item] = [_comparison_table(rows, names, paper, wide=True), _definitions(rows)]
    return Page(
        title=f"{milestones.name}: {milestones.verdict.value}",
        eyebrow="Tombo flight report",
        headline=milestones.name,
        verdict=milestones.verdict.value,
        verdict_style=_STYLES[milestones.verdict],
        summary="  ·  ".join(_facts(flight, milestones)),
        cards=cards,
        sections=[
            Section("", stage, "page"),
            Section("The paper beside this flight" if paper else "The figures", figures, "page"),
            Section("", [_comparison_table(short, names, paper, wide=False)], "terminal"),
            Section("The figure", [plot], "page"),
            Section("", [Folded("Events", [_events_table(flight.events)])], "page"),
            Section("", [Folded("Summary", [values_table(flight.summary)])], "page"),
            Section("", [Folded("Scenario as flown", [values_table(flight.scenario)])], "page"),
            Section("", [Text(remarks)] if remarks else [], "terminal"),
        ],
        data=flight.summary,
        footer=_FOOTER,
        css=_CSS,
    )


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


RowOfFlights = Sequence[FigureRow]
"""One figure, of the flight and of the one beside it."""


def _on_terminal(row: RowOfFlights, milestones: FlightMilestones) -> bool:
    """Return whether a terminal has room for a row; two places side by side are too wide."""
    if milestones.contact_s is None:
        return row[0].flight is not None
    return row[0].flight_text is None or len(row) == 1


def _errors(summary: Mapping[str, Any]) -> list[FigureRow]:
    """Return what a terminal shows besides."""
    named = (
        ("RMS error in hover", "hover_rms_m", "m", 3),
        ("RMS error in the approach", "approach_rms_m", "m", 3),
        ("False alarms", "false_alarms", "", 0),
    )
    return [
        FigureRow(name, unit, None, number(summary, key), digits)
        for name, key, unit, digits in named
    ]


def _comparison_table(
    rows: Iterable[RowOfFlights], names: Sequence[str], paper: bool, *, wide: bool
) -> Table:
    """Return figures beside the paper's and those of another flight.

    Args:
        rows: the figures.
        names: of the flights.
        paper: with the paper's figures.
        wide: with differences, and definitions as tooltips.
    """
    lines = []
    for compared in rows:
        row = compared[0]
        cells = [Cell(row.name, tooltip=row.definition if wide else "")]
        cells += [Cell(_value(row, row.paper, row.paper_text))] if paper else []
        cells += [Cell(_value(row, each.flight, each.flight_text)) for each in compared]
        if paper and wide:
            cells += [Cell(_difference(row)), Cell("", "wide", html=_bullet(row))]
        lines.append(cells)
    head = [
        "Figure",
        *(["Paper"] if paper else []),
        *names,
        *(_COMPARED if paper and wide else ()),
    ]
    return Table(head, lines, "compare")


def _definitions(rows: Iterable[RowOfFlights]) -> Folded:
    lines = [f"{row[0].name}. {row[0].definition}" for row in rows]
    return Folded("What each figure means", [Text(lines, "list", "notes")])


def _key_figures(rows: Sequence[RowOfFlights], names: Sequence[str]) -> list[Card]:
    """Return the key figures of the header; none if the flight has none of them."""
    shown = [row for row in rows if row[0].name in _CARDS]
    if all(row[0].flight is None for row in shown):
        return []
    cards = []
    for row, *others in shown:
        value, unit = "–", ""
        if row.flight is not None:
            value, unit = fixed(row.flight, row.digits), row.unit
        beside = [] if row.paper is None else [f"paper {fixed(row.paper, 1)} {row.unit}"]
        for name, other in zip(names[1:], others, strict=True):
            if other.flight is not None:
                beside.append(f"{name.lower()} {fixed(other.flight, row.digits)} {row.unit}")
        cards.append(Card(row.name, value, unit, " · ".join(beside), tooltip=row.definition))
    return cards


def _events_table(events: Iterable[Mapping[str, Any]]) -> Table:
    """Return the events of the flight in their order; each time is a button that seeks."""
    lines = []
    for event in events:
        time_s = number(event, "time_s")
        seek = "" if time_s is None else f'<button data-seek="{time_s!r}">{time_s:.3f} s</button>'
        kind = str(event.get("kind", "")).replace("_", " ")
        lines.append((Cell("", html=seek), kind, str(event.get("text", ""))))
    return Table((), lines, "plain")


def values_table(values: Mapping[str, Any]) -> Table:
    """Return a nested mapping as a table of two columns with dotted keys."""
    lines: list[tuple[str, str]] = []
    _flatten("", values, lambda key, value: lines.append((key, _text(value))))
    return Table((), lines, "plain")


def _flatten(prefix: str, value: Any, emit: Callable[[str, Any], None]) -> None:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            _flatten(f"{prefix}.{key}" if prefix else str(key), item, emit)
    elif isinstance(value, (list, tuple)) and value and isinstance(value[0], Mapping):
        for i, item in enumerate(value):
            emit(f"{prefix}[{i}]", item)
    else:
        emit(prefix, value)


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.6g}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(_text(item) for item in value) + "]"
    if isinstance(value, Mapping) and value:
        return ", ".join(f"{key} {_text(item)}" for key, item in value.items())
    return str(value)


def _value(row: FigureRow, value: float | None, text: str | None) -> str:
    if text is not None:
        return text
    return "–" if value is None else f"{fixed(value, row.digits)} {row.unit}".rstrip()


def _difference(row: FigureRow) -> str:
    if not row.paper or row.flight is None:
        return ""
    change = round(row.flight - row.paper, row.digits)
    if change == 0.0:
        return "none"
    percent = round(100.0 * (row.flight / row.paper - 1.0))
    share = f" ({_signed(percent, 0)} %)" if percent else ""
    return f"{_signed(change, row.digits)} {row.unit}{share}"


def _bullet(row: FigureRow) -> str:
    """Return a small scale from nothing to twice the paper's figure, with this flight as a dot."""
    if not row.paper or row.flight is None:
        return ""
    x = 100.0 * min(max(row.flight / (2.0 * row.paper), 0.0), 1.0)
    return (
        '<svg class="bullet" viewBox="0 0 120 16" role="img" '
        f'aria-label="{row.flight / row.paper:.2f} of the paper\'s figure">'
        '<line x1="10" y1="8" x2="110" y2="8"/><line class="tick" x1="60" y1="2" x2="60" y2="14"/>'
        f'<circle cx="{10.0 + x:.1f}" cy="8" r="4.5"/></svg>'
    )


def _signed(value: float, digits: int) -> str:
    return f"{'+' if value > 0 else '−'}{abs(value):.{digits}f}"


def _flight_buttons(flight: Flight, beside: Flight | None) -> list[Markup]:
    """Return a button for each flight by the name of its reaction; one flight needs none."""
    if beside is None:
        return []
    buttons = "".join(
        f'<button data-flight="{place}">{escape(str(flown.summary.get("reaction")))}</button>'
        for place, flown in enumerate((flight, beside))
    )
    group = f'<div class="flights" role="group" aria-label="Reaction">Reaction {buttons}</div>'
    return [Markup(group)]


def _facts(flight: Flight, milestones: FlightMilestones) -> list[str]:
    facts = []
    if milestones.seed is not None:
        facts.append(f"seed {milestones.seed}")
    if milestones.conf is not None:
        facts.append(f"Conf. {milestones.conf} propellers")
    if flight.summary.get("law"):
        facts.append(f"law {flight.summary['law']}")
    if flight.summary.get("model"):
        facts.append(f"model {flight.summary['model']}")
    reaction = reaction_words(milestones.reaction)
    if reaction is not None:
        facts.append(reaction)
    if flight.summary.get("disturbances"):
        facts.append("with disturbances")
    if milestones.crash_s is not None:
        facts.append(f"crashed at {milestones.crash_s:.1f} s")
    if flight.summary.get("interrupted") is True:
        facts.append("interrupted")
    facts.append(f"{milestones.duration_s:.1f} s of flight")
    factor = number(flight.summary, "real_time_factor")
    if factor is not None:
        facts.append(f"simulated {factor:.0f} times faster than real time")
    return facts
