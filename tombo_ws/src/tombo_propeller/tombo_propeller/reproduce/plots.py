"""All figures of the reproduction by file name: curves over speed, law by law, and an overview."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_flight.report import style
from tombo_propeller.reproduce import table_plots
from tombo_propeller.reproduce.claims.claim import FAILS, HOLDS, OPEN
from tombo_propeller.reproduce.computed_values import collapse
from tombo_propeller.reproduce.plot_style import (
    CONF_COLOURS,
    LAW_COLOURS,
    MEASURED,
    curve,
    heading,
    legend_below,
    name_of,
    over_speed,
    sheet,
    styled,
)
from tombo_propeller.reproduce.reproduction import Reproduction

_CONFS = (0, 1, 2, 3)
_DEGREES = 180.0 / math.pi


@styled
def thrust_low(r: Reproduction) -> Figure:
    """Thrust of Conf. 0–3 in the measured range of speeds."""
    low, high = (float(s) for s in r.paper.texts["model"]["thrust_speeds_rpm"])
    title = "Measured range: softer means less thrust in every law; one point is in print"
    figure, panels = sheet(title, 1, len(r.numbers.laws), (11.0, 4.1), share_y=True)
    for axes, law in zip(panels, r.numbers.laws, strict=True):
        for conf in _CONFS:
            rpm, points = curve(conf, law, low, high)
            axes.plot(rpm, points.thrust_N, color=CONF_COLOURS[conf], label=name_of(conf))
        row = r.paper.table_3[0]
        axes.errorbar(
            [low], [row.thrust_N.value], yerr=[row.thrust_dev_N.value], fmt="o", ms=5,
            color=MEASURED, capsize=3, label="Conf. 0 measured (Table III)", clip_on=False,
            zorder=5,
        )  # fmt: skip
        over_speed(axes, low, high)
        axes.set_xlim(low - 40.0, high)
        heading(axes, law)
    panels[0].set_ylabel("thrust [N]")
    panels[0].set_ylim(0.4, None)
    legend_below(figure, panels[0])
    return figure


@styled
def thrust_high(r: Reproduction) -> Figure:
    """Thrust of Conf. 0–3 as far as the paper's figures go."""
    some = any(law.thrust[3].inside for law in r.numbers.laws.values())
    none = [n for n, law in r.numbers.laws.items() if not law.thrust[3].inside]
    title = "To 18 000 rpm: " + (
        f"a maximum of thrust, but none under law {', '.join(none)}" if some and none
        else "a maximum of thrust" if some else "no maximum of thrust"
    )  # fmt: skip
    figure, panels = sheet(title, 1, len(r.numbers.laws), (11.0, 4.3), share_y=True)
    for axes, (name, law) in zip(panels, r.numbers.laws.items(), strict=True):
        axes.axvspan(2000.0, 3200.0, color=style.FAINT, alpha=0.8, lw=0, zorder=0)
        for conf in _CONFS:
            rpm, points = curve(conf, name, 0.0, 18000.0)
            axes.plot(rpm, points.thrust_N, color=CONF_COLOURS[conf], label=name_of(conf))
            if conf and law.thrust[conf].inside:
                best = law.thrust[conf]
                axes.plot(best.speed_rpm, best.value, "o", ms=5, color=CONF_COLOURS[conf])
                axes.annotate(
                    f"{best.value:.1f} N\n{best.speed_rpm:.0f} rpm",
                    (best.speed_rpm, best.value), (0, -7), textcoords="offset points",
                    ha="center", va="top", size=8.5, color=style.INK,
                )  # fmt: skip
        over_speed(axes)
        axes.set_ylim(0.0, 14.0)
        heading(axes, name)
    panels[0].set_ylabel("thrust [N]")
    panels[0].text(2600.0, 13.7, "measured\nrange", ha="center", va="top", size=8,
                   color=style.MUTED)  # fmt: skip
    legend_below(figure, panels[0])
    return figure


