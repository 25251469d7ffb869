"""Figures of a stand diagnosis: residuals against speed, and against the nodus' stiffness."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM
from tombo_flight.report.figure import new_figure
from tombo_flight.report.style import BLUE, GREEN, INK, MUTED, ORANGE, PURPLE, SKY, VERMILLION

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis


_UNITS = {
    "thrust": ("N", 1.0), "torque": ("mN m", 1e3), "beta": ("deg", 180.0 / math.pi),
    "reference_speed": ("rpm", 1.0 / RPM),
}  # fmt: skip
_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, MUTED, INK)


def draw_residuals(found: StandDiagnosis, headline: str) -> Any:
    """Return measured minus model over speed, before and after, a row for each channel."""
    from tombo_dynamics.propeller.effects import CHANNELS

    problem = found.findings.problem
    points = problem.points
    before = problem.residual(problem.final(problem.null_hypothesis))
    after = problem.unexplained(found.findings.search.best.fit)
    channels = [c for c in points.measured if problem.seen[:, c].any()]
    with new_figure(9.6, 1.1 + 2.5 * len(channels), 100, layout="constrained") as figure:
        axes = figure.subplots(len(channels), 2, squeeze=False, sharex="col", sharey="row")
        for row, c in zip(axes, channels, strict=True):
            unit, factor = _UNITS[CHANNELS[c]]
            for axis, left, name in zip(row, (before, after), ("model", "extended"), strict=True):
                _scatter(axis, found, left[:, c] * factor, c)
                sigma = float(np.median(points.sigma[problem.seen[:, c], c])) * factor
                axis.axhspan(-2.0 * sigma, 2.0 * sigma, color="#E9EDF0", zorder=0)
                axis.axhline(0.0, color=MUTED, linewidth=0.7)
                words = "as it was" if name == "model" else "with what was found"
                axis.set_title(f"{CHANNELS[c].replace('_', ' ')}, model {words}", loc="left")
            row[0].set_ylabel(f"measured less model [{unit}]")
        for axis in axes[-1]:
            axis.set_xlabel("speed [rpm]")
        if len(points.propellers) > 1:
            axes[0][0].legend(fontsize=7, ncols=2)
        figure.suptitle(f"{headline}\ngrey: twice the noise of a point", x=0.01, ha="left")
    return figure


def draw_stiffness(found: StandDiagnosis) -> Any:
    """Return each propeller's mean residual of thrust over its nodus' modulus; None: no nodi."""
    problem = found.findings.problem
    points = problem.points
    soft = np.isfinite(points.stiffness)
    if soft.sum() < 2 or 0 not in points.measured:
        return None
    before = problem.residual(problem.final(problem.null_hypothesis))[:, 0]
    after = problem.residual(problem.final(found.findings.search.best.fit))[:, 0]
    with new_figure(6.4, 3.6, 100, layout="constrained") as figure:
        axis = figure.subplots()
        for left, colour, name in (
            (before, VERMILLION, "model as it was"),
            (after, BLUE, "with what was found"),
        ):
            x, y, low = [], [], []
            for p in np.flatnonzero(soft):
                own = (points.setup.propeller == p) & problem.seen[:, 0]
                if own.any():
                    x.append(points.stiffness[p])
                    y.append(left[own].mean())
                    error = points.sigma[own, 0].mean() / math.sqrt(own.sum())
                    low.append(2.0 * max(error, left[own].std() / math.sqrt(own.sum())))
            axis.errorbar(x, y, yerr=low, fmt="o", color=colour, capsize=3, label=name)
        axis.axhline(0.0, color=MUTED, linewidth=0.7)
        axis.set_xlabel("shear modulus of the nodus G_N [MPa]")
        axis.set_ylabel("thrust, measured less model [N]")
        axis.set_title("Mean over each propeller's points, bars 95 %", loc="left")
        axis.legend()
    return figure


def _scatter(axis: Any, found: StandDiagnosis, values: Array, c: int) -> None:
    problem = found.findings.problem
    points = problem.points
    for p, name in enumerate(points.propellers[:40]):
        own = (points.setup.propeller == p) & problem.seen[:, c]
        axis.plot(
            points.setup.speed[own] / RPM, values[own], "o", markersize=3.2,
            color=_COLOURS[p % len(_COLOURS)], label=name,
        )  # fmt: skip
