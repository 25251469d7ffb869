"""Figures of a stand diagnosis: residuals over speed and stiffness; the paper's Table III."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from matplotlib.figure import Figure

from tombo_diagnosis.stand.table3 import AS_IT_IS, predicted_readings
from tombo_diagnosis.wording import display_name
from tombo_dynamics.propeller import RPM
from tombo_dynamics.propeller.effects import CHANNELS
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

if TYPE_CHECKING:
    from tombo_diagnosis.stand.diagnose import StandDiagnosis
    from tombo_diagnosis.stand.problem import StandProblem
    from tombo_diagnosis.stand.table3 import Table3
    from tombo_dynamics.arrays import Array

_UNITS: Final = {
    "thrust": ("N", 1.0), "torque": ("mN m", 1e3), "beta": ("deg", 180.0 / math.pi),
    "reference_speed": ("rpm", 1.0 / RPM),
}  # fmt: skip
_COLOURS: Final = (
    style.BLUE, style.VERMILLION, style.GREEN, style.ORANGE, style.PURPLE, style.SKY, style.MUTED,
    style.INK,
)  # fmt: skip


def draw_residuals(stand: StandDiagnosis, headline: str) -> Figure:
    """Draw measured minus model over speed, before and after, a row for each channel."""
    problem = stand.findings.problem
    points = problem.points
    before = problem.residual(problem.final(problem.null_hypothesis))
    after = problem.unexplained(stand.findings.search.best.fit)
    channels = [c for c in points.measured if problem.seen[:, c].any()]
    with new_figure(9.6, 1.1 + 2.5 * len(channels), 100, layout="constrained") as figure:
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
        figure.suptitle(f"{headline}\ngrey: twice the noise of a point", x=0.01, ha="left")
    return figure


def _scatter(axis: Any, problem: StandProblem, values: Array, c: int) -> None:
    setup = problem.points.setup
    for p, name in enumerate(problem.points.propellers[:40]):
        rows = (setup.propeller == p) & problem.seen[:, c]
        axis.plot(
            setup.speed[rows] / RPM, values[rows], "o", markersize=3.2,
            color=_COLOURS[p % len(_COLOURS)], label=name,
        )  # fmt: skip


def has_stiffness(stand: StandDiagnosis) -> bool:
    """Return whether thrust was measured of two propellers or more with a nodus."""
    points = stand.findings.problem.points
    return int(np.isfinite(points.stiffness).sum()) > 1 and 0 in points.measured


def draw_stiffness(stand: StandDiagnosis) -> Figure:
    """Draw each propeller's mean residual of thrust over the shear modulus of its nodus."""
    problem = stand.findings.problem
    points = problem.points
    before = problem.residual(problem.final(problem.null_hypothesis))[:, 0]
    after = problem.residual(problem.final(stand.findings.search.best.fit))[:, 0]
    with new_figure(6.4, 3.6, 100, layout="constrained") as figure:
        axis = figure.subplots()
        for left, colour, name in (
            (before, style.VERMILLION, "model as it was"),
            (after, style.BLUE, "with what was found"),
        ):
            x, y, half = [], [], []
            for p in np.flatnonzero(np.isfinite(points.stiffness)):
                rows = (points.setup.propeller == p) & problem.seen[:, 0]
                if rows.any():
                    x.append(points.stiffness[p])
                    y.append(left[rows].mean())
                    error = points.sigma[rows, 0].mean() / math.sqrt(rows.sum())
                    half.append(2.0 * max(error, left[rows].std() / math.sqrt(rows.sum())))
            axis.errorbar(x, y, yerr=half, fmt="o", color=colour, capsize=3, label=name)
        axis.axhline(0.0, color=style.MUTED, linewidth=0.7)
        axis.set_xlabel("shear modulus of the nodus G_N [MPa]")
        axis.set_ylabel("thrust, measured less model [N]")
        axis.set_title("Mean over each propeller's points, bars 95 %", loc="left")
        axis.legend()
    return figure


_EFFECT_STYLES: Final = {
    "centrifugal_stiffening": (style.ORANGE, "-"), "torsion_constant": (style.MUTED, "--"),
    "load_sharing": (style.PURPLE, "-."),
    "in_plane_term": (style.SKY, (0, (4, 1, 1, 1, 1, 1))),
}  # fmt: skip
_SOFTEST: Final = 5
"""The configuration with the softest nodus."""


def draw_table3(study: Table3) -> Figure:
    """Draw laws against measurement, candidates left one out, and where they part."""
    with new_figure(12.6, 4.7, 100, 9.0, layout="constrained") as figure:
        first, second, third = figure.subplots(1, 3, width_ratios=(1.05, 1.0, 1.05))
        _draw_measured(first, study)
        _draw_left_one_out(second, study)
        _draw_deciding_speeds(third, study)
        figure.suptitle(
            "Table III of the paper: the model loses thrust with softness, the propellers did not",
            x=0.008, ha="left", weight="bold", size=13.0,
        )  # fmt: skip
    return figure


