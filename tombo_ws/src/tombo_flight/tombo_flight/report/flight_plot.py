"""The still figure of a flight, marked like the paper's figure of the recovery."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import matplotlib as mpl
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
    from tombo_bag.flight import Flight

SIZE_IN: Final = (12.0, 8.0)
DPI: Final = 150

_DATED: Final = {"png": "Software", "pdf": "CreationDate", "svg": "Date"}
"""What a file of a kind says of when or by what it was made."""

_LEFT, _RIGHT = 0.055, 0.945
_PANELS: Final = (
    "horizontal",  # x and y
    "height",
    "attitude",
    "thrust",
)


@dataclass(frozen=True)
class _Place:
    """Where a column of panels is, in parts of the figure; its size in inches."""

    left: float
    right: float
    size_in: tuple[float, float] = SIZE_IN
    top: float = 0.905
    bottom: float = 0.055
    gap: float = 0.042
    strip: float = 0.95
    """Height of the strip of phases; that of a panel is 2. 0: there is none."""
    label_in: float = 0.43
    """From the axis to its label [in]."""

    def stack(self, figure: Figure) -> dict[str, Axes]:
        """Make axes one below the other, by the names of the rows."""
        heights = {"timeline": self.strip} if self.strip else {}
        heights |= dict.fromkeys(_PANELS, 2.0)
        scale = (self.top - self.bottom - self.gap * (len(heights) - 1)) / sum(heights.values())
        stack: dict[str, Axes] = {}
        ceiling = self.top
        for row, height in heights.items():
            floor = ceiling - height * scale
            stack[row] = figure.add_axes(
                (self.left, floor, self.right - self.left, ceiling - floor)
            )
            ceiling = floor - self.gap
        return stack


_WHOLE, _ZOOMED, _WIDE = _Place(_LEFT, 0.445), _Place(0.505, _RIGHT), _Place(_LEFT, _RIGHT)
_IN_PRINT = _Place(
    0.15, 0.985, (88.0 / 25.4, 4.6), top=0.965, bottom=0.075, gap=0.048, strip=0.0, label_in=0.38
)
"""As wide as a column of a journal, 88 mm."""
_VERDICT_COLOURS: Final = {
    Outcome.RECOVERED: style.GREEN,
    Outcome.CRASHED: style.VERMILLION,
    Outcome.NO_CONTACT: style.MUTED,
    Outcome.NOT_SETTLED: "#B07A00",
}


def draw_flight(flight: Flight, beside: Flight | None = None) -> Figure:
    """Draw position, attitude, rotor thrust and phase against time; 1800 x 1200 px.

    The left column shows the whole flight, the right one the seconds around the contact
    (or the crash); with neither there is one wide column. The flight has at least one sample.
    Of `beside`, the same flight with another reaction, the height is drawn.
    """
    milestones = find_milestones(flight)
    angles_deg = roll_pitch_yaw_deg(flight.log["attitude"])
    end_s = max(milestones.duration_s, 1e-3)
    with new_figure(*SIZE_IN, DPI) as figure:
        _title(figure, milestones)
        if milestones.mark_s is None:
            columns = [(Window(0.0, end_s, 0.0, 1500, zoomed=False), _WIDE)]
        else:
            zoom = Window(*zoom_around(milestones.mark_s), milestones.mark_s, 900, zoomed=True)
            columns = [(Window(0.0, end_s, 0.0, 700, zoomed=False), _WHOLE), (zoom, _ZOOMED)]
        for window, place in columns:
            _column(figure, flight, beside, milestones, angles_deg, window, place)
    return figure


def draw_column(flight: Flight, beside: Flight | None = None) -> Figure:
    """Draw the same panels as wide as a column of print (88 mm), for a paper.

    Time is that around the contact or the crash; with neither the whole flight.
    """
    milestones = find_milestones(flight)
    mark_s = milestones.mark_s
    start_s, end_s = 0.0, max(milestones.duration_s, 1e-3)
    if mark_s is not None:
        start_s, end_s = zoom_around(mark_s)
    window = Window(start_s, end_s, mark_s or 0.0, 400, zoomed=False)
    angles_deg = roll_pitch_yaw_deg(flight.log["attitude"])
    with new_figure(*_IN_PRINT.size_in, 2 * DPI, font_size=6.2) as figure:
        _column(figure, flight, beside, milestones, angles_deg, window, _IN_PRINT)
    return figure


def figure_bytes(figure: Figure, kind: str = "png") -> bytes:
    """Return a figure as a file of a kind, png, pdf or svg, the same bytes each time."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "tombo"}):
        figure.savefig(buffer, format=kind, metadata={_DATED[kind]: None})
    return buffer.getvalue()


def _column(
    figure: Figure,
    flight: Flight,
    beside: Flight | None,
    milestones: FlightMilestones,
    angles_deg: Array,
    window: Window,
    place: _Place,
) -> None:
    cut = _samples(flight.t, window)
    rows = {
        row: Panel(axes, flight, milestones, window, cut)
        for row, axes in place.stack(figure).items()
    }
    if "timeline" in rows:
        timeline(rows["timeline"])
    panels.horizontal(rows["horizontal"])
    panels.height(rows["height"], beside)
    panels.attitude(rows["attitude"], angles_deg)
    panels.thrust(rows["thrust"])
    for row, panel in rows.items():
        panel.axes.set_xlim(window.start_s - window.zero_s, window.end_s - window.zero_s)
        panel.axes.tick_params(labelbottom=row == "thrust")
        if row != "timeline":
            panel.shade()
            width_in = place.size_in[0] * (place.right - place.left)
            panel.axes.yaxis.set_label_coords(-place.label_in / width_in, 0.5)
    origin = "contact" if milestones.contact_s is not None else "the crash"
    words = f"time from {origin} [s]" if window.zero_s else "time [s]"
    rows["thrust"].axes.set_xlabel(words, labelpad=2)


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
