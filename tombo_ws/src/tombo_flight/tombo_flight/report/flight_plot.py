"""The still figure of a flight, marked like the paper's figure of the recovery.

Its top row is the strip of phases, with the instants by name; of a flight over MAVLink there is a
second strip, PX4's modes.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_flight.report import panels, style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.figures import BY_KEY
from tombo_flight.report.milestones import (
    FlightMilestones,
    FlightOutcome,
    find_milestones,
    reaction_words,
    roll_pitch_yaw_deg,
)
from tombo_flight.report.panels import SMALL, Panel, TimeWindow, zoom_around

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


_LETTER: Final = 0.0135
"""Width of a letter as a share of the panel, generously."""
_TOP: Final = 3.6
_PX4_LOW, _PX4_MIDDLE = -1.1, -0.6
_BEGIN_S: Final = 0.3
"""Lines at the beginning of a bracket that its name keeps clear of."""
_TOGETHER_S: Final = 0.005
"""Instants this close share one name."""


def timeline(panel: Panel) -> None:
    """Draw the strip; above it, zoomed, what happened when, else where the zoom is."""
    axes, window = panel.axes, panel.window
    px4 = panel.flight.summary.get("px4")
    low = 0.0 if px4 is None else _PX4_LOW
    axes.set_ylim(low, _TOP)
    axes.set_yticks([])
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.tick_params(bottom=False)
    axes.set_ylabel("phase", rotation=0, ha="right", va="center")
    axes.yaxis.set_label_coords(-0.012, (0.5 - low) / (_TOP - low))
    for span in panel.milestones.phases:
        colour = style.PHASE_COLOURS.get(span.phase, style.FAINT)
        _bar(panel, 0.5, 1.0, (span.start_s, span.end_s), span.name, colour)
    if px4 is not None:
        _px4_modes(panel, px4["modes"])
    if window.zoomed:
        _phases(panel)
        _instants(panel)
    elif panel.milestones.mark_s is not None:
        _mark_zoom(panel, panel.milestones.mark_s)


def _bar(
    panel: Panel, y: float, height: float, span: tuple[float, float], name: str, colour: str
) -> None:
    """Draw what the window shows of a span, with its name if there is room for it."""
    window = panel.window
    start, end = max(span[0], window.start_s), min(span[1], window.end_s)
    if end <= start:
        return
    left = start - window.zero_s
    panel.axes.barh(y, end - start, left=left, height=height, color=colour, lw=0)
    if _share(panel, end - start) > _LETTER * len(name):
        middle = (start + end) / 2.0 - window.zero_s
        panel.axes.text(middle, y - 0.02, name, ha="center", va="center", size=SMALL)


def _px4_modes(panel: Panel, modes: list[list[Any]]) -> None:
    """Draw the second strip, from [time, name] of each change."""
    times = [float(time_s) for time_s, _ in modes]
    for start, end, (_, name) in zip(times, [*times[1:], np.inf], modes, strict=False):
        colour = style.PX4_COLOURS.get(name, style.FAINT)
        _bar(panel, _PX4_MIDDLE, 0.8, (start, end), name, colour)
    panel.axes.text(
        -0.012,
        _PX4_MIDDLE,
        "PX4",
        transform=panel.axes.get_yaxis_transform(),
        ha="right",
        va="center",
    )


def _share(panel: Panel, length_s: float) -> float:
    return length_s / (panel.window.end_s - panel.window.start_s)


def _phases(panel: Panel) -> None:
    """Brackets for the unstable and the recovery phase, just above the strip of phases.

    A name too long for its bracket starts with the bracket and leaves the next one less room.
    None stands on the lines of detection and switch.
    """
    milestones, window = panel.milestones, panel.window
    instants = (milestones.detection_s, milestones.switch_s)
    lines = [x - window.zero_s for x in instants if x is not None]
    free_from = 0.06 + max((x for x in lines if 0.0 <= x < _BEGIN_S), default=-np.inf)
    for start, end, name, colour in (
        (milestones.contact_s, milestones.unstable_end_s, "unstable", style.VERMILLION),
        (milestones.unstable_end_s, milestones.recovery_end_s, "recovery", style.BLUE),
    ):
        if start is None or end is None or start >= window.end_s:
            continue
        a, b = start - window.zero_s, min(end, window.end_s) - window.zero_s
        panel.axes.plot((a, b), (1.3, 1.3), color=colour, lw=2.2, solid_capstyle="butt")
        words = f"{name} {end - start:.2f} s"
        length = 0.0115 * len(words) * (window.end_s - window.start_s)
        left = max((a + b - length) / 2.0, a + 0.04, free_from)
        if left + length > window.end_s - window.zero_s:
            continue
        panel.axes.text(left, 1.45, words, color=colour, ha="left", va="bottom", size=SMALL)
        free_from = left + length


def _instants(panel: Panel) -> None:
    """Names of contact, detection and switch, on lines of their own so that none covers another.

    The contact's name stands left of its line, unless the detection came first.
    """
    milestones, window, axes = panel.milestones, panel.window, panel.axes
    if milestones.contact_s is None:
        return
    later = [
        (instant - milestones.contact_s, words, colour)
        for instant, words, colour in (
            (milestones.detection_s, "detection", style.PURPLE),
            (milestones.switch_s, "set point to $x_r$", style.GREEN),
        )
        if instant is not None and window.start_s <= instant <= window.end_s
    ]
    early = any(x < 0.0 for x, _, _ in later)
    if len(later) == 2 and (early or abs(later[0][0] - later[1][0]) < _TOGETHER_S):
        later = [(later[0][0], "detection, set point to $x_r$", style.PURPLE)]
    levels = [2.6] if early else [3.35, 2.6]
    right = 0.16 + max([0.0, *(x for x, _, _ in later)])
    for (x, words, colour), level in zip(later, levels, strict=False):
        axes.plot((x, x, right), (1.1, level, level), color=colour, lw=0.9)
        text = f"{words} {1e3 * x:+.0f} ms".replace("-", "−")
        axes.text(right + 0.04, level, text, color=colour, va="center", size=SMALL)
    axes.plot((0.0, 0.0), (1.1, 3.6), color=style.INK, lw=1.1)
    x, side = (right + 0.04, "left") if early else (-0.06, "right")
    text = f"contact, $t_c$ = {milestones.contact_s:.2f} s"
    axes.text(x, 3.35, text, ha=side, va="center", weight="bold", size=SMALL)


def _mark_zoom(panel: Panel, mark_s: float) -> None:
    start, end = zoom_around(mark_s)
    end = min(end, panel.window.end_s)
    panel.axes.plot((start, end), (1.45, 1.45), color=style.INK, lw=1.0, solid_capstyle="butt")
    for edge in (start, end):
        panel.axes.plot((edge, edge), (1.25, 1.65), color=style.INK, lw=1.0)
    name = "contact" if panel.milestones.contact_s is not None else "crash"
    late = mark_s > 0.55 * panel.window.end_s
    x, side = (end, "right") if late else (start, "left")
    words = f"{name} at {mark_s:.2f} s, enlarged on the right"
    panel.axes.text(x, 1.95, words, ha=side, va="bottom", size=SMALL)


SIZE_IN: Final = (12.0, 8.0)
DPI: Final = 150

_LEFT, _RIGHT = 0.055, 0.945
_PANELS: Final = {
    "timeline": 1.1,  # the strip of phases
    "horizontal": 2.0,  # x and y
    "height": 2.0,
    "attitude": 2.0,
    "thrust": 2.0,
    "fold": 0.6,
}
"""Panel, by its function in `panels` → height."""


@dataclass(frozen=True)
class _PanelColumn:
    """Where a column of panels is, in parts of the figure."""

    left: float
    right: float
    top: float = 0.905
    bottom: float = 0.055
    gap: float = 0.042
    label_in: float = 0.43
    """From the axis to its label [in]."""

    def stack(self, figure: Figure) -> dict[str, Axes]:
        """Make axes one below the other, by the names of the rows."""
        scale = (self.top - self.bottom - self.gap * (len(_PANELS) - 1)) / sum(_PANELS.values())
        stack: dict[str, Axes] = {}
        ceiling = self.top
        for row, height in _PANELS.items():
            floor = ceiling - height * scale
            stack[row] = figure.add_axes(
                (self.left, floor, self.right - self.left, ceiling - floor)
            )
            ceiling = floor - self.gap
        return stack


_WHOLE, _ZOOMED, _WIDE = (
    _PanelColumn(_LEFT, 0.445),
    _PanelColumn(0.505, _RIGHT),
    _PanelColumn(_LEFT, _RIGHT),
)
_LENGTHS: Final = {
    "max_falling_distance_m": "falls",
    "unstable_phase_s": "unstable",
    "recovery_time_s": "recovered after",
}
"""Figure of the summary → words before it in the title."""
_VERDICT_COLOURS: Final = {
    FlightOutcome.RECOVERED: style.GREEN,
    FlightOutcome.CRASHED: style.VERMILLION,
    FlightOutcome.NO_CONTACT: style.MUTED,
    FlightOutcome.NOT_SETTLED: "#B07A00",
}


def draw_flight(flight: Flight) -> Figure:
    """Draw position, attitude, rotor thrust and phase against time; 1800 x 1200 px.

    The left column shows the whole flight, the right one the seconds around the contact
    (or the crash); with neither there is one wide column. The flight has at least one sample.
    """
    milestones = find_milestones(flight)
    angles_deg = roll_pitch_yaw_deg(flight.log["attitude"])
    end_s = max(milestones.duration_s, 1e-3)
    with new_figure(*SIZE_IN, DPI) as figure:
        _title(figure, flight.summary, milestones)
        if milestones.mark_s is None:
            columns = [(TimeWindow(0.0, end_s, 0.0, 1500, zoomed=False), _WIDE)]
        else:
            zoom = TimeWindow(*zoom_around(milestones.mark_s), milestones.mark_s, 900, zoomed=True)
            columns = [(TimeWindow(0.0, end_s, 0.0, 700, zoomed=False), _WHOLE), (zoom, _ZOOMED)]
        for window, place in columns:
            _column(figure, flight, milestones, angles_deg, window, place)
    return figure


def figure_bytes(figure: Figure) -> bytes:
    """Return a figure as a PNG file, the same bytes each time."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    return buffer.getvalue()


