"""The tables of the report, as HTML text; every value is escaped here."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from tombo_bringup.report import paper
from tombo_bringup.report.story import FlightStory, Verdict, number


@dataclass(frozen=True)
class Row:
    """One figure: what the paper prints and what this flight did; None where there is none."""

    name: str
    unit: str
    paper: float | None
    flight: float | None
    definition: str
    digits: int = 2
    paper_text: str | None = None
    flight_text: str | None = None


def comparison_rows(story: FlightStory, summary: Mapping[str, Any]) -> list[Row]:
    """The paper's figures of the collision experiment beside this flight's."""
    unstable_s = number(summary, "unstable_phase_s")
    latency_s = number(summary, "detection_latency_s")
    tilt_rad = number(summary, "max_tilt_rad")
    bounce_m = None
    if story.x_c_m is not None and story.x_r_m is not None:
        bounce_m = math.dist(story.x_c_m, story.x_r_m)
    return [
        Row(
            "Outcome", "", None, None,
            "Paper: with the reaction the vehicle recovers; without it, it falls and crashes to the "
            "ground. Crashed: the frame touches the ground before landing is commanded, or the tilt "
            "passes 2.1 rad and does not come back. No contact is no success.",
            paper_text="recovers", flight_text=story.verdict.value,
        ),
        Row(
            "Time of the collision", "s", paper.COLLISION_TIME_S, story.contact_s,
            "First contact, on the clock that starts with the flight. The paper's value is read from "
            "its figure, so it is approximate, and depends on how long the vehicle hovers first.",
        ),
        Row(
            "Unstable phase", "s", paper.UNSTABLE_PHASE_S, unstable_s,
            "From contact until the tilt stays below 0.17 rad and the body rate below 1 rad/s "
            "for 0.3 s.",
        ),
        Row(
            "Recovery phase", "s", paper.RECOVERY_PHASE_S, story.recovery_phase_s,
            "From the end of the unstable phase until the vehicle has settled at x_r.",
        ),
        Row(
            "Recovery time", "s", paper.MEAN_RECOVERY_TIME_S, _length(story),
            "Both phases together: from contact until the position stays within 0.1 m of x_r and "
            "the speed below 0.1 m/s for 1 s. The paper's value is a mean over its trials.",
        ),
        Row(
            "Largest falling distance", "m", paper.MEAN_MAX_FALLING_DISTANCE_M,
            number(summary, "max_falling_distance_m"),
            "Height at contact minus the lowest height until settled. The paper's value is a mean "
            "over its trials.",
        ),
        Row(
            "Falling rate", "m/s", paper.OBSERVED_FALLING_RATE_M_S, story.falling_rate_m_s,
            "Mean rate of descent from contact to the lowest point. The paper prints the rate it "
            "observed without saying over which stretch.",
        ),
        Row(
            "Distance from x_c to x_r", "m", paper.BOUNCE_DISTANCE_M, bounce_m,
            "The paper asks for d_r = 0.8 m, but the points it prints are "
            f"{paper.PRINTED_BOUNCE_M:.3f} m apart: x_r was chosen by hand there. Here "
            "x_r = x_c + d_r n_r with a unit n_r.", digits=3,
        ),
        Row(
            "x_c, point of collision", "", None, None,
            "Position of the vehicle's centre at contact, as the detector estimates it. East, north, "
            "up; the paper prints it in north-east-down as [0, 1.7, −2.0].",
            paper_text=_point(paper.COLLISION_POINT_M), flight_text=_point(story.x_c_m),
        ),
        Row(
            "x_r, equilibrium point", "", None, None,
            "Where the vehicle is sent after the collision. East, north, up; the paper prints it in "
            "north-east-down as [0.2, 0.9, −2.0].",
            paper_text=_point(paper.EQUILIBRIUM_POINT_M), flight_text=_point(story.x_r_m),
        ),
        Row(
            "Detection latency", "ms", None, None if latency_s is None else 1e3 * latency_s,
            "From the true contact to the detection. Negative when the vehicle enters a known region "
            "before it touches. Not printed in the paper.", digits=0,
        ),
        Row(
            "Largest tilt", "°", None, None if tilt_rad is None else math.degrees(tilt_rad),
            "Largest angle between the vehicle's up axis and the vertical. Not printed in the paper.",
            digits=1,
        ),
        Row(
            "Settled error", "m", None, number(summary, "settled_error_m"),
            "Distance from x_r once settled. Not printed in the paper.", digits=3,
        ),
    ]  # fmt: skip


def comparison_table(rows: Sequence[Row]) -> str:
    """The rows as a table, with their definitions as tooltips and as numbered notes below."""
    lines, notes = [], []
    for i, row in enumerate(rows, start=1):
        lines.append(
            f'<tr><th scope="row"><abbr title="{escape(row.definition)}">{_symbols(row.name)}</abbr>'
            f'<sup><a href="#note-{i}" id="row-{i}">{i}</a></sup></th>'
            f"<td>{_cell(row, row.paper, row.paper_text)}</td>"
            f"<td>{_cell(row, row.flight, row.flight_text)}</td>"
            f"<td>{_difference(row)}</td><td>{_bullet(row)}</td></tr>"
        )
        notes.append(
            f'<li id="note-{i}"><b>{_symbols(row.name)}.</b> {_symbols(row.definition)} '
            f'<a href="#row-{i}" aria-label="back to the table">↑</a></li>'
        )
    return (
        '<div class="scroll"><table class="compare"><thead><tr><th scope="col">Figure</th>'
        '<th scope="col">Paper</th><th scope="col">This flight</th>'
        '<th scope="col">Difference</th><th scope="col" class="wide">'
        "0 – paper – 2 × paper</th></tr></thead>"
        f"<tbody>{''.join(lines)}</tbody></table></div>"
        f'<details class="notes"><summary>What each figure means</summary>'
        f"<ol>{''.join(notes)}</ol></details>"
    )


def cards(story: FlightStory, rows: Sequence[Row]) -> str:
    """The key figures of the header."""
    by_name = {row.name: row for row in rows}
    wanted = ["Largest falling distance", "Unstable phase", "Recovery time", "Detection latency"]
    wanted += ["Largest tilt", "Settled error"]
    if story.verdict is Verdict.NO_CONTACT:
        return ""
    parts = []
    for name in wanted:
        row = by_name[name]
        value = "–" if row.flight is None else _fixed(row.flight, row.digits)
        beside = "" if row.paper is None else f"paper {_fixed(row.paper, 1)} {row.unit}"
        parts.append(
            f'<div class="card" title="{escape(row.definition)}"><span class="name">{escape(name)}'
            f'</span><span class="value">{value}<small> {escape(row.unit)}</small></span>'
            f'<span class="beside">{escape(beside)}&nbsp;</span></div>'
        )
    return f'<div class="cards">{"".join(parts)}</div>'


def events_table(events: Sequence[Mapping[str, Any]]) -> str:
    """The events of the flight in their order; each time is a button that seeks."""
    lines = []
    for event in events:
        time_s = number(event, "time_s")
        seek = "" if time_s is None else f'<button data-seek="{time_s!r}">{time_s:.3f} s</button>'
        lines.append(
            f"<tr><td>{seek}</td><td>{escape(str(event.get('kind', '')).replace('_', ' '))}</td>"
            f"<td>{escape(str(event.get('text', '')))}</td></tr>"
        )
    return f'<table class="plain"><tbody>{"".join(lines)}</tbody></table>'


def values_table(values: Mapping[str, Any]) -> str:
    """A nested mapping as a two-column table with dotted keys."""
    lines: list[str] = []
    _flatten("", values, lambda key, value: lines.append(_value_row(key, value)))
    return f'<table class="plain"><tbody>{"".join(lines)}</tbody></table>'


def _flatten(prefix: str, value: Any, emit: Callable[[str, Any], None]) -> None:
    if isinstance(value, Mapping) and value:
        for key, item in value.items():
            _flatten(f"{prefix}.{key}" if prefix else str(key), item, emit)
    else:
        emit(prefix, value)


def _value_row(key: str, value: Any) -> str:
    return f"<tr><th scope='row'>{escape(key)}</th><td>{escape(_text(value))}</td></tr>"


def _text(value: Any) -> str:
    if value is None:
        return "–"
    if isinstance(value, (bool, np.bool_)):
        return "yes" if value else "no"
    if isinstance(value, (float, np.floating)):
        return f"{float(value):.6g}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(_text(item) for item in value) + "]"
    return str(value)


def _cell(row: Row, value: float | None, text: str | None) -> str:
    if text is not None:
        return escape(text)
    return "–" if value is None else f"{_fixed(value, row.digits)}&nbsp;{escape(row.unit)}"


def _difference(row: Row) -> str:
    if not row.paper or row.flight is None:
        return ""
    change = round(row.flight - row.paper, row.digits)
    if change == 0.0:
        return "none"
    percent = round(100.0 * (row.flight / row.paper - 1.0))
    share = f" ({_signed(percent, 0)}&nbsp;%)" if percent else ""
    return f"{_signed(change, row.digits)}&nbsp;{escape(row.unit)}{share}"


def _bullet(row: Row) -> str:
    """A small scale from nothing to twice the paper's figure, with this flight as a dot."""
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


def _fixed(value: float, digits: int) -> str:
    return f"{value:.{digits}f}".replace("-", "−")


def _point(value: tuple[float, float, float] | None) -> str:
    return "–" if value is None else "(" + ", ".join(_fixed(v, 2) for v in value) + ") m"


def _length(story: FlightStory) -> float | None:
    if story.contact_s is None or story.recovery_end_s is None:
        return None
    return story.recovery_end_s - story.contact_s


def _symbols(text: str) -> str:
    """Escaped text with the paper's symbols set as symbols."""
    marked = escape(text)
    for letter, index in (("x", "c"), ("x", "r"), ("d", "r"), ("n", "r")):
        marked = marked.replace(f"{letter}_{index}", f"<var>{letter}</var><sub>{index}</sub>")
    return marked
