"""Figures of a stand diagnosis: residuals against speed, and against the nodus' stiffness."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tombo_bringup.report.style import (
    BLUE,
    GREEN,
    INK,
    MUTED,
    ORANGE,
    PURPLE,
    RC,
    SKY,
    VERMILLION,
)

if TYPE_CHECKING:
    from tombo_sysid.stand.diagnose import StandDiagnosis
    from tombo_sysid.stand.table3 import Table3

Array = NDArray[np.float64]

_RPM = 30.0 / math.pi
_UNITS = {
    "thrust": ("N", 1.0), "torque": ("mN m", 1e3), "beta": ("deg", 180.0 / math.pi),
    "reference_speed": ("rpm", _RPM),
}  # fmt: skip
_COLOURS = (BLUE, VERMILLION, GREEN, ORANGE, PURPLE, SKY, MUTED, INK)


def draw_residuals(found: StandDiagnosis, headline: str) -> Any:
    """Return measured minus model over speed, before and after, a row for each channel."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    from tombo_dynamics.propeller.effects import CHANNELS

    problem = found.findings.problem
    points = problem.points
    before = problem.residual(problem.final(problem.nothing))
    after = problem.residual(problem.final(found.findings.search.best.fit))
    channels = [c for c in points.measured if problem.seen[:, c].any()]
    with mpl.rc_context(RC):
        figure = Figure(figsize=(9.6, 1.1 + 2.5 * len(channels)), layout="constrained")
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
    import matplotlib as mpl
    from matplotlib.figure import Figure

    problem = found.findings.problem
    points = problem.points
    soft = np.isfinite(points.stiffness)
    if soft.sum() < 2 or 0 not in points.measured:
        return None
    before = problem.residual(problem.final(problem.nothing))[:, 0]
    after = problem.residual(problem.final(found.findings.search.best.fit))[:, 0]
    with mpl.rc_context(RC):
        figure = Figure(figsize=(6.4, 3.6), layout="constrained")
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


def draw_table3(study: Table3) -> Any:
    """Return measured thrust with the laws, and the error of each candidate left one out."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context(RC):
        figure = Figure(figsize=(10.0, 4.2), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.1, 1.0))
        x = np.arange(len(study.confs))
        left.errorbar(
            x, study.measured, yerr=study.deviations, fmt="o", color=INK, capsize=3,
            label="measured ± printed deviation",
        )  # fmt: skip
        for (law, values), colour in zip(
            study.laws.items(), (ORANGE, VERMILLION, BLUE), strict=True
        ):
            left.plot(x, values, "_", markersize=13, markeredgewidth=2.2, color=colour, label=law)
        soft = np.array(study.measured)[np.array(study.confs) != 0]
        left.axhline(float(soft.mean()), color=GREEN, linestyle="--", linewidth=1.0,
                     label="mean of Conf. 5 to 13")  # fmt: skip
        left.set_xticks(x, [str(c) for c in study.confs])
        left.set_xlabel("configuration, soft to stiff from 5 on")
        left.set_ylabel("thrust at 2000 rpm [N]")
        left.set_title("The laws fall with softness; the measurements do not", loc="left")
        left.set_ylim(0.2, 0.92)
        left.legend(fontsize=7, loc="lower left", ncols=2)
        names = [p.what.replace("_", " ") for p in study.predictions][::-1]
        errors = [p.rmse for p in study.predictions][::-1]
        mean = next(p.rmse for p in study.predictions if p.what == "mean of the others")
        right.barh(names, errors, color=[GREEN if "mean" in n else SKY for n in names])
        right.axvline(mean, color=GREEN, linestyle="--", linewidth=1.0)
        right.set_xlabel("error on the configuration left out, RMS [N]")
        surely = any(p.high < 0.0 for p in study.predictions)
        some = "Some extension is" if surely else "No extension is"
        right.set_title(f"{some} surely better than the mean", loc="left")
        right.grid(axis="y", visible=False)
    return figure


def _scatter(axis: Any, found: StandDiagnosis, values: Array, c: int) -> None:
    problem = found.findings.problem
    points = problem.points
    for p, name in enumerate(points.propellers[:40]):
        own = (points.setup.propeller == p) & problem.seen[:, c]
        axis.plot(
            points.setup.speed[own] * _RPM, values[own], "o", markersize=3.2,
            color=_COLOURS[p % len(_COLOURS)], label=name,
        )  # fmt: skip
