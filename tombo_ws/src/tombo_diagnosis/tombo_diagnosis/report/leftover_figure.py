"""The leftover force and moment as small maps: against place, velocity, time, attitude, drive."""

from __future__ import annotations

import textwrap
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_diagnosis.diagnosis import Diagnosis
from tombo_diagnosis.leftover.leftover import UNITS, Leftover, LeftoverSamples
from tombo_diagnosis.report.words import term_texts
from tombo_diagnosis.wording import capital, figure, percent
from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

_FEWEST = 3
"""Blocks of time that a cell needs."""


@dataclass(frozen=True)
class Cells:
    """Means in the cells that have enough samples."""

    at: Array
    """(C, 2) mean place of the samples of each cell."""
    mean: Array
    """(C, 3)"""
    count: Array
    """(C)"""


@dataclass(frozen=True)
class Slices:
    """Means in slices that hold equally many samples."""

    at: Array
    """(B)"""
    mean: Array
    """(B, 3)"""
    half: Array
    """(B, 3) half width of the 95 % interval, samples taken as independent."""


def cells(place: Array, values: Array, across: int = 7) -> Cells:
    """Return means of values (N, 3) in squares of places (N, 2), `across` on the longer side."""
    low, high = place.min(axis=0), place.max(axis=0)
    side = max(float((high - low).max()) / across, 1e-9)
    index = np.floor((place - low) / side).astype(np.int64)
    _, which = np.unique(index, axis=0, return_inverse=True)
    which = which.reshape(-1)
    count = np.bincount(which)
    at = np.column_stack([np.bincount(which, p) for p in place.T]) / count[:, None]
    mean = np.column_stack([np.bincount(which, v) for v in values.T]) / count[:, None]
    enough = count >= _FEWEST
    return Cells(at[enough], mean[enough], count[enough].astype(np.float64))


