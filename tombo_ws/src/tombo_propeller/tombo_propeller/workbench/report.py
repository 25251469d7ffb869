"""The workbench's report: a PDF of the curves, and of the design where there is one."""

from __future__ import annotations

import io
import textwrap
from typing import Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import PdfPages
from matplotlib.figure import Figure

from tombo_flight.report import style
from tombo_flight.version import tombo_version
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Recommendation
from tombo_propeller.design.plots import draw_pareto, draw_readings
from tombo_propeller.reproduce.plot_style import LAW_COLOURS, sheet, styled
from tombo_propeller.workbench.curves import PropellerCurves, SingleFigure, SpeedChart

_WIDE_IN: Final = (11.0, 13.0)


def report_pdf(
    curves: PropellerCurves, design: tuple[Design, Recommendation] | None = None
) -> bytes:
    """Return the report as a file."""
    figures = [draw_curves(curves)]
    if design is not None:
        figures += [draw_pareto(*design), draw_readings(design[0])]
    buffer = io.BytesIO()
    title = {"Title": curves.label, "Creator": f"tombo {tombo_version()}", "CreationDate": None}
    with mpl.rc_context(style.RC), PdfPages(buffer, metadata=title) as pages:
        for figure in figures:
            pages.savefig(figure)
    return buffer.getvalue()


@styled
def draw_curves(curves: PropellerCurves) -> Figure:
    """Draw every panel, with how its figure is known."""
    figure, axes = sheet(curves.label, 4, 2, _WIDE_IN)
    FigureCanvasAgg(figure)
    for at, panel in zip(axes, curves.panels, strict=False):
        _draw(at, panel, curves)
    last = axes[-1]
    last.set_axis_off()
    handles, labels = axes[0].get_legend_handles_labels()
    last.legend(handles, labels, loc="upper left", frameon=False)
    lines = [_line(f) for f in curves.figures]
    lines += [textwrap.fill(text, 60) for text in curves.refused.values()]
    last.text(0.0, 0.45, "\n".join(lines), va="top", size=8.5, transform=last.transAxes)
    return figure


def _line(figure: SingleFigure) -> str:
    digits = 0 if figure.unit == "rpm" else 2
    value = f"{figure.value:.{digits}f} {figure.unit}"
    return f"{figure.name}: {value}, {figure.beside} ({figure.known})"


def _draw(axes: Axes, panel: SpeedChart, curves: PropellerCurves) -> None:
    for curve in panel.curves:
        colour = LAW_COLOURS.get(curve.name, style.PURPLE)
        axes.plot(curves.rpm, curve.values, color=colour, label=curve.name or None)
        if curve.low is not None and curve.high is not None:
            axes.fill_between(curves.rpm, curve.low, curve.high, color=colour, alpha=0.16, lw=0)
    for reading in panel.readings:
        axes.errorbar(
            [reading.rpm], [reading.value], yerr=reading.deviation if reading.chosen else None,
            fmt="o", ms=5 if reading.chosen else 2.5, color=style.INK, capsize=2,
            alpha=1.0 if reading.chosen else 0.35,
        )  # fmt: skip
    axes.set_xlim(0.0, float(curves.rpm[-1]))
    axes.set_xlabel("speed [rpm]")
    axes.set_ylabel(f"{panel.title} [{panel.unit}]" if panel.unit else panel.title)
    axes.set_title(textwrap.fill(panel.known, 78), loc="left", fontsize=7.5, color=style.MUTED)
