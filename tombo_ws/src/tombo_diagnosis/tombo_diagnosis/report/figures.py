"""Figures of a diagnosis: residuals against time and driver, and the summary in one picture."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tombo_diagnosis.diagnosis import Cause, Diagnosis, Residual
from tombo_diagnosis.report import residual_data as data
from tombo_diagnosis.report.residual_data import Pair, corrected
from tombo_diagnosis.report.words import LABELS, STYLES, best_gains, headline, leading
from tombo_diagnosis.wording import certainty, display_name, interval, percent, unit
from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import FittedParameter, Gain
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

BEFORE: Final = style.VERMILLION
AFTER: Final = style.BLUE
UNCHANGED: Final = style.UNCHANGED
"""A residual that is the same before and after."""
LOG_FAULT: Final = style.PURPLE
"""Fault or doubt in the log."""
_WIDEST: Final = 115.0
"""How far a bar may reach, per cent."""
_PANEL_IN: Final = (4.8, 2.75)
_SMALL_IN: Final = (2.2, 0.8)


def draw_pair(pair: Pair) -> Figure:
    """Draw one channel against one driver, for a page."""
    return _panel(partial(pair_axes, pair=pair, dot=4.0, points=700))


def draw_channel(diagnosis: Diagnosis, group: Sequence[Residual]) -> Figure:
    """Draw one channel against time in the flight that shows it best, for a page."""
    return _panel(partial(time_axes, diagnosis=diagnosis, group=group))


def _panel(draw: Callable[[Axes], None]) -> Figure:
    with new_figure(*_PANEL_IN, 100, 8.5, layout="constrained") as sheet:
        draw(sheet.add_subplot())
    return sheet


class SmallFigures:
    """Whole residuals against time without words, all on one sheet: making it takes longest."""

    def __init__(self, diagnosis: Diagnosis, buckets: int) -> None:
        self.diagnosis, self.buckets = diagnosis, buckets
        with new_figure(*_SMALL_IN, 100) as self.sheet:
            self.axes = self.sheet.add_axes((0.005, 0.01, 0.99, 0.98))
            self.axes.set_axis_off()

    def draw(self, residual: Residual, limit: float) -> Figure:
        """Draw one up to `limit`, in place of the one before."""
        for mark in (*self.axes.lines, *self.axes.patches):
            mark.remove()
        with mpl.rc_context(style.RC):
            residual_marks(self.axes, self.diagnosis, residual, self.buckets)
        self.axes.set(xlim=data.ends(residual.t), ylim=(-limit, limit))
        return self.sheet


def time_axes(axes: Axes, diagnosis: Diagnosis, group: Sequence[Residual]) -> None:
    """Draw one channel against time into axes."""
    shown = data.clearest(group)
    start, end = data.stretch(shown)
    zero = data.zero_s(diagnosis, shown.flight)
    inside = (shown.t >= start) & (shown.t <= end)
    t, before, after = shown.t[inside] - zero, shown.before[inside], shown.after[inside]
    residual_marks(axes, diagnosis, replace(shown, t=t, before=before, after=after), 900, zero)
    limit = data.reach([before, after], 2.5 * shown.sigma)
    axes.set(xlim=(start - zero, max(end, start + 1e-3) - zero), ylim=(-limit, limit))
    axes.set_xlabel(f"time [s], {shown.flight}", parse_math=False, labelpad=2)
    name = f"{display_name(shown.channel)}\n[{unit(shown.unit) or '1'}]"
    axes.set_ylabel(name, parse_math=False)


def residual_marks(
    axes: Axes, diagnosis: Diagnosis, residual: Residual, buckets: int, zero_s: float = 0.0
) -> None:
    """Draw a residual against time: noise, what the checks found, lines before and after."""
    _noise(axes, residual.sigma)
    for finding in diagnosis.prechecks:
        if finding.flight == residual.flight and data.spans(finding):
            ends = finding.start_s - zero_s, finding.end_s - zero_s
            axes.axvspan(*ends, color=LOG_FAULT, alpha=0.2, lw=0, zorder=0)
    changed = corrected([residual])
    same = not changed and corrected(diagnosis.residuals)
    _lines(axes, residual.t, residual.before, UNCHANGED if same else BEFORE, buckets)
    if changed:
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


def gain_axes(axes: Axes, group: Sequence[Gain]) -> None:
    """Draw errors as bars: what is left, in per cent of what was."""
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
    axes.set_yticks(rows, [display_name(g.channel) for g in group], parse_math=False)
    axes.set(xlim=(0.0, _WIDEST + 40.0), ylim=(-0.6, len(group) - 0.4))
    axes.set_xticks([0, 25, 50, 75, 100])
    axes.set_xlabel("% of the error left, held out", loc="left")
    axes.grid(visible=False)
    axes.spines["bottom"].set_bounds(0.0, _WIDEST)
    axes.tick_params(left=False)


def _legend_handles(extended: bool) -> list[Line2D | Patch]:
    named = [("before" if extended else "residual", BEFORE)]
    named += [("after", AFTER)] if extended else []
    lines = [Line2D([], [], color=colour, lw=2.5, label=name) for name, colour in named]
    return [*lines, Patch(color=style.FAINT, label="±2σ of measurement noise")]


def _noise(axes: Axes, sigma: float) -> None:
    if math.isfinite(sigma):
        axes.axhspan(-2.0 * sigma, 2.0 * sigma, color=style.FAINT, alpha=0.7, lw=0, zorder=0)
    axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)


def _lines(axes: Axes, t: Array, y: Array, colour: str, buckets: int) -> None:
    for a, b in data.runs(t, y, buckets):
        axes.plot(a, b, color=colour, lw=1.0)


_COLOURS: Final = {"good": style.GREEN, "warn": "#B07A00", "bad": style.VERMILLION}
_LEFT, _MIDDLE, _TEXT = 0.065, 0.62, 0.665
_CAUSE_HEIGHT: Final = 0.14
_LEAST_GAIN: Final = 0.05
"""A channel that gained less is not shown."""


def draw_summary(diagnosis: Diagnosis) -> Figure:
    """Draw the residual against its driver and time, beside verdict and gain; 1600 x 900 px."""
    with new_figure(16.0, 9.0, 100, 13.0) as sheet:
        gains = [g for g in best_gains(diagnosis, 5) if g.reduction >= _LEAST_GAIN]
        height = 0.03 + 0.055 * len(gains)
        _summary_words(sheet, diagnosis, 0.085 + height if gains else 0.0)
        _summary_residual(sheet, diagnosis)
        if gains:
            axes = sheet.add_axes((0.79, 0.085, 0.2, height))
            gain_axes(axes, gains)
    return sheet


def _summary_residual(sheet: Figure, diagnosis: Diagnosis) -> None:
    groups = data.by_channel(diagnosis.residuals)
    if not groups:
        return
    shown = data.pairs(diagnosis, 1)
    channel = shown[0].channel if shown else next(iter(groups))
    if shown:
        pair_axes(sheet.add_axes((_LEFT, 0.36, _MIDDLE - _LEFT, 0.41)), shown[0], 5.0)
    height = 0.17 if shown else 0.6
    below = sheet.add_axes((_LEFT, 0.085, _MIDDLE - _LEFT, height))
    time_axes(below, diagnosis, groups[channel])
    if shown:  # its name stands beside the picture above
        below.set_ylabel(f"[{unit(shown[0].unit) or '1'}]", parse_math=False)
    handles = _legend_handles(corrected(groups[channel]))
    sheet.legend(handles=handles, loc="lower left", bbox_to_anchor=(_LEFT - 0.008, 0.775), ncols=3)


def _summary_words(sheet: Figure, diagnosis: Diagnosis, lowest: float) -> None:
    colour = _COLOURS[STYLES[diagnosis.verdict]]
    badge = f"{LABELS[diagnosis.verdict]}, {certainty(diagnosis.confidence)}"
    sheet.text(_LEFT, 0.948, badge.upper(), color=colour, weight="bold", va="center")
    large = headline(diagnosis)
    shown = textwrap.shorten(large, 110, placeholder=" …")
    height = 30 if len(large) < 56 else 19
    sheet.text(_LEFT, 0.885, shown, size=height, weight="bold", va="center", parse_math=False)
    y = 0.8
    lines = textwrap.wrap(diagnosis.summary, 48, max_lines=7, placeholder=" …")
    sheet.text(_TEXT, y, "\n".join(lines), va="top", linespacing=1.45, parse_math=False)
    y -= 0.031 * len(lines) + 0.05
    for cause in leading(diagnosis)[:2]:
        if y - _CAUSE_HEIGHT < lowest:
            break
        for text, size, colour in _cause_lines(cause):
            weight = "bold" if size > 20.0 else "normal"
            sheet.text(_TEXT, y, text, size=size, va="top", color=colour, weight=weight,
                       parse_math=False)  # fmt: skip
            y -= 0.0024 * size
        y -= 0.02


def _cause_lines(cause: Cause) -> list[tuple[str, float, str]]:
    """Return the surest parameter of a cause in words: each line with size and colour."""
    if not cause.theta:
        return []
    surest = max(cause.theta, key=_deviation_in_widths)
    value, low, high = interval(surest)
    return [
        (f"{display_name(cause.effect)}, {surest.name}", 13.0, style.INK),
        (f"{value} {unit(surest.unit)}".strip(), 26.0, style.INK),
        (f"95 % interval {low} to {high}", 13.0, style.MUTED),
    ]


def _deviation_in_widths(fitted: FittedParameter) -> float:
    """Return how far a parameter is from its nominal value, in widths of its interval."""
    return abs(fitted.value - fitted.nominal) / max(fitted.high - fitted.low, 1e-12)
