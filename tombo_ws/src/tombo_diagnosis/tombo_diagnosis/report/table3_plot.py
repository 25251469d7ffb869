"""The paper's Table III in one figure: what the model gets wrong, and what would settle it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

import numpy as np

from tombo_diagnosis.wording import display_name
from tombo_flight.report import style
from tombo_flight.report.style import BLUE, INK, VERMILLION

if TYPE_CHECKING:
    from tombo_diagnosis.stand.table3 import Table3

_LAWS: Final = {"published": style.ORANGE, "repaired": VERMILLION, "consistent": BLUE}
_EFFECT_STYLES: Final = {
    "centrifugal_stiffening": (BLUE, "-"), "torsion_constant": (style.GREEN, "--"),
    "load_sharing": (style.PURPLE, "-."),
    "in_plane_term": (style.SKY, (0, (4, 1, 1, 1, 1, 1))),
}  # fmt: skip
_SOFT: Final = 5
"""The configuration with the softest nodus."""


def draw_table3(study: Table3) -> Any:
    """Return laws against measurement, candidates left one out, and where they part."""
    import matplotlib as mpl
    from matplotlib.figure import Figure

    with mpl.rc_context({**style.RC, "font.size": 9.0, "legend.fontsize": 8.0}):
        figure = Figure(figsize=(12.6, 4.7), layout="constrained")
        first, second, third = figure.subplots(1, 3, width_ratios=(1.05, 1.0, 1.05))
        _measured(first, study)
        _left_one_out(second, study)
        _parting(third, study)
        figure.suptitle(
            "Table III of the paper: the model loses thrust with softness, the propellers did not",
            x=0.008, ha="left", weight="bold", size=13.0,
        )  # fmt: skip
    return figure


def _measured(axis: Any, study: Table3) -> None:
    order = np.argsort(np.where(np.isfinite(study.stiffness), study.stiffness, np.inf))
    x = np.arange(order.size)
    y, dev = np.array(study.measured)[order], np.array(study.deviations)[order]
    soft = np.isfinite(np.array(study.stiffness)[order])
    mean = float(y[soft].mean())
    axis.plot(x[soft], np.full(soft.sum(), mean), "--", color=INK, linewidth=1.0,
              label=f"mean of the soft ones: {mean:.2f} N")  # fmt: skip
    for law, colour in _LAWS.items():
        own = np.array(study.laws[law])[order]
        error = study.rms[law]
        axis.plot(x[soft], own[soft], "-", color=colour, linewidth=1.6,
                  label=f"law {law}: off by {1e3 * error:.0f} mN")  # fmt: skip
        axis.plot(x[~soft], own[~soft], "_", color=colour, markersize=14, markeredgewidth=1.6)
    axis.errorbar(x, y, yerr=dev, fmt="o", color=INK, capsize=3, markersize=5,
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


def _left_one_out(axis: Any, study: Table3) -> None:
    shown = study.predictions[::-1]
    y = np.arange(len(shown))
    errors = 1e3 * np.array([p.rmse for p in shown])
    mean = next(1e3 * p.rmse for p in shown if p.what.startswith("mean"))
    colours = [
        INK if p.what.startswith("mean") else VERMILLION if p.what.startswith("law") else BLUE
        for p in shown
    ]
    axis.barh(y, errors, color=colours, height=0.68)
    axis.axvline(mean, color=INK, linestyle="--", linewidth=1.0)
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


def _parting(axis: Any, study: Table3) -> None:
    from tombo_diagnosis.stand.discriminating_measurements import AS_IT_IS, predicted_readings

    rpm = np.arange(800.0, 5001.0, 50.0, dtype=np.float64)
    curves = predicted_readings(study.fits, _SOFT, rpm, study.law)
    axis.axvspan(3200.0, 4500.0, color=style.FAINT, alpha=0.6, zorder=0, linewidth=0.0)
    axis.plot(rpm, curves[AS_IT_IS][:, 0], color=VERMILLION, label=f"law {study.law} as it is")
    for effect, (colour, line) in _EFFECT_STYLES.items():
        axis.plot(rpm, curves[effect][:, 0], linestyle=line, color=colour, linewidth=1.7,
                  label=display_name(effect))  # fmt: skip
    k = study.confs.index(_SOFT)
    axis.errorbar([2000.0], [study.measured[k]], yerr=[study.deviations[k]], fmt="o", color=INK,
                  capsize=3, markersize=5, zorder=5)  # fmt: skip
    axis.annotate(
        "all that was\nmeasured", (2000.0, study.measured[k]), (1000.0, 1.35), size=8.5,
        arrowprops={"arrowstyle": "-", "color": style.MUTED, "linewidth": 0.8},
    )  # fmt: skip
    sigma = {s.what: s.sigma for s in study.settling}
    text = [
        f"{1e3 * sigma[name]:.0f} mN at {speed}"
        for speed in (3200, 4500)
        if (name := f"thrust of Conf. {_SOFT} at {speed} rpm") in sigma
    ]
    axis.set_xlabel("speed [rpm]")
    axis.set_ylabel(f"thrust of Conf. {_SOFT} [N]")
    axis.set_xlim(rpm[0], rpm[-1])
    title = f"What would settle it: thrust of Conf. {_SOFT}\nwithin {' or '.join(text)} rpm"
    axis.set_title(title, loc="left")
    axis.legend(loc="upper left")