@styled
def deformation(r: Reproduction) -> Figure:
    """Lag, flap and twist of Conf. 1–3."""
    title = "Deformation: the twist grows without end, or saturates, by one term of the model"
    laws = list(r.numbers.laws.items())
    figure, panels = sheet(title, 3, len(laws), (11.0, 8.0), share_y=True)
    for i, (field, label) in enumerate(
        (("alpha", "lag α [deg]"), ("beta", "flap β [deg]"), ("gamma", "twist γ [deg]"))
    ):
        for k, (name, law) in enumerate(laws):
            axes = panels[i * len(laws) + k]
            for conf in _CONFS[1:]:
                rpm, points = curve(conf, name, 0.0, 18000.0)
                values = getattr(points, f"{field}_rad") * _DEGREES
                axes.plot(rpm, values, color=CONF_COLOURS[conf], label=name_of(conf))
                for best, mark in ((law.thrust[conf], "o"), (law.ratio[conf], "^")):
                    if best.inside:
                        angle = getattr(best, f"{field}_deg")
                        axes.plot(best.speed_rpm, angle, mark, ms=5.5, color=CONF_COLOURS[conf])
            over_speed(axes)
            if i < 2:
                axes.set_xlabel("")
            if not i:
                heading(axes, name)
            if not k:
                axes.set_ylabel(label)
        if field == "gamma":
            panels[i * len(laws)].set_ylim(0.0, 30.0)
    for mark, text in (("o", "maximum thrust"), ("^", "maximum lift over drag")):
        panels[0].plot([], [], mark, color=style.MUTED, ms=5.5, label=text)
    legend_below(figure, panels[0])
    return figure


@styled
def lift_over_drag(r: Reproduction) -> Figure:
    """Lift over drag of Conf. 0–3."""
    printed = r.paper.number("model", "largest_lift_over_drag")
    laws = r.laws("eps_mld")
    where = f"is law {' and '.join(laws)} alone" if laws else "comes out nowhere"
    title = f"Lift over drag: the printed {printed.text} {where}"
    figure, panels = sheet(title, 1, len(r.numbers.laws), (11.0, 4.1), share_y=True)
    for axes, (name, law) in zip(panels, r.numbers.laws.items(), strict=True):
        ratio_axes(axes, r, name)
        heading(axes, name)
        best = law.ratio[3]
        text = f"{best.value:.2f}" if best.inside else "no maximum"
        axes.annotate(text, (best.speed_rpm, best.value), (0, 5), textcoords="offset points",
                      ha="center" if best.inside else "right", weight="bold")  # fmt: skip
    panels[0].set_ylabel("lift over drag")
    legend_below(figure, panels[0])
    return figure


def ratio_axes(axes: Axes, r: Reproduction, law: str) -> None:
    """Draw lift over drag of Conf. 0–3 under one law, and the printed largest value."""
    printed = r.paper.number("model", "largest_lift_over_drag")
    axes.axhline(printed.value, color=MEASURED, lw=1.2, ls=(0, (4, 2)),
                 label=f"largest as printed, {printed.text}")  # fmt: skip
    for conf in _CONFS:
        rpm, points = curve(conf, law, 50.0, 18000.0)
        axes.plot(rpm, points.lift_over_drag, color=CONF_COLOURS[conf], label=name_of(conf))
    axes.set_ylim(1.2, 2.3)
    over_speed(axes)


@styled
def universal(r: Reproduction) -> Figure:
    """All configurations over omega / sqrt(G_N), without gravity."""
    worst = max(law.collapse for law in r.numbers.laws.values())
    title = f"Without gravity thirteen propellers are one curve (to {worst:.0e}): a theorem"
    figure, panels = sheet(title, 1, 2, (11.0, 4.3))
    thrust, twist = panels
    for law in r.numbers.laws:
        universal_axes(thrust, law)
        s, curves = collapse(law)
        for one in curves:
            twist.plot(np.sqrt(s), one[1] * _DEGREES, ".", ms=3, color=LAW_COLOURS[law])
        twist.plot([], [], color=LAW_COLOURS[law], label=law)
    twist.set(xlabel="ω / √G_N [rad/(s √Pa)]", ylabel="twist γ [deg]")
    heading(thrust, "thrust")
    heading(twist, "twist")
    twist.legend()
    return figure


def universal_axes(axes: Axes, law: str) -> None:
    """Draw thrust over G_N of all configurations under one law."""
    s, curves = collapse(law)
    for one in curves:
        axes.plot(np.sqrt(s), 1e6 * one[0], ".", ms=3, color=LAW_COLOURS[law])
    axes.plot([], [], color=LAW_COLOURS[law], label=law)
    axes.set(xlabel="ω / √G_N [rad/(s √Pa)]", ylabel="T / G_N [µN/Pa]")


