"""A panel of the still figure: axes over a stretch of time, and what every panel shares."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.milestones import FlightMilestones

if TYPE_CHECKING:
    from tombo_bag.flight import Flight


SMALL: Final = 7.8
"""Size of the words inside a panel, points."""
BEFORE_S: Final = 2.0
AFTER_S: Final = 6.0
"""What the zoomed column shows before and after the contact."""
_DASHES: Final[Any] = (0, (4, 2))


@dataclass(frozen=True)
class Window:
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
    window: Window
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
        """Draw a column of the log, (N,), thinned to what the panel can show."""
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

    def legend(self, handles: Sequence[Line2D | Patch]) -> None:
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
    """Start and end of what the zoomed column shows."""
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
