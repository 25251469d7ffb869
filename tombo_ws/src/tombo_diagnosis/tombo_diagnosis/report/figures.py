"""Figures of a diagnosis: residuals against time and driver, and the leftover."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_diagnosis.diagnosis import VARIABLES, Dependence, Diagnosis, Leftover, Residual
from tombo_diagnosis.report import residual_data as data
from tombo_diagnosis.report.residual_data import Pair, corrected
from tombo_diagnosis.report.words import LEFTOVER_UNITS
from tombo_diagnosis.wording import display_name, unit
from tombo_flight.report import style
from tombo_flight.report.style import new_figure

BEFORE: Final = style.VERMILLION
AFTER: Final = style.BLUE
LOG_FAULT: Final = style.PURPLE
"""Fault or doubt in the log."""
_PANEL: Final = (4.8, 2.75, 100, 8.5)
"""Width and height [in], resolution [dpi], size of letters [pt]."""
_MAX_DOTS: Final = 700


def draw_pair(pair: Pair) -> Figure:
    """Draw one channel against one driver."""
    x, before, after = (pair.samples[name].to_numpy() for name in ("x", "before", "after"))
    series = [(before, BEFORE), *([] if np.array_equal(before, after) else [(after, AFTER)])]
    step = len(x) // _MAX_DOTS + 1
    low, high = (float(v) for v in np.quantile(x, (0.002, 0.998)))
    margin = 0.03 * (high - low) or 1.0
    limit = data.reach([before, after], pair.sigma)
    with new_figure(*_PANEL, layout="constrained") as sheet:
        axes = sheet.add_subplot()
        _noise(axes, pair.sigma)
        for y, colour in series:
            axes.plot(x[::step], y[::step], ".", ms=4.0, mew=0, color=colour, alpha=0.25)
        for y, colour in series:
            bins = data.binned(x, y, pair.samples.block.to_numpy())
            _means(axes, bins, color=colour, lw=1.8, ms=5, elinewidth=1.6)
        axes.set(xlim=(low - margin, high + margin), ylim=(-limit, limit))
        axes.set_xlabel(display_name(pair.driver), parse_math=False)
        label = f"{display_name(pair.channel)} [{unit(pair.unit) or '1'}]"
        axes.set_ylabel(label, parse_math=False)
    return sheet


def draw_channel(diagnosis: Diagnosis, group: Sequence[Residual]) -> Figure:
    """Draw one channel against time in the flight that shows it best."""
    shown = data.clearest(group)
    limit = data.reach([shown.before, shown.after], shown.sigma)
    start, end = float(np.nanmin(shown.t)), float(np.nanmax(shown.t))
    lines = [(shown.before, BEFORE)]
    lines += [(shown.after, AFTER)] if corrected(diagnosis.residuals) else []
    with new_figure(*_PANEL, layout="constrained") as sheet:
        axes = sheet.add_subplot()
        _noise(axes, shown.sigma)
        for finding in diagnosis.prechecks:
            if finding.flight == shown.flight and data.spans(finding):
                ends = finding.start_s, finding.end_s
                axes.axvspan(*ends, color=LOG_FAULT, alpha=0.2, lw=0, zorder=0)
        for values, colour in lines:
            axes.plot(shown.t, data.broken_at_gaps(shown.t, values), color=colour, lw=1.0)
        axes.set(xlim=(start, max(end, start + 1.0)), ylim=(-limit, limit))
        axes.set_xlabel(f"time [s], {shown.flight}", parse_math=False, labelpad=2)
        name = f"{display_name(shown.channel)}\n[{unit(shown.unit) or '1'}]"
        axes.set_ylabel(name, parse_math=False)
    return sheet


def draw_dependence(leftover: Leftover, followed: Dependence) -> Figure:
    """Draw the means of a leftover in slices of a variable that it follows."""
    flights = [s for s in leftover.samples if s.quantity == followed.quantity]
    x = np.concatenate([s.state[followed.variable] for s in flights])
    values = np.vstack([s.map if followed.frame == "map" else s.body for s in flights])
    # Samples of two seconds count as one.
    stretches = [np.floor(s.state["t"] / 2.0).astype(np.int64) for s in flights]
    first = np.cumsum([0, *(int(b.max()) + 1 for b in stretches)])
    block = np.concatenate([b + k for b, k in zip(stretches, first[:-1], strict=True)])
    colours = (style.VERMILLION, style.GREEN, style.BLUE)
    with new_figure(*_PANEL, layout="constrained") as sheet:
        axes = sheet.add_subplot()
        axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)
        for axis, colour, y in zip("xyz", colours, values.T, strict=True):
            if np.isfinite(y).all():
                bins = data.binned(x, y, block)
                label = f"{followed.frame} {axis}"
                _means(axes, bins, color=colour, lw=1.4, ms=3, elinewidth=0.9, label=label)
        axes.legend(loc="best", ncols=3, fontsize=7)
        variable = VARIABLES[followed.variable]
        axes.set_xlabel(f"{variable.text} [{variable.unit}]")
        axes.set_ylabel(f"{followed.quantity} left over [{LEFTOVER_UNITS[followed.quantity]}]")
    return sheet


def _means(axes: Axes, bins: pd.DataFrame, **look: Any) -> None:
    x, mean, half = bins[["x", "mean", "half"]].to_numpy().T
    axes.errorbar(x, mean, yerr=np.nan_to_num(half), marker="o", **look)


def _noise(axes: Axes, sigma: float) -> None:
    if math.isfinite(sigma):
        axes.axhspan(-2.0 * sigma, 2.0 * sigma, color=style.FAINT, alpha=0.7, lw=0, zorder=0)
    axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)
