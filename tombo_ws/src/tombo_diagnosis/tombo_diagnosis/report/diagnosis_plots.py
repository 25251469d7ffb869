"""The plots of a diagnosis as figures for a paper or a talk: residuals, drivers, gains."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tombo_diagnosis.diagnosis import Diagnosis, Residual
from tombo_diagnosis.report import diagnosis_plot_data as data
from tombo_diagnosis.report.diagnosis_plot_data import Pair, corrected
from tombo_diagnosis.report.diagnosis_text import headline
from tombo_diagnosis.wording import display_name, figure, percent, unit
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import Gain
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

BEFORE: Final = style.VERMILLION
AFTER: Final = style.BLUE
SAME: Final = style.UNCHANGED
"""A residual that is the same before and after."""
APART: Final = style.PURPLE
"""Fault or doubt in the log."""
_DPI: Final = 150
_MOST_ROWS: Final = 8
_WIDEST: Final = 115.0
"""How far a bar may reach, per cent."""


def draw_residuals(diagnosis: Diagnosis) -> Figure:
    """Draw every channel against time, in the flight that shows it best."""
    groups = list(data.by_channel(diagnosis.residuals).values())[:_MOST_ROWS]
    marks = [partial(time_axes, diagnosis=diagnosis, group=group) for group in groups]
    return _figure(diagnosis, "residuals against time", marks, (10.0, 1.75), 1)


def draw_drivers(diagnosis: Diagnosis) -> Figure:
    """Draw residuals against what drives them, with means in slices."""
    marks = [partial(pair_axes, pair=pair) for pair in data.pairs(diagnosis, 6)]
    title = "residuals against what drives them, all flights"
    return _figure(diagnosis, title, marks, (5.0, 3.4), min(2, len(marks)))


def draw_gains(diagnosis: Diagnosis) -> Figure:
    """Draw the prediction error on held-out flights before and after."""
    groups = [
        [g for g in diagnosis.gain if g.horizon == horizon]
        for horizon in dict.fromkeys(g.horizon for g in diagnosis.gain)
    ]
    marks = [partial(gain_axes, group=group) for group in groups]
    rows = max((len(group) for group in groups), default=1)
    title = "prediction error on held-out flights"
    return _figure(diagnosis, title, marks, (8.0, 0.8 + 0.32 * rows), 1, keyed=False)


def time_axes(axes: Axes, diagnosis: Diagnosis, group: Sequence[Residual]) -> None:
    """Draw one channel against time into axes."""
    one = data.clearest(group)
    start, end = data.stretch(one)
    zero = data.zero_s(diagnosis, one.flight)
    inside = (one.t >= start) & (one.t <= end)
    t, before, after = one.t[inside] - zero, one.before[inside], one.after[inside]
    residual_marks(axes, diagnosis, replace(one, t=t, before=before, after=after), 900, zero)
    limit = data.reach([before, after], 2.5 * one.sigma)
    axes.set(xlim=(start - zero, max(end, start + 1e-3) - zero), ylim=(-limit, limit))
    axes.set_xlabel(f"time [s], {one.flight}", parse_math=False, labelpad=2)
    axes.set_ylabel(f"{display_name(one.channel)}\n[{unit(one.unit) or '1'}]", parse_math=False)


def small_axes(
    axes: Axes, diagnosis: Diagnosis, residual: Residual, limit: float, buckets: int
) -> None:
    """Draw a whole residual against time into axes without words, up to `limit`."""
    axes.set_axis_off()
    residual_marks(axes, diagnosis, residual, buckets)
    axes.set(xlim=data.ends(residual.t), ylim=(-limit, limit))


def residual_marks(
    axes: Axes, diagnosis: Diagnosis, residual: Residual, buckets: int, zero_s: float = 0.0
) -> None:
    """Draw a residual against time: noise, what the checks found, lines before and after."""
    _noise(axes, residual.sigma)
    for finding in diagnosis.prechecks:
        if finding.flight == residual.flight and data.spans(finding):
            ends = finding.start_s - zero_s, finding.end_s - zero_s
            axes.axvspan(*ends, color=APART, alpha=0.2, lw=0, zorder=0)
    here = corrected([residual])
    same = not here and corrected(diagnosis.residuals)
    _lines(axes, residual.t, residual.before, SAME if same else BEFORE, buckets)
    if here:
        _lines(axes, residual.t, residual.after, AFTER, buckets)


def pair_axes(axes: Axes, pair: Pair, dot: float = 2.6, points: int = 1000) -> None:
    """Draw one channel against one driver into axes: so many samples as dots, size in points."""
    _noise(axes, pair.sigma)
    colours = {"before": BEFORE, "after": AFTER}
    for name, y in pair.series:
        shown = data.thinned(pair.x, y, points)
        axes.plot(*shown, ".", ms=dot, mew=0, color=colours[name], alpha=0.25)
    for name, y in pair.series:
        bins = data.binned(pair.x, y, pair.block)
        axes.errorbar(
            bins.x, bins.mean, yerr=np.nan_to_num(bins.half), color=colours[name], lw=1.8,
            marker="o", ms=5, elinewidth=1.6,
        )  # fmt: skip
    axes.set(xlim=pair.span, ylim=(-pair.limit, pair.limit))
    axes.set_xlabel(display_name(pair.driver), parse_math=False)
    axes.set_ylabel(f"{display_name(pair.channel)} [{unit(pair.unit) or '1'}]", parse_math=False)


def gain_axes(axes: Axes, group: Sequence[Gain], *, values: bool = True) -> None:
    """Draw errors as bars: what is left in per cent of what was, and the `values` beside it."""
    rows = np.arange(len(group))[::-1]
    axes.axvline(100.0, color=BEFORE, lw=2.0)
    for row, gain in zip(rows, group, strict=True):
        left = 100.0 * (1.0 - gain.reduction)
        if not math.isfinite(left):
            continue
        axes.barh(row, 100.0, height=0.62, color=BEFORE, alpha=0.18, lw=0)
        axes.barh(row, min(left, _WIDEST), height=0.62, color=AFTER, lw=0)
        if math.isfinite(gain.low) and math.isfinite(gain.high):
            ends = [min(100.0 * (1.0 - end), _WIDEST) for end in (gain.high, gain.low)]
            axes.plot(ends, (row, row), color=style.INK, lw=1.6, solid_capstyle="butt")
        text = f"{'−' if gain.reduction >= 0.0 else '+'}{percent(abs(gain.reduction))}"
        axes.text(_WIDEST + 2.0, row, text, va="center", weight="bold")
        if values:
            beside = f"{figure(gain.before)} → {figure(gain.after)} {unit(gain.unit)}"
            at = _WIDEST + 22.0
            axes.text(at, row, beside, va="center", color=style.MUTED, parse_math=False)
    axes.set_yticks(rows, [display_name(g.channel) for g in group], parse_math=False)
    axes.set(xlim=(0.0, _WIDEST + (75.0 if values else 40.0)), ylim=(-0.6, len(group) - 0.4))
    axes.set_xticks([0, 25, 50, 75, 100])
    axes.set_xlabel(f"error left, % of that before ({group[0].horizon})", loc="left")
    axes.grid(visible=False)
    axes.spines["bottom"].set_bounds(0.0, _WIDEST)
    axes.tick_params(left=False)


def keys(extended: bool, *, same: bool = False) -> list[Line2D | Patch]:
    """Return what the colours mean, for a legend."""
    named = [("before" if extended else "residual", BEFORE)]
    named += [("after", AFTER)] if extended else []
    named += [("the same before and after", SAME)] if same else []
    lines = [Line2D([], [], color=colour, lw=2.5, label=name) for name, colour in named]
    return [*lines, Patch(color=style.FAINT, label="±2σ of measurement noise")]


def _noise(axes: Axes, sigma: float) -> None:
    if math.isfinite(sigma):
        axes.axhspan(-2.0 * sigma, 2.0 * sigma, color=style.FAINT, alpha=0.7, lw=0, zorder=0)
    axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)


def _lines(axes: Axes, t: Array, y: Array, colour: str, buckets: int) -> None:
    for a, b in data.runs(t, y, buckets):
        axes.plot(a, b, color=colour, lw=1.0)


def _figure(
    diagnosis: Diagnosis,
    title: str,
    marks: Sequence[Callable[[Axes], None]],
    size_in: tuple[float, float],
    columns: int,
    *,
    keyed: bool = True,
) -> Figure:
    """Make a figure of equal axes; without any, with the words "nothing to show"."""
    columns = max(columns, 1)
    rows = max(1, -(-len(marks) // columns))
    size = (max(size_in[0] * columns, 8.0), size_in[1] * rows + 0.8)
    with new_figure(*size, _DPI, layout="constrained") as sheet:
        sheet.suptitle(
            f"{headline(diagnosis)}: {title}", x=0.01, ha="left", weight="bold", size=11,
            parse_math=False, wrap=True,
        )  # fmt: skip
        for k, mark in enumerate(marks):
            mark(sheet.add_subplot(rows, columns, k + 1))
        if not marks:
            sheet.text(0.5, 0.4, "nothing to show", ha="center", color=style.MUTED)
        elif keyed:
            extended = corrected(diagnosis.residuals)
            some = any(not corrected([r]) for r in diagnosis.residuals)
            handles = keys(extended, same=extended and some and columns == 1)
            sheet.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return sheet