def _draw_measured(axis: Any, study: Table3) -> None:
    order = np.argsort(np.where(np.isfinite(study.stiffness), study.stiffness, np.inf))
    x = np.arange(order.size)
    y, dev = np.array(study.measured)[order], np.array(study.deviations)[order]
    soft = np.isfinite(np.array(study.stiffness)[order])
    mean = float(y[soft].mean())
    axis.plot(x[soft], np.full(soft.sum(), mean), "--", color=style.INK, linewidth=1.0,
              label=f"mean of the soft ones: {mean:.2f} N")  # fmt: skip
    for law, colour in style.LAW_COLOURS.items():
        thrust = np.array(study.laws[law])[order]
        error = study.rms[law]
        axis.plot(x[soft], thrust[soft], "-", color=colour, linewidth=1.6,
                  label=f"law {law}: off by {1e3 * error:.0f} mN")  # fmt: skip
        axis.plot(x[~soft], thrust[~soft], "_", color=colour, markersize=14, markeredgewidth=1.6)
    axis.errorbar(x, y, yerr=dev, fmt="o", color=style.INK, capsize=3, markersize=5,
                  label="measured, with printed deviation")  # fmt: skip
    labels = [str(study.confs[k]) if s else "0\nrigid" for k, s in zip(order, soft, strict=True)]
    axis.set_xticks(x, labels)
    axis.set_xlabel("configuration, from the softest nodus to the stiffest")
    axis.set_ylabel("thrust at 2000 rpm [N]")
    axis.set_ylim(0.1, 0.92)
    axis.set_title(
        "Measured thrust does not follow stiffness\n"
        f"(rank correlation {study.spearman:.2f}, p = {study.spearman_p:.2f})",
        loc="left",
    )
    axis.legend(loc="lower left")


def _draw_left_one_out(axis: Any, study: Table3) -> None:
    shown = study.predictions[::-1]
    y = np.arange(len(shown))
    errors = 1e3 * np.array([p.rmse for p in shown])
    mean = next(1e3 * p.rmse for p in shown if p.what.startswith("mean"))
    kinds = {"mean": style.INK, "law": style.LAW_COLOURS[study.law]}
    colours = [kinds.get(p.what.split()[0], style.MUTED) for p in shown]
    axis.barh(y, errors, color=colours, height=0.68)
    axis.axvline(mean, color=style.INK, linestyle="--", linewidth=1.0)
    for k, e in zip(y, errors, strict=True):
        axis.text(e - 0.8, k, f"{e:.1f}", va="center", ha="right", size=8.0, color=style.PAPER)
    axis.set_yticks(y, [display_name(p.what) for p in shown])
    axis.set_xlim(0.0, 1.03 * float(errors.max()))
    axis.set_xlabel("error on the configuration left out, RMS [mN]")
    some = "Some" if any(p.high < 0.0 for p in study.predictions) else "No"
    axis.set_title(
        f"{some} extension predicts a propeller\nit has not seen surely better than the mean",
        loc="left",
    )
    axis.grid(axis="y", visible=False)
    axis.tick_params(axis="y", length=0)


def _draw_deciding_speeds(axis: Any, study: Table3) -> None:
    rpm = np.arange(800.0, 5001.0, 50.0, dtype=np.float64)
    curves = predicted_readings(study.fits, _SOFTEST, rpm, study.law)
    axis.axvspan(3200.0, 4500.0, color=style.FAINT, alpha=0.6, zorder=0, linewidth=0.0)
    axis.plot(rpm, curves[AS_IT_IS][:, 0], color=style.LAW_COLOURS[study.law],
              label=f"law {study.law} as it is")  # fmt: skip
    for effect, (colour, line) in _EFFECT_STYLES.items():
        axis.plot(rpm, curves[effect][:, 0], linestyle=line, color=colour, linewidth=1.7,
                  label=display_name(effect))  # fmt: skip
    k = study.confs.index(_SOFTEST)
    axis.errorbar([2000.0], [study.measured[k]], yerr=[study.deviations[k]], fmt="o",
                  color=style.INK, capsize=3, markersize=5, zorder=5)  # fmt: skip
    axis.annotate(
        "all that was\nmeasured", (2000.0, study.measured[k]), (1000.0, 1.35), size=8.5,
        arrowprops={"arrowstyle": "-", "color": style.MUTED, "linewidth": 0.8},
    )  # fmt: skip
    sigma = {s.what: s.sigma for s in study.settling}
    text = [
        f"{1e3 * sigma[name]:.0f} mN at {speed}"
        for speed in (3200, 4500)
        if (name := f"thrust of Conf. {_SOFTEST} at {speed} rpm") in sigma
    ]
    axis.set_xlabel("speed [rpm]")
    axis.set_ylabel(f"thrust of Conf. {_SOFTEST} [N]")
    axis.set_xlim(rpm[0], rpm[-1])
    title = f"What would settle it: thrust of Conf. {_SOFTEST}\nwithin {' or '.join(text)} rpm"
    axis.set_title(title, loc="left")
    axis.legend(loc="upper left")
