"""Figures of a diagnosis: residuals against time and driver, and the summary in one picture."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from functools import partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from tombo_diagnosis.diagnosis import VARIABLES, Cause, Dependence, Diagnosis, Leftover, Residual
from tombo_diagnosis.report import residual_data as data
from tombo_diagnosis.report.residual_data import Pair, corrected
from tombo_diagnosis.report.words import (
    LABELS,
    LEFTOVER_UNITS,
    STYLES,
    best_gains,
    headline,
    leading,
)
from tombo_diagnosis.wording import certainty, display_name, interval, percent, unit
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
_MAX_POINTS: Final = 900
"""Of a line against time."""


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


def draw_dependence(leftover: Leftover, followed: Dependence) -> Figure:
    """Draw the means of a leftover in slices of a variable that it follows, for a page."""
    flights = [s for s in leftover.samples if s.quantity == followed.quantity]
    x = np.concatenate([s.state[followed.variable] for s in flights])
    values = np.vstack([s.map if followed.frame == "map" else s.body for s in flights])
    # Samples of two seconds count as one.
    stretches = [np.floor(s.state["t"] / 2.0).astype(np.int64) for s in flights]
    first = np.cumsum([0, *(int(b.max()) + 1 for b in stretches)])
    block = np.concatenate([b + k for b, k in zip(stretches, first[:-1], strict=True)])

    def draw(axes: Axes) -> None:
        axes.axhline(0.0, color=style.MUTED, lw=0.7, zorder=1)
        colours = (style.VERMILLION, style.GREEN, style.BLUE)
        for axis, colour, y in zip("xyz", colours, values.T, strict=True):
            if np.isfinite(y).all():
                bins = data.binned(x, y, block)
                axes.errorbar(
                    bins.x, bins.mean, yerr=np.nan_to_num(bins.half), color=colour, lw=1.4,
                    marker="o", ms=3, elinewidth=0.9, label=f"{followed.frame} {axis}",
                )  # fmt: skip
        axes.legend(loc="best", ncols=3, fontsize=7)
        variable = VARIABLES[followed.variable]
        axes.set_xlabel(f"{variable.text} [{variable.unit}]")
        axes.set_ylabel(f"{followed.quantity} left over [{LEFTOVER_UNITS[followed.quantity]}]")

    return _panel(draw)


def time_axes(axes: Axes, diagnosis: Diagnosis, group: Sequence[Residual]) -> None:
    """Draw one channel against time into axes."""
    shown = data.clearest(group)
    zero = data.zero_s(diagnosis, shown.flight)
    residual_marks(axes, diagnosis, shown, zero)
    limit = data.reach([shown.before, shown.after], 2.5 * shown.sigma)
    start, end = float(np.nanmin(shown.t)) - zero, float(np.nanmax(shown.t)) - zero
    axes.set(xlim=(start, max(end, start + 1.0)), ylim=(-limit, limit))
    axes.set_xlabel(f"time [s], {shown.flight}", parse_math=False, labelpad=2)
    name = f"{display_name(shown.channel)}\n[{unit(shown.unit) or '1'}]"
    axes.set_ylabel(name, parse_math=False)


def residual_marks(axes: Axes, diagnosis: Diagnosis, residual: Residual, zero_s: float) -> None:
    """Draw a residual against time: noise, findings of the checks, lines before and after."""
    _noise(axes, residual.sigma)
    for finding in diagnosis.prechecks:
        if finding.flight == residual.flight and data.spans(finding):
            ends = finding.start_s - zero_s, finding.end_s - zero_s
            axes.axvspan(*ends, color=LOG_FAULT, alpha=0.2, lw=0, zorder=0)
    changed = corrected([residual])
    same = not changed and corrected(diagnosis.residuals)
    drawn = [(residual.before, UNCHANGED if same else BEFORE)]
    drawn += [(residual.after, AFTER)] if changed else []
    for values, colour in drawn:
        for t, y in data.runs(residual.t - zero_s, values, _MAX_POINTS):
            axes.plot(t, y, color=colour, lw=1.0)


def pair_axes(axes: Axes, pair: Pair, dot: float = 2.6, points: int = 1000) -> None:
    """Draw one channel against one driver into axes, `points` samples as dots of size `dot`."""
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
    """Draw errors as bars, in per cent of the error before."""
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


_COLOURS: Final = {"good": style.GREEN, "warn": "#B07A00", "bad": style.VERMILLION}
_LEFT, _MIDDLE, _TEXT = 0.065, 0.62, 0.665
_CAUSE_HEIGHT: Final = 0.14
_LEAST_GAIN: Final = 0.05
"""A channel that gained less is not shown."""


def draw_summary(diagnosis: Diagnosis) -> Figure:
    """Draw the residual against its driver and time, next to verdict and gain; 1600 x 900 px."""
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
    if shown:  # its name is next to the picture above
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
