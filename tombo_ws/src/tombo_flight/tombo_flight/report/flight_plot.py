"""The still figure of a flight, marked like the paper's figure of the recovery.

Its top row is the strip of phases; of a flight over MAVLink there is a second strip, PX4's modes.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_flight.flight_metrics import STABLE_TILT
from tombo_flight.report import style
from tombo_flight.report.figures import (
    BY_KEY,
    FRONT_LEFT,
    ROTOR_NAMES,
    FlightMilestones,
    FlightOutcome,
    find_milestones,
    reaction_words,
    roll_pitch_yaw_deg,
)
from tombo_flight.report.style import envelope, new_figure

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

SIZE_IN: Final = (12.0, 8.0)
DPI: Final = 150
_BEFORE_S, _AFTER_S = 2.0, 6.0
"""Time that the zoomed column shows before and after the contact."""
_HEIGHTS: Final = (0.7, 2.0, 2.0, 2.0, 2.0, 0.6)
"""Heights of the rows: phase, horizontal position, height, attitude, thrust, fold."""
_PLACES: Final = {"left": 0.062, "right": 0.982, "top": 0.9, "bottom": 0.055}
_LETTER: Final = 0.0135
"""Width of a letter as a share of a panel, generously."""
_DASHES: Final[Any] = (0, (4, 2))
_ROTORS: Final = (FRONT_LEFT, *(k for k in range(len(ROTOR_NAMES)) if k != FRONT_LEFT))
"""The struck one first."""
_TITLE: Final = {
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


@dataclass(frozen=True)
class _Column:
    """A column of the figure: its stretch of time, counted from `zero_s`."""

    flight: Flight
    milestones: FlightMilestones
    start_s: float
    end_s: float
    zero_s: float
    zoomed: bool
    """It names the marks; the column of the whole flight names the lines."""

    def trace(
        self, axes: Axes, y: Array, colour: str, width: float, name: str = "", **more: Any
    ) -> None:
        """Draw a column of the log, (N,), thinned to the resolution of the panel."""
        t = self.flight.t
        first = min(int(np.searchsorted(t, self.start_s - 1e-9)), t.size - 1)
        cut = slice(first, max(int(np.searchsorted(t, self.end_s + 1e-9)), first + 1))
        thin_t, thin_y = envelope(t[cut], y[cut], 900)
        label = "" if self.zoomed else name
        axes.plot(thin_t - self.zero_s, thin_y, color=colour, lw=width, label=label, **more)

    def name(self, text: str) -> str:
        """Return the label of a mark."""
        return text if self.zoomed else ""


def draw_flight(flight: Flight) -> Figure:
    """Draw position, attitude, rotor thrust and phase against time; 1800 x 1200 px.

    The left column shows the whole flight, the right one the seconds around the contact
    (or the crash); with neither there is one wide column. The flight has at least one sample.
    """
    milestones = find_milestones(flight)
    mark_s = milestones.mark_s
    end_s = max(milestones.duration_s, 1e-3)
    columns = [_Column(flight, milestones, 0.0, end_s, 0.0, zoomed=False)]
    if mark_s is not None:
        stretch = max(0.0, mark_s - _BEFORE_S), mark_s + _AFTER_S
        columns.append(_Column(flight, milestones, *stretch, mark_s, zoomed=True))
    with new_figure(*SIZE_IN, DPI) as figure:
        layout = {"height_ratios": _HEIGHTS, **_PLACES, "hspace": 0.3, "wspace": 0.13}
        size = len(_HEIGHTS), len(columns)
        panels = figure.subplots(*size, sharex="col", squeeze=False, gridspec_kw=layout)
        for column, rows in zip(columns, panels.T, strict=True):
            _draw_column(column, rows)
        figure.align_ylabels()
        _write_title(figure, flight, milestones)
    return figure


def _draw_column(column: _Column, rows: Sequence[Axes]) -> None:
    strip, horizontal, height, attitude, thrust, fold = rows
    log = column.flight.log
    _draw_phases(column, strip)
    _draw_position(column, horizontal, ((1, style.GREEN, "y north"), (0, style.BLUE, "x east")))
    _draw_position(column, height, ((2, style.PURPLE, "z up"),))
    _draw_attitude(column, attitude)
    for axes, values in ((thrust, log["rotor_thrust"]), (fold, log["fold"])):
        for i in _ROTORS:
            width, zorder = (1.7, 3.0) if i == FRONT_LEFT else (0.9, 2.0)
            name = ROTOR_NAMES[i] if axes is thrust else ""
            column.trace(axes, values[:, i], style.ROTOR_COLOURS[i], width, name, zorder=zorder)
    thrust.set_ylim(bottom=0.0)
    fold.set(ylim=(-0.05, 1.1), yticks=(0.0, 1.0))
    for axes in rows[1:]:
        _mark(column, axes, named=axes is height)
    labels = ("phase", "x, y [m]", "height z [m]", "attitude [°]", "rotor thrust [N]", "fold")
    for axes, label in zip(rows, labels, strict=True):
        axes.set_ylabel(label)
        _, named = axes.get_legend_handles_labels()
        if named:
            spacing = {"borderpad": 0.1, "handlelength": 1.3, "handletextpad": 0.5}
            place = {"loc": "lower left", "bbox_to_anchor": (-0.012, 0.98)}
            axes.legend(**place, ncols=len(named), columnspacing=1.1, **spacing)
    origin = "contact" if column.milestones.contact_s is not None else "the crash"
    fold.set_xlabel(f"time from {origin} [s]" if column.zoomed else "time [s]", labelpad=2)
    fold.set_xlim(column.start_s - column.zero_s, column.end_s - column.zero_s)


def _draw_phases(column: _Column, axes: Axes) -> None:
    """Draw the strip of phases, and that of PX4's modes."""
    px4 = column.flight.summary.get("px4")
    axes.set(ylim=(0.0 if px4 is None else -1.1, 1.1), yticks=[])
    axes.grid(False)
    axes.spines[:].set_visible(False)
    axes.tick_params(bottom=False)
    for span in column.milestones.phases:
        colour = style.PHASE_COLOURS.get(span.phase, style.FAINT)
        _draw_bar(column, axes, 0.5, (span.start_s, span.end_s), span.name, colour)
    modes = [] if px4 is None else px4["modes"]
    ends = [*(time_s for time_s, _ in modes[1:]), np.inf]
    for (start_s, name), end_s in zip(modes, ends, strict=False):
        colour = style.PX4_COLOURS.get(name, style.FAINT)
        _draw_bar(column, axes, -0.6, (start_s, end_s), f"PX4: {name}", colour)


