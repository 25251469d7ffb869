"""The picture of a sweep: distributions of figures."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.figures import BY_KEY, Value
from tombo_flight.sweep.statistics import Columns

PANELS: Final = (
    *("max_falling_distance_m", "unstable_phase_s", "recovery_time_s"),
    *("contact_known_s", "max_tilt_rad", "approach_rms_m"),
)
"""Figures of the histograms."""


def draw_distributions(flights: Columns, *, of_paper: bool) -> Figure:
    """Draw a histogram of each figure in `PANELS`; marked are median, range, the paper's value.

    Largest falling distances have two modes: the vehicle catches itself at once, or only after it
    has tilted. A mean would lie between them.
    """
    # Fixed places: a layout that measures the texts would draw all of them twice.
    places = {"left": 0.045, "right": 0.99, "bottom": 0.065, "top": 0.95, "hspace": 0.26}
    with new_figure(12.0, 7.0, 110) as figure:
        panels = figure.subplots(2, 3, gridspec_kw={**places, "wspace": 0.15}).flat
        for axes, key in zip(panels, PANELS, strict=True):
            figure_of = BY_KEY[key]
            values = figure_of.factor * flights[key]
            printed = figure_of.paper if of_paper else None
            _histogram(axes, values[~np.isnan(values)], figure_of.label, printed)
    return figure


def _histogram(axes: Axes, values: Array, label: str, printed: Value) -> None:
    axes.set_xlabel(label)
    axes.set_ylabel("flights")
    if not values.size:
        axes.text(0.5, 0.5, "none", transform=axes.transAxes, ha="center", color=style.MUTED)
        axes.set(xticks=[], yticks=[])
        return
    bins = max(5, min(30, round(2.0 * values.size**0.5)))
    low, median, high = np.percentile(values, (5.0, 50.0, 95.0))
    axes.axvspan(low, high, color=style.FAINT, lw=0.0, label=f"5 to 95 %: {low:.3g} to {high:.3g}")
    counts, edges = np.histogram(values, bins)
    axes.stairs(counts, edges, fill=True, color=style.SKY)
    axes.axvline(median, color=style.INK, lw=1.4, label=f"median {median:.3g}")
    if isinstance(printed, float):
        axes.axvline(printed, color=style.VERMILLION, lw=1.8, ls="--", label=f"paper {printed:g}")
    axes.yaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_ylim(0.0, 1.05 * counts.max())
    spacing = {"handlelength": 1.2, "handletextpad": 0.4, "columnspacing": 1.0}
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.1, ncols=3, **spacing)
