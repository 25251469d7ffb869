"""The picture of a design: each figure of all candidates against the thrust margin."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_flight.report import style
from tombo_flight.report.style import new_figure
from tombo_propeller.design.design import Design
from tombo_propeller.design.flight_check import Recommendation
from tombo_propeller.design.request import MEASURED, NAMES, QUANTITIES, Criterion
from tombo_propeller.design.summary_text import headline, vehicle_and_limits

_TIERS: Final = (  # label, marker, size, opacity, colour; those drawn last lie on top
    (2, "outside of what was tested", ".", 2.6, 0.35, style.SKY),
    (1, "within what was tested", ".", 5.0, 0.9, style.BLUE),
    (0, "measured, with its Conf.", "o", 6.5, 1.0, style.ORANGE),
)


def draw_candidates(design: Design, recommendation: Recommendation) -> Figure:
    """Draw each figure against the thrust margin, with the limits."""
    with new_figure(11.0, 8.0, 150, layout="constrained") as sheet:
        grid = sheet.subplots(2, 2, sharex=True)
        for axes, quantity in zip(grid.flat, QUANTITIES[1:], strict=True):
            _draw_figure(axes, design, recommendation, quantity)
        for axes in grid[1]:
            axes.set_xlabel("thrust margin, modelled")
        sheet.suptitle(
            f"{headline(design, recommendation)}\n{vehicle_and_limits(design)}",
            x=0.01, ha="left", weight="bold", size=10.5, parse_math=False, wrap=True,
        )  # fmt: skip
        lines = grid.flat[-1].get_lines()
        sheet.legend(
            handles=[line for line in lines if not str(line.get_label()).startswith("_")],
            loc="outside lower center", ncols=6,
        )  # fmt: skip
    return sheet


def _draw_figure(
    axes: Axes, design: Design, recommendation: Recommendation, quantity: Criterion
) -> None:
    evaluated = design.evaluated
    x, y = evaluated.value[:, 0], evaluated.value[:, NAMES.index(quantity.name)]
    for tier, label, marker, size, alpha, colour in _TIERS:
        here = evaluated.tier == tier
        axes.plot(x[here], y[here], ls="", marker=marker, ms=size, mew=0, color=colour,
                  alpha=alpha, label=label)  # fmt: skip
    for index in np.flatnonzero(evaluated.tier == 0):
        if np.isfinite(y[index]):
            axes.annotate(
                str(evaluated.configurations[index].number), (x[index], y[index]), (5, 5),
                textcoords="offset points", fontsize=7.5,
            )  # fmt: skip
    for limit in design.choice.limits:
        if limit.quantity == QUANTITIES[0]:
            axes.axvline(limit.value, color=style.INK, lw=1.1, ls="--", label="limit")
        elif limit.quantity == quantity:
            axes.axhline(limit.value, color=style.INK, lw=1.1, ls="--")
    marks = [(i, "x", style.VERMILLION, "fails in flight") for i, _ in recommendation.failed[:1]]
    marks += [(i, "x", style.VERMILLION, "_") for i, _ in recommendation.failed[1:]]
    if recommendation.index is not None:
        marks.append((recommendation.index, "o", style.GREEN, "recommended"))
    for index, marker, colour, label in marks:
        axes.plot(x[index], y[index], ls="", marker=marker, ms=13, mew=2.3, mfc="none",
                  color=colour, label=label)  # fmt: skip
    where = "at 2000 rpm" if quantity.name in MEASURED else "in hover, modelled"
    unit = f" [{quantity.unit}]" if quantity.unit else ""
    axes.set_ylabel(f"{quantity.label} {where}{unit}")
