"""The still figure of a flight, marked like the paper's figure of the recovery."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_flight.report import panels, style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.milestones import (
    FlightMilestones,
    Outcome,
    find_milestones,
    reaction_words,
    roll_pitch_yaw_deg,
)
from tombo_flight.report.panel import Panel, Window, zoom_around
from tombo_flight.report.timeline import timeline

if TYPE_CHECKING:
    from tombo_flight.flight_record import FlightRecord

SIZE_IN: Final = (12.0, 8.0)
DPI: Final = 150

_LEFT, _MIDDLE_LEFT, _MIDDLE_RIGHT, _RIGHT = 0.055, 0.445, 0.505, 0.945
_TOP, _BOTTOM, _GAP = 0.905, 0.055, 0.042
_HEIGHTS: Final = {
    "timeline": 0.95,
    "horizontal": 2.0,
    "height": 2.0,
    "attitude": 2.0,
    "thrust": 2.0,
}
_VERDICT_COLOURS: Final = {
    Outcome.RECOVERED: style.GREEN,
    Outcome.CRASHED: style.VERMILLION,
    Outcome.NO_CONTACT: style.MUTED,
    Outcome.NOT_SETTLED: "#B07A00",
}


def draw_flight(record: FlightRecord) -> Figure:
    """Draw position, attitude, rotor thrust and phase against time; 1800 x 1200 px.

    The left column shows the whole flight, the right one the seconds around the contact
    (or the crash); with neither there is one wide column. The record has at least one sample.
    """
    milestones = find_milestones(record)
    angles_deg = roll_pitch_yaw_deg(record.log["attitude"])
    end_s = max(milestones.duration_s, 1e-3)
    with new_figure(*SIZE_IN, DPI) as figure:
        _title(figure, milestones)
        if milestones.mark_s is None:
            columns = [(Window(0.0, end_s, 0.0, 1500, zoomed=False), _LEFT, _RIGHT)]
        else:
            zoom = Window(*zoom_around(milestones.mark_s), milestones.mark_s, 900, zoomed=True)
            columns = [
                (Window(0.0, end_s, 0.0, 700, zoomed=False), _LEFT, _MIDDLE_LEFT),
                (zoom, _MIDDLE_RIGHT, _RIGHT),
            ]
        for window, left, right in columns:
            _column(figure, record, milestones, angles_deg, window, left, right)
    return figure


def png_bytes(figure: Figure) -> bytes:
    """The figure as a PNG file, at its own resolution."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _column(
    figure: Figure,
    record: FlightRecord,
    milestones: FlightMilestones,
    angles_deg: Array,
    window: Window,
    left: float,
    right: float,
) -> None:
    cut = _samples(record.t, window)
    rows = {
        row: Panel(axes, record, milestones, window, cut)
        for row, axes in _stack(figure, left, right).items()
    }
    timeline(rows["timeline"])
    panels.horizontal(rows["horizontal"])
    panels.height(rows["height"])
    panels.attitude(rows["attitude"], angles_deg)
    panels.thrust(rows["thrust"])
    for row, panel in rows.items():
        panel.axes.set_xlim(window.start_s - window.zero_s, window.end_s - window.zero_s)
        panel.axes.tick_params(labelbottom=row == "thrust")
        if row != "timeline":
            panel.shade()
            panel.axes.yaxis.set_label_coords(-0.43 / (SIZE_IN[0] * (right - left)), 0.5)
    origin = "contact" if milestones.contact_s is not None else "the crash"
    words = f"time from {origin} [s]" if window.zoomed else "time [s]"
    rows["thrust"].axes.set_xlabel(words, labelpad=2)


def _stack(figure: Figure, left: float, right: float) -> dict[str, Axes]:
    """Axes one below the other, by the names of the rows."""
    scale = (_TOP - _BOTTOM - _GAP * (len(_HEIGHTS) - 1)) / sum(_HEIGHTS.values())
    stack: dict[str, Axes] = {}
    ceiling = _TOP
    for row, height in _HEIGHTS.items():
        floor = ceiling - height * scale
        stack[row] = figure.add_axes((left, floor, right - left, ceiling - floor))
        ceiling = floor - _GAP
    return stack


def _samples(t: Array, window: Window) -> slice:
    """The samples inside the window; at least one."""
    first = int(np.searchsorted(t, window.start_s - 1e-9))
    last = int(np.searchsorted(t, window.end_s + 1e-9))
    first = min(first, len(t) - 1)
    return slice(first, max(last, first + 1))


def _title(figure: Figure, milestones: FlightMilestones) -> None:
    name = milestones.name if len(milestones.name) <= 60 else milestones.name[:59] + "…"
    figure.text(_LEFT, 0.965, name, size=14, weight="bold", va="center", parse_math=False)
    details = [
        None if milestones.seed is None else f"seed {milestones.seed}",
        None if milestones.conf is None else f"Conf. {milestones.conf} propellers",
        reaction_words(milestones.reaction),
        f"{milestones.duration_s:.1f} s",
    ]
    lengths = [
        ("falls", milestones.falling_distance_m, "m"),
        ("unstable", milestones.unstable_phase_s, "s"),
        ("recovered after", milestones.recovery_time_s, "s"),
    ]
    figures = [f"{name} {value:.2f} {unit}" for name, value, unit in lengths if value is not None]
    for x, side, words in ((_LEFT, "left", details), (_RIGHT, "right", figures)):
        line = "  ·  ".join(word for word in words if word)
        figure.text(x, 0.936, line, color=style.MUTED, va="center", ha=side)
    figure.text(
        _RIGHT,
        0.965,
        milestones.verdict.value.upper(),
        color=_VERDICT_COLOURS[milestones.verdict],
        size=12,
        weight="bold",
        va="center",
        ha="right",
    )
