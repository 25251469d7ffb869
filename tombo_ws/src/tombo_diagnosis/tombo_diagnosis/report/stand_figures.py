"""Figures of a stand diagnosis: residuals over speed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from tombo_diagnosis.wording import display_name
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import CHANNELS
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.problem import StandProblem
    from tombo_dynamics.arrays import Array

_UNITS: Final = {
    "thrust": ("N", 1.0), "torque": ("mN m", 1e3), "beta": ("deg", 180.0 / math.pi),
    "reference_speed": ("rpm", 1.0 / RPM),
}  # fmt: skip
_COLOURS: Final = (
    style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE, style.SKY, style.MUTED,
    style.INK,
)  # fmt: skip


def draw_residuals(stand: StandDiagnosis) -> Figure:
    """Draw measured minus model over speed, before and after, a row for each channel."""
    problem = stand.findings.problem
    points = problem.points
    before = problem.residual(problem.final(problem.null_hypothesis))
    after = problem.unexplained(stand.findings.search.best.fit)
    channels = [c for c in points.measured if problem.seen[:, c].any()]
    with new_figure(9.6, 0.7 + 2.5 * len(channels), 100, layout="constrained") as figure:
        axes = figure.subplots(len(channels), 2, squeeze=False, sharex="col", sharey="row")
        for row, c in zip(axes, channels, strict=True):
            unit, factor = _UNITS[CHANNELS[c]]
            sides = ((before, "as it was"), (after, "with what was found"))
            for axis, (left, words) in zip(row, sides, strict=True):
                _scatter(axis, problem, left[:, c] * factor, c)
                sigma = float(np.median(points.sigma[problem.seen[:, c], c])) * factor
                axis.axhspan(-2.0 * sigma, 2.0 * sigma, color=style.FAINT, alpha=0.7, zorder=0)
                axis.axhline(0.0, color=style.MUTED, linewidth=0.7)
                axis.set_title(f"{display_name(CHANNELS[c])}, model {words}", loc="left")
            row[0].set_ylabel(f"measured less model [{unit}]")
        for axis in axes[-1]:
            axis.set_xlabel("speed [rpm]")
        if len(points.propellers) > 1:
            axes[0][0].legend(fontsize=7, ncols=2)
    return figure


def _scatter(axis: Any, problem: StandProblem, values: Array, c: int) -> None:
    setup = problem.points.setup
    for p, name in enumerate(problem.points.propellers):
        rows = (setup.propeller == p) & problem.seen[:, c]
        axis.plot(
            setup.speed[rows] / RPM, values[rows], "o", markersize=3.2,
            color=_COLOURS[p % len(_COLOURS)], label=name,
        )  # fmt: skip