@styled
def overview(r: Reproduction) -> Figure:
    """Draw six findings on one sheet: what docs/reproduction.md shows."""
    counts = r.counts()
    title = (
        f"The paper, recomputed: of its {sum(counts.values())} claims {counts[HOLDS]} hold, "
        f"{counts[FAILS]} fail, {counts[OPEN]} can't be checked"
    )
    figure, panels = sheet(title, 2, 3, (15.0, 8.2))
    table_plots.ratio_axes(panels[0], r)
    panels[0].legend(ncols=2, loc="upper right")
    laws = r.laws("table_3_lift_over_drag")
    heading(panels[0], f"Simulated lift over drag: {_under(laws)}")
    table_plots.thrust_axes(panels[1], r)
    panels[1].set_ylim(0.3, 1.08)
    panels[1].legend(ncols=2, loc="upper right")
    order = {HOLDS: "grows with stiffness", FAILS: "does not grow with stiffness"}
    verdict = r.claim("thrust_follows_stiffness").verdict
    heading(panels[1], f"Measured thrust: {order.get(verdict, 'no order, but much scatter')}")
    table_plots.share_axes(panels[2], r)
    below = "all" if r.claim("collision_force").verdict == HOLDS else "not all"
    heading(panels[2], f"Collision force: {below} below two-thirds")
    _maxima(panels[3], r)
    heading(panels[3], f"A maximum of thrust: {_under(r.laws('omega_mtf_order'))}")
    law = "published" if "published" in r.numbers.laws else next(iter(r.numbers.laws))
    ratio_axes(panels[4], r, law)
    panels[4].set_ylabel("lift over drag")
    low, high = panels[4].get_ylim()
    panels[4].set_ylim(low, high + 0.45 * (high - low))  # room for the legend above the curves
    panels[4].legend(loc="upper right", ncols=2)
    heading(panels[4], f"The printed ε_mld: {_under(r.laws('eps_mld'))} (shown: {law})")
    for name in r.numbers.laws:
        universal_axes(panels[5], name)
    panels[5].legend()
    heading(panels[5], "13 propellers, one curve: a theorem")
    return figure


def _under(laws: list[str]) -> str:
    return f"law {', '.join(laws)}" if laws else "under no law"


def _maxima(axes: Axes, r: Reproduction) -> None:
    axes.axvspan(2000.0, 3200.0, color=style.FAINT, alpha=0.8, lw=0, zorder=0)
    axes.text(2600.0, 15.6, "measured", ha="center", va="top", size=8, color=style.MUTED)
    for name, law in r.numbers.laws.items():
        rpm, points = curve(13, name, 0.0, 18000.0)
        axes.plot(rpm, points.thrust_N, color=LAW_COLOURS[name], label=name)
        best = law.thrust[13]
        if best.inside:
            axes.plot(best.speed_rpm, best.value, "o", color=LAW_COLOURS[name], ms=6)
    axes.set(ylabel="thrust of Conf. 13 [N]", ylim=(0.0, 16.0))
    over_speed(axes)
    axes.legend(loc="upper right")


FIGURES: Final[dict[str, tuple[Callable[[Reproduction], Figure], str, str]]] = {
    "overview.png": (overview, "What came out, on one sheet", "Overview"),
    "table_1.png": (
        table_plots.table_1,
        "Moduli, computed less printed, in units of the last printed digit. A point in the band "
        "rounds to what is printed",
        "Table I",
    ),
    "table_3_lift_over_drag.png": (
        table_plots.table_3_ratio,
        "The simulated column of Table III. Rings are what is printed",
        "Table III",
    ),
    "lift_over_drag.png": (
        lift_over_drag,
        "Lift over drag against speed; the dashed line is the printed largest value",
        "figure of ε against ω",
    ),
    "thrust_measured_range.png": (
        thrust_low,
        "Thrust where it was measured. Of the measured points only one is printed as a number",
        "figure of thrust, 2000–3200 rpm",
    ),
    "thrust_to_18000_rpm.png": (
        thrust_high,
        "Thrust as far as the paper computes it. A curve ends where the coefficients' range does",
        "figure of thrust to 18 000 rpm",
    ),
    "deformation.png": (
        deformation,
        "Lag, flap and twist. Circles: maximum thrust; triangles: maximum lift over drag: the "
        "same twist for every configuration",
        "figure of α, β, γ",
    ),
    "table_3_thrust.png": (
        table_plots.table_3_thrust,
        "Measured thrust with its printed deviation, and what each law computes",
        "Table III",
    ),
    "comparison.png": (
        table_plots.comparison,
        "The nine configurations by criterion, as a share of the best one (green). Lift over drag "
        "is simulated, the rest measured",
        "comparison chart",
    ),
    "collision_force.png": (
        table_plots.collision_force,
        "Collision force by configuration, and by where Conf. 13 is struck",
        "Tables II and III",
    ),
    "universal_curve.png": (
        universal,
        "Thirteen configurations over each other, without gravity",
        "not in the paper",
    ),
}
"""File name → how it is drawn, what it shows, and which figure or table of the paper it is."""
