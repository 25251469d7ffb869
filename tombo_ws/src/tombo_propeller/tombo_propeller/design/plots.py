"""The plots of a design: figures against thrust margin, and the regressors of the readings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_propeller.design.design import Design, costs, nondominated
from tombo_propeller.design.flight_check import Recommendation
from tombo_propeller.design.request import MEASURED, NAMES, QUANTITIES, Criterion
from tombo_propeller.design.summary_text import asked, headline

_COLOURS: Final = (style.SKY, style.BLUE, style.PURPLE, style.ORANGE, style.GREEN)
_DPI: Final = 150
_SHOWN: Final = QUANTITIES[1:]


def draw_pareto(design: Design, recommendation: Recommendation) -> Figure:
    """Draw each figure against the thrust margin: what was measured, what is predicted."""
    with mpl.rc_context(style.RC):
        sheet = Figure(figsize=(11.0, 8.0), dpi=_DPI, layout="constrained")
        FigureCanvasAgg(sheet)
        grid = sheet.subplots(2, 2, sharex=True)
        for axes, quantity in zip(grid.flat, _SHOWN, strict=True):
            _panel(axes, design, recommendation, quantity)
        for axes in grid[1]:
            axes.set_xlabel("thrust margin, modelled", labelpad=2)
        sheet.suptitle(
            f"{headline(design, recommendation)}\n{asked(design)}",
            x=0.01, ha="left", weight="bold", size=10.5, parse_math=False, wrap=True,
        )  # fmt: skip
        handles = _keys(design, recommendation)
        sheet.legend(handles=handles, loc="outside lower center", ncols=4)
    return sheet


def draw_readings(design: Design) -> Figure:
    """Draw the error of each regressor on readings left out, and that of their mean."""
    with mpl.rc_context(style.RC):
        sheet = Figure(figsize=(11.0, 3.4), dpi=_DPI, layout="constrained")
        FigureCanvasAgg(sheet)
        quantities = [q for q in QUANTITIES if q.name in MEASURED]
        used = [design.readings[q.name].regressor for q in quantities]
        for axes, quantity in zip(sheet.subplots(1, 3), quantities, strict=True):
            reading = design.readings[quantity.name]
            trials = reading.trials[::-1]
            better = [t.error < reading.mean_error for t in trials]
            colours = [style.BLUE if b else style.MUTED for b in better]
            axes.barh([t.regressor for t in trials], [t.error for t in trials], color=colours)
            axes.axvline(reading.mean_error, color=style.VERMILLION, lw=1.8)
            axes.set_xlabel(f"RMS error on readings left out [{quantity.unit}]")
            axes.set_title(f"{quantity.words} (p = {reading.chance:.2f})", loc="left")
            axes.grid(visible=False, axis="y")
        some = [u for u in used if u != "mean"]
        title = (
            f"Used as predictor: {', '.join(some)}"
            if some
            else "Nothing known of a nodus predicts readings left out better than their mean "
            "(line) by more than chance (p)"
        )
        sheet.suptitle(title, x=0.01, ha="left", weight="bold", size=10.5)
    return sheet


def _panel(
    axes: Axes, design: Design, recommendation: Recommendation, quantity: Criterion
) -> None:
    judged, column = design.judged, NAMES.index(quantity.name)
    x, y = judged.value[:, 0], judged.value[:, column]
    measured = judged.tier == 0
    for k, matrix in enumerate(_matrices(design)):
        colour = _COLOURS[k % len(_COLOURS)]
        here = np.array([c.nodus is not None and c.nodus.matrix.name == matrix
                         for c in judged.configurations])  # fmt: skip
        for tier, alpha, size in ((2, 0.35, 2.6), (1, 0.9, 4.5)):
            some = here & (judged.tier == tier)
            if quantity.name in MEASURED and tier == 2:
                continue
            axes.plot(x[some], y[some], ".", ms=size, mew=0, color=colour, alpha=alpha)
        axes.plot(x[here & measured], y[here & measured], "o", ms=6.5, color=colour, zorder=4)
    _front(axes, design, quantity)
    _interval(axes, design, quantity)
    _limits(axes, design, quantity)
    for index, _ in recommendation.failed:
        axes.plot(x[index], y[index], "x", ms=11, mew=2.2, color=style.VERMILLION, zorder=5)
    if (chosen := recommendation.index) is not None:
        axes.plot(x[chosen], y[chosen], "o", ms=15, mew=2.4, mfc="none", color=style.GREEN,
                  zorder=6)  # fmt: skip
    seen = measured & np.isfinite(x) & np.isfinite(y)
    names = [str(judged.configurations[i].number) for i in np.flatnonzero(seen)]
    _name_points(axes, x[seen], y[seen], names)
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    where = ", at 2000 rpm" if quantity.name in MEASURED else ", in hover, modelled"
    axes.set_ylabel(f"{quantity.words}{where}{unit}")
    axes.set_title(_finding(design, quantity), loc="left", fontsize=9)


def _name_points(axes: Axes, x: Array, y: Array, names: Sequence[str]) -> None:
    """Write names beside points, each at the first of eight places where no other name is."""
    scale = 72.0 / axes.figure.dpi
    points = scale * axes.transData.transform(np.stack((x, y), axis=1))
    taken: list[Array] = []
    for point, name in zip(points, names, strict=True):
        places = [np.array((dx, dy)) for dy in (9.0, -9.0, 19.0, -19.0) for dx in (9.0, -9.0)]
        free = (p for p in places if all(np.abs(point + p - t).max() > 9.0 for t in taken))
        offset = next(free, places[0])
        taken.append(point + offset)
        across, up = axes.transData.inverted().transform(point / scale)
        axes.annotate(
            name, (float(across), float(up)), (float(offset[0]), float(offset[1])), ha="center",
            va="center", textcoords="offset points", fontsize=7.5, zorder=7,
        )  # fmt: skip


def _matrices(design: Design) -> list[str]:
    names = (c.nodus.matrix.name for c in design.judged.configurations if c.nodus)
    return list(dict.fromkeys(names))


def _front(axes: Axes, design: Design, quantity: Criterion) -> None:
    """Draw the Pareto front of the two figures: of the measured ones, or of all if modelled."""
    judged = design.judged
    here = np.flatnonzero((judged.tier == 0) | (quantity.name not in MEASURED))
    columns = [0, NAMES.index(quantity.name)]
    some = here[nondominated(costs(judged.value[here])[:, columns])]
    some = some[np.argsort(judged.value[some, 0])]
    axes.plot(*judged.value[some][:, columns].T, color=style.INK, lw=1.0, alpha=0.6, zorder=3)


def _interval(axes: Axes, design: Design, quantity: Criterion) -> None:
    """Draw the mean of the readings and the interval of a prediction, if the mean is used."""
    reading = design.readings.get(quantity.name)
    if reading is None or reading.regressor != "mean" or not np.isfinite(reading.error):
        return
    reach = reading.error * reading.quantile(design.request.confidence)
    axes.axhspan(reading.mean - reach, reading.mean + reach, color=style.FAINT, alpha=0.55, lw=0,
                 zorder=0)  # fmt: skip
    axes.axhline(reading.mean, color=style.MUTED, lw=0.9, zorder=1)


def _limits(axes: Axes, design: Design, quantity: Criterion) -> None:
    for limit in design.choice.limits:
        if limit.quantity.name == NAMES[0]:
            axes.axvline(limit.value, color=style.INK, lw=1.1, ls="--")
        elif limit.quantity == quantity:
            axes.axhline(limit.value, color=style.INK, lw=1.1, ls="--")


def _finding(design: Design, quantity: Criterion) -> str:
    reading = design.readings.get(quantity.name)
    if reading is None:
        ratio = design.judged.value[:, NAMES.index(quantity.name)]
        ratio = ratio[np.isfinite(ratio)]
        span = f": {ratio.min():.2f} to {ratio.max():.2f}" if ratio.size else ""
        return f"{quantity.words.capitalize()} of all that lift the vehicle{span}"
    if not reading.trials:
        return "Too few readings to predict any"
    p = f"(p = {reading.rank_p_value:.2f})"
    if reading.regressor == "mean":
        return f"{quantity.words.capitalize()} does not follow stiffness {p}"
    return f"{quantity.words.capitalize()} follows {reading.regressor}"


def _keys(design: Design, recommendation: Recommendation) -> list[Line2D]:
    keys = [
        Line2D(
            [], [], ls="", marker="o", color=_COLOURS[k % len(_COLOURS)], label=f"{m}, measured"
        )
        for k, m in enumerate(_matrices(design))
    ]
    keys.append(Line2D([], [], ls="", marker=".", color=style.MUTED, label="predicted"))
    share = design.request.confidence
    keys.append(Line2D([], [], lw=7, color=style.FAINT, label=f"mean, {share:.0%} to each side"))
    keys.append(Line2D([], [], ls="--", color=style.INK, label="limit"))
    keys.append(Line2D([], [], lw=1.0, color=style.INK, alpha=0.6, label="Pareto front"))
    if recommendation.index is not None:
        keys.append(
            Line2D([], [], ls="", marker="o", ms=11, mew=2.2, mfc="none", color=style.GREEN,
                   label="recommended")
        )  # fmt: skip
    if recommendation.failed:
        keys.append(
            Line2D([], [], ls="", marker="x", ms=9, mew=2.2, color=style.VERMILLION,
                   label="fails in flight")
        )  # fmt: skip
    return keys
