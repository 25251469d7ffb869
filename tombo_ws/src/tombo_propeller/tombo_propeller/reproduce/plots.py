"""The figures of the reproduction by file name: an overview, and curves over speed, law by law."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM, Operation, configuration, evaluate, valid_speed
from tombo_flight.report import style
from tombo_propeller.reproduce.claims.claim import FAILS, HOLDS
from tombo_propeller.reproduce.computed_values import collapse
from tombo_propeller.reproduce.reproduction import Reproduction, checks_summary, headline

_LAW_MARKS: Final = {"published": "o", "repaired": "s", "consistent": "D"}
"""Marker of each law of the nodus."""
_CONF_COLOURS: Final = {0: style.MUTED, 1: style.ORANGE, 2: style.PURPLE, 3: style.SKY}
"""Colours of the paper's configurations 0 (rigid) to 3 of the propeller."""
_MEASURED: Final = style.INK
_MEAN_COLOUR: Final = "#8A97A3"
_DPI: Final = 140
_RC: Final = {**style.RC, "font.size": 10.0, "legend.fontsize": 9.0, "lines.linewidth": 1.7}
_TOP_RPM: Final = 18000.0
"""End of the axes of speed: the limit of the laws, `SPEED_LIMIT`."""
_MEASURED_RPM: Final = (2000.0, 3200.0)
"""Speeds at which the paper measured."""
_DEGREES: Final = 180.0 / math.pi
_styled: Final = mpl.rc_context(_RC)
"""Decorates what draws a whole figure."""
_QUANTITIES: Final = (
    ("thrust_N", "value", "thrust [N]", 1.0, (0.0, 14.0)),
    ("lift_over_drag", "value", "lift over drag", 1.0, (1.2, 2.3)),
    ("alpha_rad", "alpha_deg", "lag α [deg]", _DEGREES, None),
    ("beta_rad", "beta_deg", "flap β [deg]", _DEGREES, None),
    ("gamma_rad", "gamma_deg", "twist γ [deg]", _DEGREES, (0.0, 30.0)),
)
"""Field of `Operation`, field of `Optimum`, axis label, its units in one of SI, axis limits."""


@_styled
def curves(r: Reproduction) -> Figure:
    """Draw thrust, lift over drag, lag, flap and twist of Conf. 0-3, with their optima."""
    title = "A maximum of thrust, or a twist that saturates: one term of the model decides"
    laws = list(r.numbers.laws.items())
    figure, panels = _sheet(title, len(_QUANTITIES), len(laws), (11.0, 14.0), share_y=True)
    for i, (quantity, at_optimum, label, factor, limits) in enumerate(_QUANTITIES):
        for k, (name, law) in enumerate(laws):
            axes = panels[i * len(laws) + k]
            optima = {"o": law.thrust, "^": law.ratio}
            if at_optimum == "value":
                optima = {"o": law.thrust} if quantity == "thrust_N" else {"^": law.ratio}
            for conf, colour in _CONF_COLOURS.items():
                rpm, points = _curve(conf, name, 50.0)
                axes.plot(rpm, getattr(points, quantity) * factor, color=colour,
                          label="Conf. 0, rigid" if conf == 0 else f"Conf. {conf}")  # fmt: skip
                for mark, best in ((m, by_conf[conf]) for m, by_conf in optima.items() if conf):
                    if best.inside:
                        y = getattr(best, at_optimum)
                        axes.plot(best.speed_rpm, y, mark, ms=5.5, color=colour)
            _over_speed(axes)
            if limits is not None:
                axes.set_ylim(*limits)
            if not i:
                _heading(axes, name)
            if not k:
                axes.set_ylabel(label)
    for mark, text in (("o", "maximum thrust"), ("^", "maximum lift over drag")):
        panels[0].plot([], [], mark, color=style.MUTED, ms=5.5, label=text)
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


@_styled
def overview(r: Reproduction) -> Figure:
    """Draw six findings on one sheet: what docs/reproduction.md shows."""
    title = f"{headline(r)}.\n{checks_summary(r)}"
    figure, panels = _sheet(title, 2, 3, (15.0, 8.2))
    _table_3_ratio(panels[0], r)
    panels[0].legend(ncols=2, loc="upper right")
    laws = r.laws("table_3_lift_over_drag")
    _heading(panels[0], f"Simulated lift over drag: {_under(laws)}")
    _table_3_thrust(panels[1], r)
    panels[1].legend(ncols=2, loc="upper right")
    order = {HOLDS: "grows with stiffness", FAILS: "does not grow with stiffness"}
    verdict = r.claim("thrust_follows_stiffness").verdict
    _heading(panels[1], f"Measured thrust: {order.get(verdict, 'no order, but much scatter')}")
    _force_shares(panels[2], r)
    below = "all" if r.claim("collision_force").verdict == HOLDS else "not all"
    _heading(panels[2], f"Collision force: {below} below two-thirds")
    _maxima(panels[3], r)
    _heading(panels[3], f"A maximum of thrust: {_under(r.laws('omega_mtf_order'))}")
    law = "published" if "published" in r.numbers.laws else next(iter(r.numbers.laws))
    _ratio_over_speed(panels[4], r, law)
    _heading(panels[4], f"The printed ε_mld: {_under(r.laws('eps_mld'))} (shown: {law})")
    for name in r.numbers.laws:
        _universal(panels[5], name)
    panels[5].legend()
    _heading(panels[5], "13 propellers, one curve: a theorem")
    return figure


