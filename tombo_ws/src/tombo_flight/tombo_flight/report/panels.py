"""The panels of a flight's figure over a stretch of time."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from tombo_dynamics.arrays import Array
from tombo_flight.flight_metrics import STABLE_TILT
from tombo_flight.report import style
from tombo_flight.report.milestones import FRONT_LEFT, ROTOR_NAMES, FlightMilestones

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


SMALL: Final = 7.8
"""Size of the words inside a panel, points."""
BEFORE_S: Final = 2.0
AFTER_S: Final = 6.0
"""Time that the zoomed column shows before and after the contact."""
_DASHES: Final[Any] = (0, (4, 2))


@dataclass(frozen=True)
class TimeWindow:
    """A column of the figure: its stretch of time and how many points a line may have.

    `zero_s` is the instant from which the time axis counts.
    """

    start_s: float
    end_s: float
    zero_s: float
    buckets: int
    zoomed: bool


@dataclass(frozen=True)
class Panel:
    """Axes that show a window of a flight; `cut` are the samples inside the window."""

    axes: Axes
    flight: Flight
    milestones: FlightMilestones
    window: TimeWindow
    cut: slice

    def trace(
        self,
        y: Array,
        colour: str,
        width: float,
        *,
        alpha: float = 1.0,
        dashed: bool = False,
        zorder: float = 2.0,
    ) -> None:
        """Draw a column of the log, (N,), thinned to the panel's resolution."""
        t, y = envelope(self.flight.t[self.cut], y[self.cut], self.window.buckets)
        self.axes.plot(
            t - self.window.zero_s,
            y,
            color=colour,
            lw=width,
            alpha=alpha,
            ls=_DASHES if dashed else "-",
            zorder=zorder,
        )

    def fit(self, parts: Iterable[Array], *, headroom: float = 0.0) -> None:
        """Let the y axis span all finite values with a margin, and some more above."""
        values = np.concatenate([np.asarray(part).ravel() for part in parts])
        values = values[np.isfinite(values)]
        low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
        margin = max(0.08 * (high - low), 0.05)
        low, high = low - margin, high + margin
        self.axes.set_ylim(low, high + headroom * (high - low))

    def legend(self, handles: Sequence[Line2D]) -> None:
        """Name the lines once, above the whole-flight panel and outside its data."""
        if self.window.zoomed:
            return
        self.axes.legend(
            handles=list(handles),
            loc="lower left",
            bbox_to_anchor=(-0.012, 0.98),
            ncols=len(handles),
            borderpad=0.1,
            handlelength=1.3,
            handletextpad=0.5,
            columnspacing=1.1,
        )

    def shade(self) -> None:
        """Mark the phases as bands and the instants as upright lines."""
        milestones, window = self.milestones, self.window
        for start, end, colour, alpha in (
            (milestones.contact_s, milestones.unstable_end_s, style.UNSTABLE, 0.30),
            (milestones.unstable_end_s, milestones.recovery_end_s, style.RECOVERY, 0.25),
        ):
            if start is not None and end is not None and start < window.end_s:
                a, b = start - window.zero_s, min(end, window.end_s) - window.zero_s
                self.axes.axvspan(a, b, color=colour, alpha=alpha, lw=0, zorder=0)
        instants = [
            (milestones.contact_s, style.INK, 1.1, "-"),
            (milestones.crash_s, style.VERMILLION, 1.1, "--"),
        ]
        if window.zoomed:
            instants += [
                (milestones.detection_s, style.PURPLE, 0.9, "-"),
                (milestones.switch_s, style.GREEN, 0.9, "-"),
            ]
        for instant, colour, width, dash in instants:
            if instant is not None and window.start_s <= instant <= window.end_s:
                x = instant - window.zero_s
                self.axes.axvline(x, color=colour, lw=width, ls=dash, zorder=1.8)


def zoom_around(mark_s: float) -> tuple[float, float]:
    """Start and end of the zoomed column."""
    return max(0.0, mark_s - BEFORE_S), mark_s + AFTER_S


def key(colour: str, width: float, name: str, *, dashed: bool = False) -> Line2D:
    """A line for a legend."""
    return Line2D([], [], color=colour, lw=width, ls=_DASHES if dashed else "-", label=name)


