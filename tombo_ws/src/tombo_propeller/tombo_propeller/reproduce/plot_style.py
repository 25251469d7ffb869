"""What the figures of the reproduction share: paper, colours, curves over speed."""

from __future__ import annotations

from functools import lru_cache
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM, Operation, configuration, evaluate, valid_speed
from tombo_flight.report import style

LAW_COLOURS: Final = {
    "published": style.VERMILLION,
    "repaired": style.BLUE,
    "consistent": style.GREEN,
}
LAW_MARKS: Final = {"published": "o", "repaired": "s", "consistent": "D"}
CONF_COLOURS: Final = {0: style.MUTED, 1: style.ORANGE, 2: style.PURPLE, 3: style.SKY}
MEASURED: Final = style.INK
DPI: Final = 140
RC: Final = {**style.RC, "font.size": 10.0, "legend.fontsize": 9.0, "lines.linewidth": 1.7}
TOP_RPM: Final = 18000.0
styled: Final = mpl.rc_context(RC)
"""Decorates what draws a whole figure."""


def sheet(
    title: str, rows: int, columns: int, size_in: tuple[float, float], *, share_y: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure with a title that tells its finding, and its axes row by row."""
    figure = Figure(figsize=size_in, dpi=DPI, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", weight="bold", size=12.5, parse_math=False)
    grid = figure.subplots(rows, columns, squeeze=False, sharey="row" if share_y else "none")
    return figure, [axes for row in grid for axes in row]


@lru_cache(maxsize=64)
def curve(conf: int, law: str, low_rpm: float, high_rpm: float) -> tuple[Array, Operation]:
    """Return speeds [rpm] and operating points between them, as far as the law is valid."""
    chosen = configuration(conf)
    top = min(high_rpm, valid_speed(chosen, law) / RPM)
    rpm: Array = np.linspace(low_rpm, top, 361, dtype=np.float64)
    return rpm, evaluate(chosen, rpm * RPM, law, outside="mask")


def heading(axes: Axes, text: str) -> None:
    """Put the finding of a panel above it."""
    axes.set_title(text, loc="left", size=10.5, weight="bold", parse_math=False)


def legend_below(figure: Figure, axes: Axes) -> None:
    """Explain one panel's lines in a row below the whole figure."""
    handles, labels = axes.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))


def name_of(conf: int) -> str:
    """Return how a configuration is named in legends."""
    return "Conf. 0, rigid" if conf == 0 else f"Conf. {conf}"


def over_speed(axes: Axes, low_rpm: float = 0.0, high_rpm: float = TOP_RPM) -> None:
    """Label the axis of speed."""
    axes.set_xlim(low_rpm, high_rpm)
    axes.set_xlabel("speed [1000 rpm]")
    step = 4000.0 if high_rpm > 10000.0 else 400.0
    ticks = np.arange(low_rpm, high_rpm + 1.0, step)
    axes.set_xticks(ticks, [f"{t / 1000.0:g}" for t in ticks])