def _under(laws: list[str]) -> str:
    """Return the laws under which a claim holds, as words of a heading."""
    return f"law {', '.join(laws)}" if laws else "under no law"


def _table_3_ratio(axes: Axes, r: Reproduction) -> None:
    """Draw Table III's lift over drag, printed as rings, computed as dots."""
    confs = list(r.paper.table_3)
    at = range(len(confs))
    for law, numbers in r.numbers.laws.items():
        axes.plot(at, [numbers.low[c].ratio for c in confs], _LAW_MARKS[law], ms=5,
                  color=style.LAW_COLOURS[law], label=law, zorder=4)  # fmt: skip
    axes.plot(at, [r.paper.table_3[c].ratio.value for c in confs], "o", ms=12, mfc="none",
              mew=1.5, color=_MEASURED, label="printed")  # fmt: skip
    axes.set(ylabel="lift over drag", ylim=(1.7, 2.2))
    _configurations(axes, confs)


def _table_3_thrust(axes: Axes, r: Reproduction) -> None:
    """Draw Table III's thrusts with their deviations, and what each law computes."""
    confs = list(r.paper.table_3)
    at = range(len(confs))
    rows = [r.paper.table_3[c] for c in confs]
    soft = [row.thrust_N.value for row, c in zip(rows, confs, strict=True) if c]
    bound = 0.01 * r.paper.number("model", "thrust_error_percent").value
    for x, row in zip(at, rows, strict=True):
        t = row.thrust_N.value
        axes.fill_between([x - 0.36, x + 0.36], t * (1 - bound), t * (1 + bound), lw=0,
                          color=style.FAINT, zorder=1,
                          label="± 8 % of measured" if not x else None)  # fmt: skip
    axes.errorbar(
        at, [row.thrust_N.value for row in rows], yerr=[row.thrust_dev_N.value for row in rows],
        fmt="_", ms=14, mew=2.2, color=_MEASURED, elinewidth=1.0, capsize=3, label="measured",
        zorder=3,
    )  # fmt: skip
    mean = float(np.mean(soft))
    axes.plot([0.5, len(confs) - 0.5], [mean, mean], color=_MEAN_COLOUR, ls=(0, (4, 2)), lw=1.3,
              label="mean of Conf. 5–13", zorder=2)  # fmt: skip
    shift = np.linspace(-0.16, 0.16, max(len(r.numbers.laws), 2))
    for dx, (law, numbers) in zip(shift, r.numbers.laws.items(), strict=False):
        axes.plot([x + dx for x in at], [numbers.low[c].thrust_N for c in confs], _LAW_MARKS[law],
                  ms=5.5, color=style.LAW_COLOURS[law], label=law, zorder=4)  # fmt: skip
    axes.set(ylabel="thrust [N]", ylim=(0.3, 1.08))
    _configurations(axes, confs)


def _force_shares(axes: Axes, r: Reproduction) -> None:
    """Draw each soft configuration's collision force over the rigid propeller's, Table III."""
    confs = list(r.paper.soft)
    bound = 2.0 / 3.0  # the paper's claim
    rigid = r.paper.table_3[0].force_N.value
    shares = [r.paper.table_3[c].force_N.value / rigid for c in confs]
    colours = [style.VERMILLION if s >= bound else "#9DB4C8" for s in shares]
    axes.bar(range(len(confs)), shares, width=0.72, color=colours, lw=0)
    for k, s in enumerate(shares):
        axes.text(k, s + 0.01, f"{s:.2f}", ha="center", size=8.5)
    axes.axhline(bound, color=_MEASURED, lw=1.2, ls=(0, (4, 2)))
    axes.text(-0.45, bound + 0.012, "two-thirds", size=8.5, va="bottom")
    axes.set(ylabel="force / force of Conf. 0", ylim=(0.0, 0.82))
    _configurations(axes, confs)


