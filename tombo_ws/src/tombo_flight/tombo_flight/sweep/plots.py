"""Pictures of a sweep: how outcomes depend on what was varied, and how figures are spread."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_flight.campaign.campaign_plot import PANELS, draw_histogram
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.sweep.design import Axis

_MOST_CELLS = 40
"""Levels that are shown one by one; more are put together."""
_BINS = 12
_MOST_MAPS = 3
_MOST_TICKS = 12
_SHOWN = (
    ("crashed", "crashed [%]", "mean"),
    ("recovery_time_s", "recovery time, median [s]", "median"),
    ("max_falling_distance_m", "largest falling distance, median [m]", "median"),
)
"""Figure, label, what is made of it in a cell."""
Columns = Mapping[str, Array]
"""Name → (N,) floats, NaN for null."""


class Scale:
    """The cells of an axis: its levels, or bins of equal width."""

    def __init__(self, axis: Axis, values: Array) -> None:
        self.key = axis.key
        if axis.levels and len(axis.levels) <= _MOST_CELLS:
            self.labels = list(axis.levels)
            keys = np.array([float(v) for v in axis.levels]) if axis.numeric else None
            self.cell = (
                np.argmin(np.abs(values[:, None] - keys), axis=1)
                if keys is not None
                else values.astype(np.int64)
            )
            self.centres = keys if keys is not None else np.arange(len(axis.levels), dtype=float)
            return
        low, high = float(values.min()), float(values.max())
        edges = np.linspace(low, high if high > low else low + 1.0, _BINS + 1)
        self.cell = np.clip(np.searchsorted(edges, values, "right") - 1, 0, _BINS - 1)
        self.centres = 0.5 * (edges[1:] + edges[:-1])
        self.labels = [f"{centre:.3g}" for centre in self.centres]


def draw_dependence(axes: Sequence[Axis], columns: Columns) -> list[tuple[Figure, str]]:
    """Draw maps over each pair of axes, or curves over the only one; with a caption each."""
    scales = [Scale(axis, columns[axis.key]) for axis in axes]
    if not scales:
        return []
    if len(scales) == 1:
        return [(_curves(scales[0], columns), f"Over {scales[0].key}; band: 5 to 95 %")]
    pairs = list(combinations(scales, 2))[:_MOST_MAPS]
    return [
        (_maps(across, up, columns), f"Over {across.key} and {up.key}, all else together")
        for up, across in pairs
    ]


def draw_distributions(columns: Columns) -> Figure:
    """Draw a histogram of each of the collision's figures."""
    with new_figure(12.0, 7.0, 110, layout="constrained") as figure:
        for axes, (key, label, printed) in zip(figure.subplots(2, 3).flat, PANELS, strict=True):
            values = columns[key]
            draw_histogram(axes, values[np.isfinite(values)], label, printed)
    return figure


def _curves(scale: Scale, columns: Columns) -> Figure:
    with new_figure(12.0, 3.6, 110, layout="constrained") as figure:
        for axes, (key, label, kind) in zip(figure.subplots(1, 3), _SHOWN, strict=True):
            factor = 100.0 if kind == "mean" else 1.0
            cells = [scale.cell == cell for cell in range(len(scale.centres))]
            found = [factor * columns[key][cell] for cell in cells]
            middle = [_value(values, kind) for values in found]
            axes.plot(scale.centres, middle, color=style.BLUE, lw=1.8, marker=".")
            if kind == "median":
                low, high = ([_value(v, f"p{share}") for v in found] for share in (5, 95))
                axes.fill_between(scale.centres, low, high, color=style.FAINT, lw=0.0)
            axes.set(xlabel=scale.key, ylabel=label)
            if len(scale.labels) <= _MOST_TICKS:
                axes.set_xticks(scale.centres, scale.labels)
    return figure


def _maps(across: Scale, up: Scale, columns: Columns) -> Figure:
    with new_figure(12.0, 4.2, 110, layout="constrained") as figure:
        for axes, (key, label, kind) in zip(figure.subplots(1, 3), _SHOWN, strict=True):
            _map(figure, axes, across, up, columns[key], label, kind)
    return figure


def _map(
    figure: Figure, axes: Axes, across: Scale, up: Scale, values: Array, label: str, kind: str
) -> None:
    shape = (len(up.labels), len(across.labels))
    cells = np.full(shape, np.nan)
    place = up.cell * shape[1] + across.cell
    order = np.argsort(place, kind="stable")
    first = np.searchsorted(place[order], np.arange(shape[0] * shape[1] + 1))
    for cell, (a, b) in enumerate(pairwise(first)):
        cells.flat[cell] = _value(values[order[a:b]], kind)
    limits = (0.0, 100.0) if kind == "mean" else (None, None)
    shown = axes.imshow(
        100.0 * cells if kind == "mean" else cells,
        origin="lower", aspect="auto", cmap="viridis", vmin=limits[0], vmax=limits[1],
    )  # fmt: skip
    figure.colorbar(shown, ax=axes)
    axes.set(title=label, xlabel=across.key, ylabel=up.key)
    axes.grid(visible=False)
    _ticks(axes.set_xticks, across.labels)
    _ticks(axes.set_yticks, up.labels)


def _ticks(set_ticks: Callable[..., Any], labels: Sequence[str]) -> None:
    every = -(-len(labels) // _MOST_TICKS)
    set_ticks(range(0, len(labels), every), labels[::every])


def _value(values: Array, kind: str) -> float:
    values = values[np.isfinite(values)]
    if not values.size:
        return np.nan
    if kind == "mean":
        return float(values.mean())
    return float(np.percentile(values, 50.0 if kind == "median" else float(kind[1:])))
