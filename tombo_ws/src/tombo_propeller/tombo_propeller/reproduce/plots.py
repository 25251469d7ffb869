"""All figures of the reproduction by file name, and one overview of six results."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_flight.report import style
from tombo_propeller.reproduce import curve_plots, table_plots
from tombo_propeller.reproduce.claims.claim import FAILS, HOLDS, OPEN
from tombo_propeller.reproduce.plot_style import (
    LAW_COLOURS,
    curve,
    heading,
    over_speed,
    sheet,
    styled,
)
from tombo_propeller.reproduce.reproduction import Reproduction


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
    curve_plots.ratio_axes(panels[4], r, law)
    panels[4].set_ylabel("lift over drag")
    panels[4].legend(loc="lower right", frameon=True, edgecolor="none", framealpha=0.9)
    heading(panels[4], f"The printed ε_mld: {_under(r.laws('eps_mld'))} (shown: {law})")
    for name in r.numbers.laws:
        curve_plots.universal_axes(panels[5], name)
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
        curve_plots.lift_over_drag,
        "Lift over drag against speed; the dashed line is the printed largest value",
        "figure of ε against ω",
    ),
    "thrust_measured_range.png": (
        curve_plots.thrust_low,
        "Thrust where it was measured. Of the measured points only one is printed as a number",
        "figure of thrust, 2000–3200 rpm",
    ),
    "thrust_to_18000_rpm.png": (
        curve_plots.thrust_high,
        "Thrust as far as the paper computes it. A curve ends where the coefficients' range does",
        "figure of thrust to 18 000 rpm",
    ),
    "deformation.png": (
        curve_plots.deformation,
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
        curve_plots.universal,
        "Thirteen configurations over each other, without gravity",
        "not in the paper",
    ),
}
"""File name → how it is drawn, what it shows, and which figure or table of the paper it is."""