def _configurations(axes: Axes, confs: list[int]) -> None:
    """Label the axis of configurations."""
    axes.set_xticks(range(len(confs)), ["rigid" if c == 0 else str(c) for c in confs])
    axes.set_xlabel("configuration; softest matrix first")
    axes.grid(visible=False, axis="x")


def _maxima(axes: Axes, r: Reproduction) -> None:
    """Draw thrust of Conf. 13 over speed under each law, with its maximum."""
    axes.axvspan(*_MEASURED_RPM, color=style.FAINT, alpha=0.8, lw=0, zorder=0)
    axes.text(2600.0, 15.6, "measured", ha="center", va="top", size=8, color=style.MUTED)
    for name, law in r.numbers.laws.items():
        rpm, points = _curve(13, name, 0.0)
        axes.plot(rpm, points.thrust_N, color=style.LAW_COLOURS[name], label=name)
        best = law.thrust[13]
        if best.inside:
            axes.plot(best.speed_rpm, best.value, "o", color=style.LAW_COLOURS[name], ms=6)
    axes.set(ylabel="thrust of Conf. 13 [N]", ylim=(0.0, 16.0))
    _over_speed(axes)
    axes.legend(loc="upper right")


def _ratio_over_speed(axes: Axes, r: Reproduction, law: str) -> None:
    """Draw lift over drag of Conf. 0–3 under one law, and the printed largest value."""
    printed = r.paper.number("model", "largest_lift_over_drag")
    axes.axhline(printed.value, color=_MEASURED, lw=1.2, ls=(0, (4, 2)),
                 label=f"largest as printed, {printed.text}")  # fmt: skip
    for conf, colour in _CONF_COLOURS.items():
        rpm, points = _curve(conf, law, 50.0)
        axes.plot(rpm, points.lift_over_drag, color=colour,
                  label="Conf. 0, rigid" if conf == 0 else f"Conf. {conf}")  # fmt: skip
    axes.set(ylabel="lift over drag", ylim=(1.2, 2.795))  # room for the legend above the curves
    axes.legend(loc="upper right", ncols=2)
    _over_speed(axes)


def _universal(axes: Axes, law: str) -> None:
    """Draw thrust over the nodus' shear modulus G_N of all configurations under one law."""
    s, curves = collapse(law)
    for curve in curves:
        axes.plot(np.sqrt(s), 1e6 * curve[0], ".", ms=3, color=style.LAW_COLOURS[law])
    axes.plot([], [], color=style.LAW_COLOURS[law], label=law)
    axes.set(xlabel="ω / √G_N [rad/(s √Pa)]", ylabel="T / G_N [µN/Pa]")


def _sheet(
    title: str, rows: int, columns: int, size_in: tuple[float, float], *, share_y: bool = False
) -> tuple[Figure, list[Axes]]:
    """Return a figure with a title that tells its finding, and its axes row by row."""
    figure = Figure(figsize=size_in, dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title, x=0.01, ha="left", weight="bold", size=12.5, parse_math=False)
    grid = figure.subplots(rows, columns, squeeze=False, sharey="row" if share_y else "none")
    return figure, [axes for row in grid for axes in row]


@lru_cache(maxsize=64)
def _curve(conf: int, law: str, low_rpm: float) -> tuple[Array, Operation]:
    """Return speeds [rpm] up to _TOP_RPM and operating points, as far as the law is valid."""
    chosen = configuration(conf)
    top = min(_TOP_RPM, valid_speed(chosen, law) / RPM)
    rpm: Array = np.linspace(low_rpm, top, 361, dtype=np.float64)
    return rpm, evaluate(chosen, rpm * RPM, law, outside="mask")


def _heading(axes: Axes, text: str) -> None:
    """Put the finding of a panel above it."""
    axes.set_title(text, loc="left", size=10.5, weight="bold", parse_math=False)


def _over_speed(axes: Axes) -> None:
    """Label the axis of speed."""
    axes.set_xlim(0.0, _TOP_RPM)
    axes.set_xlabel("speed [1000 rpm]")
    ticks = np.arange(0.0, _TOP_RPM + 1.0, 4000.0)
    axes.set_xticks(ticks, [f"{t / 1000.0:g}" for t in ticks])


FIGURES: Final[dict[str, tuple[Callable[[Reproduction], Figure], str, str]]] = {
    "overview.png": (overview, "The results on one sheet", "Overview"),
    "curves.png": (
        curves,
        "Thrust, lift over drag and deformation over speed. A curve ends where the coefficients' "
        "range does; the twist at an optimum is the same for every configuration",
        "figures of thrust, ε, α, β and γ against ω",
    ),
}
"""File name → drawing function, caption, and figures of the paper."""
