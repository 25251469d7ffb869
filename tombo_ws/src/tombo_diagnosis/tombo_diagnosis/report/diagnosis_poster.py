"""One picture of a diagnosis: residual before and after, verdict, gain."""

from __future__ import annotations

import textwrap
from typing import Final

import matplotlib as mpl
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tombo_diagnosis.diagnosis import Cause, Diagnosis
from tombo_diagnosis.report.diagnosis_plot_data import by_channel, corrected, pairs
from tombo_diagnosis.report.diagnosis_plots import gain_axes, keys, pair_axes, time_axes
from tombo_diagnosis.report.diagnosis_text import CLASSES, LABELS, best_gains, headline, leading
from tombo_diagnosis.wording import certainty, display_name, interval, unit
from tombo_flight.extended_model import FittedParameter
from tombo_flight.report import style

SIZE_IN: Final = (16.0, 9.0)
DPI: Final = 100
_COLOURS: Final = {"good": style.GREEN, "warn": "#B07A00", "bad": style.VERMILLION}
_LEFT, _MIDDLE, _TEXT = 0.065, 0.62, 0.665
_CAUSE_HEIGHT: Final = 0.14
_WORTH: Final = 0.05
"""A channel that gained less is not shown."""


def diagnosis_poster(diagnosis: Diagnosis) -> Figure:
    """Draw the residual against its driver and time, beside verdict and gain; 1600 x 900 px."""
    with mpl.rc_context({**style.RC, "font.size": 13.0, "legend.fontsize": 12.0}):
        figure = Figure(figsize=SIZE_IN, dpi=DPI)
        FigureCanvasAgg(figure)
        gains = [g for g in best_gains(diagnosis, 5) if g.reduction >= _WORTH]
        height = 0.03 + 0.055 * len(gains)
        _words(figure, diagnosis, 0.085 + height if gains else 0.0)
        _gap(figure, diagnosis)
        if gains:
            axes = figure.add_axes((0.79, 0.085, 0.2, height))
            gain_axes(axes, gains, values=False)
            axes.set_xlabel("% of the error left, held out", loc="left")
    return figure


def _gap(figure: Figure, diagnosis: Diagnosis) -> None:
    groups = by_channel(diagnosis.residuals)
    if not groups:
        return
    shown = pairs(diagnosis, 1)
    channel = shown[0].channel if shown else next(iter(groups))
    if shown:
        pair_axes(figure.add_axes((_LEFT, 0.36, _MIDDLE - _LEFT, 0.41)), shown[0], 5.0)
    height = 0.17 if shown else 0.6
    below = figure.add_axes((_LEFT, 0.085, _MIDDLE - _LEFT, height))
    time_axes(below, diagnosis, groups[channel])
    if shown:  # its name stands beside the picture above
        below.set_ylabel(f"[{unit(shown[0].unit) or '1'}]", parse_math=False)
    handles = keys(corrected(groups[channel]))
    figure.legend(
        handles=handles, loc="lower left", bbox_to_anchor=(_LEFT - 0.008, 0.775), ncols=3
    )


def _words(figure: Figure, diagnosis: Diagnosis, lowest: float) -> None:
    colour = _COLOURS[CLASSES[diagnosis.verdict]]
    badge = f"{LABELS[diagnosis.verdict]}, {certainty(diagnosis.confidence)}"
    figure.text(_LEFT, 0.948, badge.upper(), color=colour, weight="bold", va="center")
    large = headline(diagnosis)
    shown = textwrap.shorten(large, 110, placeholder=" …")
    height = 30 if len(large) < 56 else 19
    figure.text(_LEFT, 0.885, shown, size=height, weight="bold", va="center", parse_math=False)
    y = 0.8
    lines = textwrap.wrap(diagnosis.summary, 48, max_lines=7, placeholder=" …")
    figure.text(_TEXT, y, "\n".join(lines), va="top", linespacing=1.45, parse_math=False)
    y -= 0.031 * len(lines) + 0.05
    for cause in leading(diagnosis)[:2]:
        if y - _CAUSE_HEIGHT < lowest:
            break
        for text, size, colour in _figures(cause):
            weight = "bold" if size > 20.0 else "normal"
            figure.text(_TEXT, y, text, size=size, va="top", color=colour, weight=weight,
                        parse_math=False)  # fmt: skip
            y -= 0.0024 * size
        y -= 0.02


def _figures(cause: Cause) -> list[tuple[str, float, str]]:
    """Return the surest parameter of a cause in words: each line with size and colour."""
    if not cause.theta:
        return []
    first = max(cause.theta, key=_sureness)
    value, low, high = interval(first)
    return [
        (f"{display_name(cause.effect)}, {first.name}", 13.0, style.INK),
        (f"{value} {unit(first.unit)}".strip(), 26.0, style.INK),
        (f"95 % interval {low} to {high}", 13.0, style.MUTED),
    ]


def _sureness(fitted: FittedParameter) -> float:
    """Return how far a parameter is from its nominal value, in widths of its interval."""
    return abs(fitted.value - fitted.nominal) / max(fitted.high - fitted.low, 1e-12)