def _draw_bar(
    column: _Column, axes: Axes, y: float, span: tuple[float, float], name: str, colour: str
) -> None:
    """Draw what the column shows of a span, with its name if there is room for it."""
    start, end = max(span[0], column.start_s), min(span[1], column.end_s)
    if end <= start:
        return
    axes.barh(y, end - start, left=start - column.zero_s, height=0.9, color=colour, lw=0)
    if (end - start) / (column.end_s - column.start_s) > _LETTER * len(name):
        middle = (start + end) / 2.0 - column.zero_s
        axes.text(middle, y - 0.02, name, ha="center", va="center", size=7.8)


def _draw_position(
    column: _Column, axes: Axes, coordinates: Iterable[tuple[int, str, str]]
) -> None:
    """Draw coordinates with set points and estimates, and the x of x_c and of x_r."""
    log = column.flight.log
    for i, colour, name in coordinates:
        column.trace(axes, log["est_position"][:, i], colour, 0.5, alpha=0.45)
        column.trace(axes, log["position_setpoint"][:, i], style.INK, 0.8, ls=_DASHES)
        column.trace(axes, log["position"][:, i], colour, 1.7, name)
    low, high = axes.get_ylim()
    margin = max(0.0, 0.05 - (high - low) / 2.0)  # noise alone is not magnified
    axes.set_ylim(low - margin, high + margin)
    if name == "x east":
        axes.plot([], [], color=style.INK, ls=_DASHES, label=column.name("set point"))
        milestones = column.milestones
        for place, text in ((milestones.x_c_m, "$x_c$"), (milestones.x_r_m, "$x_r$")):
            if place is not None:
                label = column.name(f"{text} {place[0]:.2f} m")
                axes.axhline(place[0], color=style.BLUE, lw=0.7, ls="-.", zorder=1.5, label=label)