def _column(
    figure: Figure,
    flight: Flight,
    milestones: FlightMilestones,
    angles_deg: Array,
    window: TimeWindow,
    place: _PanelColumn,
) -> None:
    cut = _samples(flight.t, window)
    rows = {
        row: Panel(axes, flight, milestones, window, cut)
        for row, axes in place.stack(figure).items()
    }
    timeline(rows["timeline"])
    panels.horizontal(rows["horizontal"])
    panels.height(rows["height"])
    panels.attitude(rows["attitude"], angles_deg)
    panels.thrust(rows["thrust"])
    panels.fold(rows["fold"])
    for row, panel in rows.items():
        panel.axes.set_xlim(window.start_s - window.zero_s, window.end_s - window.zero_s)
        panel.axes.tick_params(labelbottom=row == "fold")
        if row != "timeline":
            panel.shade()
            width_in = SIZE_IN[0] * (place.right - place.left)
            panel.axes.yaxis.set_label_coords(-place.label_in / width_in, 0.5)
    origin = "contact" if milestones.contact_s is not None else "the crash"
    words = f"time from {origin} [s]" if window.zero_s else "time [s]"
    rows["fold"].axes.set_xlabel(words, labelpad=2)


def _samples(t: Array, window: TimeWindow) -> slice:
    """The samples inside the window; at least one."""
    first = int(np.searchsorted(t, window.start_s - 1e-9))
    last = int(np.searchsorted(t, window.end_s + 1e-9))
    first = min(first, len(t) - 1)
    return slice(first, max(last, first + 1))


def _title(figure: Figure, summary: Mapping[str, Any], milestones: FlightMilestones) -> None:
    name = str(summary["scenario"])
    name = name if len(name) <= 60 else name[:59] + "…"
    figure.text(_LEFT, 0.965, name, size=14, weight="bold", va="center", parse_math=False)
    details = [
        f"seed {summary['seed']}",
        None if summary["conf"] is None else f"Conf. {summary['conf']} propellers",
        reaction_words(summary["reaction"]),
        f"{milestones.duration_s:.1f} s",
    ]
    figures = [
        f"{words} {BY_KEY[key].text(value)}"
        for key, words in _LENGTHS.items()
        if (value := BY_KEY[key].of(summary, milestones)) is not None
    ]
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