def envelope(t: Array, y: Array, buckets: int) -> tuple[Array, Array]:
    """Thin a line to about 2 * `buckets` points that keep the extremes of every bucket.

    `t` and `y` are (N,); the result has the same first and last sample and is in time order.
    """
    n = len(t)
    if n <= 2 * buckets:
        return t, y
    per = -(-n // buckets)
    padded = np.full(per * -(-n // per), y[-1])
    padded[:n] = y
    rows = padded.reshape(-1, per)
    offsets = np.arange(len(rows)) * per
    picks = np.stack((rows.argmin(axis=1) + offsets, rows.argmax(axis=1) + offsets))
    index = np.unique(np.clip(np.append(picks, (0, n - 1)), 0, n - 1))
    return t[index], y[index]


_ROTORS: Final = (FRONT_LEFT, *(k for k in range(len(ROTOR_NAMES)) if k != FRONT_LEFT))
"""The struck one first."""


def horizontal(panel: Panel) -> None:
    """Draw x and y, with their set points and estimates, and the x of x_c and of x_r."""
    log = panel.flight.log
    for i, colour in ((1, style.GREEN), (0, style.BLUE)):
        _with_set_point(panel, i, colour)
    panel.fit(log[name][panel.cut, :2] for name in ("position", "position_setpoint"))
    panel.axes.set_ylabel("x, y [m]")
    _name_places(panel)
    east, north = key(style.BLUE, 1.7, "x east"), key(style.GREEN, 1.7, "y north")
    panel.legend([east, north, *_common()])


def height(panel: Panel) -> None:
    """Draw z with its set point and estimate, and how far the vehicle falls."""
    log = panel.flight.log
    _with_set_point(panel, 2, style.PURPLE)
    parts = [log[name][panel.cut, 2] for name in ("position", "position_setpoint")]
    panel.fit(parts, headroom=0.22)
    panel.axes.set_ylabel("height z [m]")
    panel.legend([key(style.PURPLE, 1.7, "z up"), *_common()])
    if panel.window.zoomed:
        _fall_arrow(panel)


def attitude(panel: Panel, angles_deg: Array) -> None:
    """Draw roll, pitch and yaw (N, 3), and the tilt below which the vehicle counts as upright."""
    colours, names = (style.BLUE, style.ORANGE, style.GREEN), ("roll", "pitch", "yaw")
    for i in (2, 1, 0):
        panel.trace(angles_deg[:, i], colours[i], 1.3)
    upright_deg = float(np.degrees(STABLE_TILT))
    for limit in (-upright_deg, upright_deg):
        panel.axes.axhline(limit, color=style.MUTED, lw=0.7, ls=(0, (2, 2)), zorder=1.5)
    panel.fit([angles_deg[panel.cut], np.array((-12.0, 12.0))])
    panel.axes.set_ylabel("attitude [°]")
    handles = [key(c, 1.3, n) for c, n in zip(colours, names, strict=True)]
    panel.legend([*handles, key(style.MUTED, 0.7, f"{STABLE_TILT} rad", dashed=True)])


def thrust(panel: Panel) -> None:
    """Draw the four rotors' thrust."""
    known = panel.flight.log["rotor_thrust"][panel.cut]
    _of_rotors(panel, "rotor_thrust")
    panel.axes.set_ylim(0.0, max(1.0, 1.1 * float(np.nanmax(known, initial=0.0))))
    panel.axes.set_ylabel("rotor thrust [N]")
    panel.legend([key(style.ROTOR_COLOURS[i], _width(i), ROTOR_NAMES[i]) for i in _ROTORS])


def fold(panel: Panel) -> None:
    """Draw how far each propeller is folded, in the colours of the thrust."""
    _of_rotors(panel, "fold")
    panel.axes.set_ylim(-0.05, 1.1)
    panel.axes.set_yticks((0.0, 1.0))
    panel.axes.set_ylabel("fold")


def _of_rotors(panel: Panel, name: str) -> None:
    for i in _ROTORS:
        zorder = 3.0 if i == FRONT_LEFT else 2.0
        values = panel.flight.log[name][:, i]
        panel.trace(values, style.ROTOR_COLOURS[i], _width(i), zorder=zorder)


def _width(rotor: int) -> float:
    return 1.7 if rotor == FRONT_LEFT else 0.9


def _common() -> list[Line2D]:
    return [key(style.INK, 0.8, "set point", dashed=True), key(style.MUTED, 0.5, "estimate")]


def _with_set_point(panel: Panel, axis: int, colour: str) -> None:
    log = panel.flight.log
    panel.trace(log["est_position"][:, axis], colour, 0.5, alpha=0.45)
    panel.trace(log["position_setpoint"][:, axis], style.INK, 0.8, dashed=True)
    panel.trace(log["position"][:, axis], colour, 1.7)


def _name_places(panel: Panel) -> None:
    """Lines at the x of x_c and of x_r; their names stand right of the zoomed panel."""
    named = ((panel.milestones.x_c_m, "$x_c$"), (panel.milestones.x_r_m, "$x_r$"))
    places = [(place[0], name) for place, name in named if place is not None]
    levels = [x for x, _ in places]
    low, high = panel.axes.get_ylim()
    apart = 0.12 * (high - low)
    if len(levels) == 2 and abs(levels[0] - levels[1]) < apart:
        middle = (levels[0] + levels[1]) / 2.0
        up = apart / 2.0 if levels[0] >= levels[1] else -apart / 2.0
        levels = [middle + up, middle - up]
    for (x, name), level in zip(places, levels, strict=True):
        panel.axes.axhline(x, color=style.BLUE, lw=0.7, ls=(0, (6, 2, 1, 2)), zorder=1.5)
        if panel.window.zoomed and low < level < high:
            panel.axes.annotate(
                f"{name} {x:.2f}",
                (1.0, level),
                xycoords=("axes fraction", "data"),
                xytext=(4, 0),
                textcoords="offset points",
                va="center",
                size=SMALL,
                color=style.BLUE,
            )


def _fall_arrow(panel: Panel) -> None:
    milestones, window, axes = panel.milestones, panel.window, panel.axes
    start, low, when = milestones.contact_height_m, milestones.lowest_m, milestones.lowest_s
    if start is None or low is None or when is None or milestones.contact_s is None:
        return
    if start - low < 0.02 or when > window.end_s:
        return
    x = when - window.zero_s
    axes.plot((0.0, x), (start, start), color=style.INK, lw=0.7, ls=":")
    arrow = {"arrowstyle": "<->", "color": style.INK, "lw": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", (x, low), (x, start), arrowprops=arrow)
    room = window.end_s - window.zero_s
    axes.annotate(
        f"falling distance {start - low:.2f} m",
        (float(np.clip(x - 0.1 * room, 0.03 * room, 0.7 * room)), start),
        xytext=(0, 5),
        textcoords="offset points",
        ha="left",
        va="bottom",
        size=SMALL,
        weight="bold",
    )