def _draw_attitude(column: _Column, axes: Axes) -> None:
    """Draw roll, pitch and yaw, and the tilt below which the vehicle counts as upright."""
    angles_deg = roll_pitch_yaw_deg(column.flight.log["attitude"])
    for i, (colour, name) in enumerate(
        ((style.BLUE, "roll"), (style.ORANGE, "pitch"), (style.GREEN, "yaw"))
    ):
        column.trace(axes, angles_deg[:, i], colour, 1.3, name)
    for sign in (-1.0, 1.0):
        limit = sign * float(np.degrees(STABLE_TILT))
        axes.axhline(limit, color=style.MUTED, lw=0.7, ls=_DASHES, zorder=1.5)


def _mark(column: _Column, axes: Axes, *, named: bool) -> None:
    """Mark the phases as bands and the instants as upright lines."""
    milestones, zero_s = column.milestones, column.zero_s
    contact_s, unstable_s = milestones.contact_s, milestones.unstable_end_s
    for start, end, text, colour in (
        (contact_s, unstable_s, "unstable", style.UNSTABLE),
        (unstable_s, milestones.recovery_end_s, "recovery", style.RECOVERY),
    ):
        if start is not None and end is not None and start < column.end_s:
            span = start - zero_s, min(end, column.end_s) - zero_s
            label = column.name(f"{text} {end - start:.2f} s") if named else ""
            axes.axvspan(*span, color=colour, alpha=0.3, lw=0, zorder=0, label=label)
    for instant, text, colour in (
        (contact_s, "contact", style.INK),
        (milestones.crash_s, "crash", style.VERMILLION),
        (milestones.detection_s if column.zoomed else None, "detection", style.PURPLE),
        (milestones.switch_s if column.zoomed else None, "to $x_r$", style.GREEN),
    ):
        if instant is not None and column.start_s <= instant <= column.end_s:
            after = "" if instant == zero_s else f" {1e3 * (instant - zero_s):+.0f} ms"
            label = column.name(f"{text}{after}".replace("-", "−")) if named else ""
            axes.axvline(instant - zero_s, color=colour, lw=1.0, zorder=1.8, label=label)


def _write_title(figure: Figure, flight: Flight, milestones: FlightMilestones) -> None:
    summary = flight.summary
    name = str(summary["scenario"])
    details = [
        f"seed {summary['seed']}",
        None if summary["conf"] is None else f"Conf. {summary['conf']} propellers",
        reaction_words(summary["reaction"]),
        f"{milestones.duration_s:.1f} s",
    ]
    values = {key: BY_KEY[key].of(summary, milestones) for key in _TITLE}
    figures = [
        f"{_TITLE[key]} {BY_KEY[key].text(value)}"
        for key, value in values.items()
        if value is not None
    ]
    left, right = _PLACES["left"], _PLACES["right"]
    figure.text(left, 0.965, name[:60], size=14, weight="bold", parse_math=False)
    verdict = figure.text(right, 0.965, milestones.verdict.value.upper(), size=12, ha="right")
    verdict.set(color=_VERDICT_COLOURS[milestones.verdict], weight="bold")
    for x, side, words in ((left, "left", details), (right, "right", figures)):
        line = "  ·  ".join(word for word in words if word)
        figure.text(x, 0.945, line, color=style.MUTED, va="center", ha=side)
