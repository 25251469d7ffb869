"""The leftover force and moment as small maps: against place, velocity, time, attitude, drive."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tombo_diagnosis.diagnosis import Diagnosis, Leftover
from tombo_diagnosis.report.residual_data import binned
from tombo_diagnosis.report.words import LEFTOVER_UNITS, dependence_text
from tombo_diagnosis.wording import capital, figure
from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

_MIN_SAMPLES: Final = 3
"""Blocks of time that a cell needs."""
_CELLS_ACROSS: Final = 7
_SLICES: Final = 10
_CORRELATED_S: Final = 2.0
"""Samples of so long a stretch count as one in intervals."""
_COLUMNS: Final = 4
_PANEL_IN: Final = (3.35, 2.75)
_DPI: Final = 120
_LABELS: Final = {
    "z": "height [m]", "t": "time since the start [s]", "yaw": "yaw [rad]", "tilt": "tilt [deg]",
    "thrust": "thrust, of rotor speeds [N]", "voltage": "battery [V]",
    "u": "velocity body x [m/s]", "v": "velocity body y [m/s]",
}  # fmt: skip
_PANELS: Final = {
    "force": ("z", "t", "yaw", "tilt", "thrust", "voltage"),
    "moment": ("z", "t", "yaw", "tilt", "thrust", "voltage", "u", "v"),
}
"""Quantity → the variables that it is drawn against, a line for each axis."""
_IN_MAP: Final = frozenset({"z", "t"})
"""Quantities of the world: the leftover is drawn in map; else in body."""


@dataclass(frozen=True)
class _Samples:
    """The samples of all flights of one quantity."""

    quantity: str
    state: dict[str, Array]
    block: NDArray[np.int64]
    """(N,) which stretch of which flight a sample is from."""
    by_frame: dict[str, Array]
    """body and map → (N, 3)"""

    @property
    def limit(self) -> float:
        """Symmetric limit of an axis that holds most of the samples."""
        values = np.abs(np.concatenate([v.ravel() for v in self.by_frame.values()]))
        return 1.2 * max(float(np.nanquantile(values, 0.9)), 1e-9)


def draw_leftover(diagnosis: Diagnosis) -> Figure:
    """Draw the leftover of all flights: arrows in cells of place and velocity, lines of means."""
    left = diagnosis.leftover
    panels: list[Callable[[Axes], None]] = []
    for quantity in left.rms if left is not None else ():
        assert left is not None
        samples = _samples(left, quantity)
        if quantity == "force":
            panels += [partial(_arrows, samples=samples, frame=f) for f in ("map", "body")]
        shown = [name for name in _PANELS[quantity] if name in samples.state]
        panels += [partial(_lines, samples=samples, name=name) for name in shown]
    rows = max(1, -(-len(panels) // _COLUMNS))
    size = _PANEL_IN[0] * _COLUMNS, _PANEL_IN[1] * rows + 1.0
    with new_figure(*size, _DPI, layout="constrained") as sheet:
        title = "Nothing is left over" if left is None else leftover_title(left)
        sheet.suptitle(title, x=0.01, ha="left", weight="bold", size=10.5, parse_math=False)
        for k, draw in enumerate(panels):
            draw(sheet.add_subplot(rows, _COLUMNS, k + 1))
        if panels:
            sheet.supxlabel(
                "Arrows: mean force in the plane of the panel; colour of a dot: force along z. "
                "Lines with bars: mean and 95 % interval. All flights.",
                size=8.5, color=style.MUTED,
            )  # fmt: skip
    return sheet


def leftover_title(left: Leftover) -> str:
    """Return how much is left over, and what it follows."""
    sizes = [f"{q} left over {figure(rms)} {LEFTOVER_UNITS[q]} (RMS)"
             for q, rms in left.rms.items()]  # fmt: skip
    return "\n".join([capital("; ".join(sizes)), dependence_text(left)])


def _samples(left: Leftover, quantity: str) -> _Samples:
    flights = [s for s in left.samples if s.quantity == quantity]
    names = set.intersection(*(set(s.state) for s in flights))
    state = {name: np.concatenate([s.state[name] for s in flights]) for name in sorted(names)}
    lean = np.concatenate([s.rotation[:, 2, 2] for s in flights])
    state["tilt"] = np.degrees(np.arccos(np.clip(lean, -1.0, 1.0)))
    stretches = [np.floor(s.state["t"] / _CORRELATED_S) for s in flights]
    first = np.cumsum([0.0, *(b.max() + 1.0 for b in stretches)])
    block = np.concatenate([b + k for b, k in zip(stretches, first[:-1], strict=True)])
    frames = {
        "body": np.vstack([s.body for s in flights]),
        "map": np.vstack([s.map for s in flights]),
    }
    return _Samples(quantity, state, block.astype(np.int64), frames)


def _arrows(axes: Axes, samples: _Samples, frame: str) -> None:
    """Draw means in cells: arrows in the plane, colour for the component along z."""
    x, y, what, unit = (
        ("x", "y", "place", "m") if frame == "map" else ("u", "v", "velocity", "m/s")
    )
    places = np.column_stack([samples.state[x], samples.state[y]])
    at, mean = cell_means(places, np.nan_to_num(samples.by_frame[frame]))
    longest = max(float(np.linalg.norm(mean[:, :2], axis=1).max(initial=0.0)), 1e-9)
    span = max(float(np.ptp(places, axis=0).max()), 1e-6)
    largest = max(float(np.abs(mean[:, 2]).max(initial=0.0)), 0.05 * samples.limit)
    dots = axes.scatter(
        at[:, 0], at[:, 1], c=mean[:, 2], cmap="PuOr", vmin=-largest, vmax=largest, s=34,
        edgecolors=style.MUTED, linewidths=0.4,
    )  # fmt: skip
    axes.quiver(
        *at.T, *mean[:, :2].T, angles="xy", scale_units="xy", scale=longest / (0.18 * span),
        color=style.INK, width=0.007,
    )  # fmt: skip
    axes.figure.colorbar(dots, ax=axes, label=f"along {frame} z [N]", aspect=30)
    axes.set(xlabel=f"{what} {frame} x [{unit}]", ylabel=f"{what} {frame} y [{unit}]")
    axes.set_title(f"longest arrow {figure(longest, 2)} N", loc="left", size=8.5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.25)


def cell_means(place: Array, values: Array) -> tuple[Array, Array]:
    """Return mean place (C, 2) and values (C, 3) of the squares with enough samples (N, 2)."""
    low, high = place.min(axis=0), place.max(axis=0)
    side = max(float((high - low).max()) / _CELLS_ACROSS, 1e-9)
    _, cell = np.unique(np.floor((place - low) / side), axis=0, return_inverse=True)
    cell = cell.reshape(-1)
    count = np.bincount(cell)
    sums = np.column_stack([np.bincount(cell, v) for v in (*place.T, *values.T)])
    means = (sums / count[:, None])[count >= _MIN_SAMPLES]
    return means[:, :2], means[:, 2:]


def _lines(axes: Axes, samples: _Samples, name: str) -> None:
    """Draw means in slices of one variable, a line for each component."""
    frame = "map" if name in _IN_MAP else "body"
    x = samples.state[name]
    colours = (style.VERMILLION, style.GREEN, style.BLUE)
    for axis, colour, y in zip("xyz", colours, samples.by_frame[frame].T, strict=True):
        if np.ptp(x) > 0.0 and np.isfinite(y).all():
            means = binned(x, y, samples.block, _SLICES)
            axes.errorbar(
                means.x, means.mean, yerr=np.nan_to_num(means.half), color=colour, lw=1.4,
                marker="o", ms=3, elinewidth=0.9, label=f"{frame} {axis}",
            )  # fmt: skip
    if axes.lines:
        axes.legend(loc="best", ncols=3, fontsize=7, handlelength=1.2, columnspacing=0.8)
    axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)
    axes.set_ylim(-samples.limit, samples.limit)
    axes.set_xlabel(_LABELS[name])
    axes.set_ylabel(f"{samples.quantity} left over [{LEFTOVER_UNITS[samples.quantity]}]")
