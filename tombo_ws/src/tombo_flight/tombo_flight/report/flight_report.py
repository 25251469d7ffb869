"""The result of a flight as a page, for a browser (`report.html`) and a terminal.

The page of the browser has a 3-D replay: thinned columns, milestones, and the vehicle's shapes.
"""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import PHASE_NAMES
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.json_text import plain
from tombo_flight.report import style
from tombo_flight.report.figures import (
    FIGURES,
    MORE,
    ROTOR_NAMES,
    Figure,
    FlightMilestones,
    FlightOutcome,
    Value,
    figures_of,
    find_milestones,
    fixed,
    is_paper_flight,
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
    asset,
)

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


def report_page(flight: Flight, figure: Drawing | None = None) -> Page:
    """Return the page of `report.html`: `flight_page` with the data of the 3-D replay.

    Args:
        flight: the flight.
        figure: the still figure (`flight_plot`) where it is drawn already.
    """
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
        note = f"paper {fixed(printed, 1)} {figure.unit}" if isinstance(printed, float) else ""
        cards.append(Card(figure.name, value, unit, note))
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


KEPT_HZ: Final = 100.0
MOST_SAMPLES: Final = 6000
"""A long flight is thinned further, so that the file stays small."""

COLUMNS: Final = (
    "position",
    "velocity",
    "attitude",
    "rates",
    "position_setpoint",
    "est_position",
    "rotor_thrust",
    "rotor_speed",
    "fold",
    "damage",
    "mode",
)
"""Columns of the log that are carried as they are, at the kept samples."""
_MILESTONES: Final = (
    *("duration_s", "mark_s", "contact_s", "detection_s", "switch_s", "unstable_end_s"),
    *("recovery_end_s", "crash_s", "verdict", "x_c_m", "x_r_m", "n_r", "fall_m"),
)


def kept_samples(t: Array) -> NDArray[np.intp]:
    """Return the indices of the kept samples of times (N,) [s], the first and the last among them.

    They are at 100 Hz, or as dense as `MOST_SAMPLES` allows.
    """
    count = min(math.ceil(float(t[-1] - t[0]) * KEPT_HZ), MOST_SAMPLES) + 1
    kept: NDArray[np.intp] = np.unique(np.linspace(0, t.size - 1, count).round().astype(np.intp))
    return kept


def flight_block(flight: Flight) -> dict[str, Any]:
    """Thinned columns, ready for JSON.

    `columns` is a list of [name, width]; `base64` is little-endian float32: for each column in
    turn its (samples, width) rows. `contact_N` is the largest contact force since the kept
    sample before, so that a contact of a few milliseconds is not lost.
    """
    index = kept_samples(flight.t)
    blocks: list[tuple[str, Array]] = [("t", flight.t[index].reshape(-1, 1))]
    blocks += [(name, flight.log[name].reshape(len(flight.t), -1)[index]) for name in COLUMNS]
    blocks.append(("contact_N", _largest_since(flight.log["contact_force"], index)))
    raw = b"".join(np.ascontiguousarray(b, dtype="<f4").tobytes() for _, b in blocks)
    return {
        "samples": len(index),
        "columns": [[name, block.shape[1]] for name, block in blocks],
        "base64": base64.b64encode(raw).decode("ascii"),
    }


def milestones_block(flight: Flight, milestones: FlightMilestones) -> dict[str, Any]:
    """Data of the scripts, without the columns, ready for JSON."""
    return {
        **scene_block(flight.scenario),
        **{name: getattr(milestones, name) for name in _MILESTONES},
        "verdict": milestones.verdict.value,
        "obstacle": milestones.obstacle,
        "phases": [[s.start_s, s.end_s, s.phase] for s in milestones.phases],
        "rotor_names": ROTOR_NAMES,
        "events": [{k: event[k] for k in ("time_s", "kind", "text")} for event in flight.events],
    }


def scene_block(scenario: Mapping[str, Any]) -> dict[str, Any]:
    """Data of the scene that are the same in all flights of a scenario, ready for JSON."""
    airframe = drawn_vehicle(scenario)
    return {
        "phase_names": [name.replace("_", " ") for name in PHASE_NAMES],
        "phase_colours": [
            style.PHASE_COLOURS.get(i, style.FAINT) for i in range(len(PHASE_NAMES))
        ],
        "shape": {
            "rotors_m": airframe.rotor_positions(),
            "disc_m": airframe.rotor_radius,
            "nodus_m": airframe.nodus_radius,
            "leg_m": airframe.leg_height,
        },
    }


def drawn_vehicle(scenario: Mapping[str, Any]) -> VehicleParams:
    """Return the vehicle of a scenario as flown; missing values are the default vehicle's."""
    given = scenario.get("vehicle") or {}
    return VehicleParams(
        **{f.name: given[f.name] for f in fields(VehicleParams) if f.name in given}
    )


def script_json(value: Any) -> str:
    """JSON that is safe inside a script element: no '<', '>' or '&', non-finite as null."""
    text = json.dumps(plain(value), separators=(",", ":"), allow_nan=False, ensure_ascii=True)
    for character in "<>&":
        text = text.replace(character, f"\\u{ord(character):04x}")
    return text


def _largest_since(force: Array, index: NDArray[np.intp]) -> Array:
    size = np.linalg.norm(force, axis=1)
    starts = np.concatenate(([0], index[:-1] + 1))
    largest: Array = np.maximum.reduceat(size[: index[-1] + 1], starts)
    return largest.reshape(-1, 1)