def slices(x: Array, values: Array, number: int = 10) -> Slices:
    """Return the means of values (N, 3) in slices of x (N); NaN is left out of a mean."""
    order = np.array_split(np.argsort(x, kind="stable"), max(min(number, x.size // _FEWEST), 1))
    at = np.array([x[rows].mean() for rows in order])
    mean = np.array([_mean(values[rows]) for rows in order])
    spread = np.array([values[rows].std(axis=0) / np.sqrt(max(rows.size, 1)) for rows in order])
    return Slices(at, mean, 1.96 * spread)


def _mean(values: Array) -> Array:
    known = np.isfinite(values)
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)


AXIS_COLOURS: Final = (style.VERMILLION, style.GREEN, style.BLUE)
"""Of the components x, y and z."""
_COLUMNS: Final = 4
_SIZE_IN: Final = (3.35, 2.75)
_DPI: Final = 120
_COLOUR_MAP: Final = "PuOr"


@dataclass(frozen=True)
class _Pool:
    """The samples of all flights of one quantity."""

    quantity: str
    state: dict[str, Array]
    body: Array
    map: Array
    fitted_body: Array
    fitted_map: Array

    @property
    def limit(self) -> float:
        """Symmetric limit of an axis that holds the means of all panels."""
        drawn = [
            slices(self.state[name], self.map if name in _IN_MAP else self.body).mean
            for name in _LABELS
            if name in self.state
        ]
        return 1.35 * max([1e-9, *(float(np.nanmax(np.abs(m))) for m in drawn if m.size)])

    @property
    def unit(self) -> str:
        return UNITS[self.quantity]


_Panel = tuple[Callable[[Axes, _Pool, str], None], _Pool, str]


def draw_leftover(diagnosis: Diagnosis) -> Figure:
    """Draw the leftover of all flights: arrows and colours for means, lines for the sparse fit."""
    leftover = diagnosis.leftover
    pools = [] if leftover is None else [_pool(leftover, q) for q in leftover.rms]
    panels = [panel for pool in pools for panel in _panels(pool)]
    rows = max(1, -(-len(panels) // _COLUMNS))
    size = (_SIZE_IN[0] * _COLUMNS, _SIZE_IN[1] * rows + 1.0)
    with new_figure(*size, _DPI, layout="constrained") as sheet:
        title = "nothing is left over" if leftover is None else _title(leftover)
        sheet.suptitle(
            title, x=0.01, ha="left", weight="bold", size=10.5, parse_math=False
        )  # fmt: skip
        for k, (kind, pool, name) in enumerate(panels):
            kind(sheet.add_subplot(rows, _COLUMNS, k + 1), pool, name)
        if panels:
            sheet.supxlabel(
                "Arrows: mean force in the plane of the panel; colour of a dot: force along z. "
                "Lines with bars: mean and 95 % interval; dashed: the terms fitted. All flights.",
                size=8.5, color=style.MUTED,
            )  # fmt: skip
    return sheet


def _title(leftover: Leftover) -> str:
    sizes = "; ".join(
        f"{q} left over {figure(rms)} {UNITS[q]} (root mean square)"
        + (f", terms predict {percent(leftover.r2[q])} of it in flights held out"
           if leftover.r2[q] > 0.0 else "")
        for q, rms in leftover.rms.items()
    )  # fmt: skip
    texts = term_texts(leftover) or ["no term of the dictionary predicts it in flights held out"]
    lines = textwrap.wrap("; ".join(texts), 165, max_lines=3, placeholder=" …")
    return "\n".join([capital(sizes), *lines])


def _pool(leftover: Leftover, quantity: str) -> _Pool:
    samples = [s for s in leftover.samples if s.quantity == quantity]
    body = np.vstack([s.body for s in samples])
    fitted = np.vstack([np.nan_to_num(s.fitted) for s in samples])
    names = set.intersection(*(set(s.state) for s in samples))
    state = {name: np.concatenate([s.state[name] for s in samples]) for name in sorted(names)}
    state["t"] = np.concatenate([s.t for s in samples])
    state["tilt"] = np.concatenate([_tilt(s) for s in samples])
    return _Pool(
        quantity, state, body, np.vstack([s.in_map(s.body) for s in samples]), fitted,
        np.vstack([s.in_map(s.fitted) for s in samples]),
    )  # fmt: skip


def _tilt(samples: LeftoverSamples) -> Array:
    return np.asarray(np.degrees(np.arccos(np.clip(samples.rotation[:, 2, 2], -1.0, 1.0))))


def _panels(pool: _Pool) -> list[_Panel]:
    """Return the panels of a quantity: how to draw each, and against what."""
    shown: list[_Panel] = []
    if pool.quantity == "force":
        shown += [(_arrows, pool, "place"), (_arrows, pool, "velocity")]
    names = ("z", "t", "yaw", "tilt", "thrust", "voltage")
    shown += [(_lines, pool, name) for name in names if name in pool.state]
    if pool.quantity == "moment":
        shown += [(_lines, pool, name) for name in ("u", "v")]
    return shown


_LABELS: Final = {
    "z": "height [m]", "t": "time since the start [s]", "yaw": "yaw [rad]", "tilt": "tilt [deg]",
    "thrust": "thrust, of rotor speeds [N]", "voltage": "battery [V]",
    "u": "velocity body x [m/s]", "v": "velocity body y [m/s]",
}  # fmt: skip
_IN_MAP: Final = frozenset({"z", "t"})
"""Quantities of the world: the leftover is shown in map; else in body."""


def _arrows(axes: Axes, pool: _Pool, what: str) -> None:
    """Draw means in cells: arrows in the plane, colour for the component along z."""
    x, y = ("x", "y") if what == "place" else ("u", "v")
    place = np.column_stack([pool.state[x], pool.state[y]])
    values = pool.map if what == "place" else np.nan_to_num(pool.body)
    frame = "map" if what == "place" else "body"
    means = cells(place, values)
    longest = max(float(np.linalg.norm(means.mean[:, :2], axis=1).max(initial=0.0)), 1e-9)
    span = max(float(np.ptp(place, axis=0).max()), 1e-6)
    largest = max(float(np.abs(means.mean[:, 2]).max(initial=0.0)), 0.05 * pool.limit)
    dots = axes.scatter(
        means.at[:, 0], means.at[:, 1], c=means.mean[:, 2], cmap=_COLOUR_MAP,
        vmin=-largest, vmax=largest, s=34, edgecolors=style.MUTED, linewidths=0.4,
    )  # fmt: skip
    axes.quiver(
        *means.at.T, *means.mean[:, :2].T, angles="xy", scale_units="xy",
        scale=longest / (0.18 * span), color=style.INK, width=0.007,
    )  # fmt: skip
    axes.figure.colorbar(dots, ax=axes, label=f"along {frame} z [{pool.unit}]", aspect=30)
    quantity = "m" if what == "place" else "m/s"
    axes.set(xlabel=f"{what} {frame} x [{quantity}]", ylabel=f"{what} {frame} y [{quantity}]")
    axes.set_title(f"longest arrow {figure(longest, 2)} {pool.unit}", loc="left", size=8.5)
    axes.set_aspect("equal", adjustable="datalim")
    axes.margins(0.25)


def _lines(axes: Axes, pool: _Pool, name: str) -> None:
    """Draw means in slices of one quantity, a line for each component."""
    frame = "map" if name in _IN_MAP else "body"
    values, fitted = (
        (pool.map, pool.fitted_map) if frame == "map" else (pool.body, pool.fitted_body)
    )
    x = pool.state[name]
    if np.ptp(x) > 0.0:
        means, model = slices(x, values), slices(x, fitted)
        for i, (axis, colour) in enumerate(zip("xyz", AXIS_COLOURS, strict=True)):
            axes.errorbar(
                means.at, means.mean[:, i], yerr=np.nan_to_num(means.half[:, i]), color=colour,
                lw=1.4, marker="o", ms=3, elinewidth=0.9, label=f"{frame} {axis}",
            )  # fmt: skip
            if np.any(fitted[:, i]):
                axes.plot(model.at, model.mean[:, i], "--", color=colour, lw=1.0, alpha=0.8)
        axes.legend(loc="best", ncols=3, fontsize=7, handlelength=1.2, columnspacing=0.8)
    axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)
    axes.set_ylim(-pool.limit, pool.limit)
    axes.set_xlabel(_LABELS[name])
    axes.set_ylabel(f"{pool.quantity} left over [{pool.unit}]")
