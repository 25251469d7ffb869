"""The figures of the reproduction by file name: an overview, and curves over speed, law by law."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache, partial
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM, Operation, configuration, evaluate, valid_speed
from tombo_flight.report import style
from tombo_flight.report.style import new_figure
from tombo_propeller.reproduce.claims.claim import FAILS, HOLDS
from tombo_propeller.reproduce.computed_values import collapse
from tombo_propeller.reproduce.reproduction import Reproduction, checks_summary, headline

_LAW_MARKS: Final = {"published": "o", "repaired": "s", "consistent": "D"}
"""Marker of each law of the nodus."""
_CONFS: Final = {
    0: ("Conf. 0, rigid", style.MUTED),
    1: ("Conf. 1", style.ORANGE),
    2: ("Conf. 2", style.PURPLE),
    3: ("Conf. 3", style.SKY),
}
"""Configuration of the paper's propeller → its label and colour."""
_MEASURED: Final = style.INK
_MEAN_COLOUR: Final = "#8A97A3"
_DPI: Final = 140
_TOP_RPM: Final = 18000.0
"""End of the axes of speed: the limit of the laws, `SPEED_LIMIT`."""
_MEASURED_RPM: Final = (2000.0, 3200.0)
"""Speeds at which the paper measured."""
_DEGREES: Final = 180.0 / math.pi
_QUANTITIES: Final = (
    ("thrust_N", "value", "o", "thrust [N]", 1.0, (0.0, 14.0)),
    ("lift_over_drag", "value", "^", "lift over drag", 1.0, (1.2, 2.3)),
    ("alpha_rad", "alpha_deg", "o^", "lag α [deg]", _DEGREES, None),
    ("beta_rad", "beta_deg", "o^", "flap β [deg]", _DEGREES, None),
    ("gamma_rad", "gamma_deg", "o^", "twist γ [deg]", _DEGREES, (0.0, 30.0)),
)
"""Field of `Operation`, field of `Optimum`, marks of the optima, axis label, its units in one of
SI, axis limits."""


def curves(r: Reproduction) -> Figure:
    """Draw thrust, lift over drag, lag, flap and twist of Conf. 0-3, with their optima."""
    laws = list(r.numbers.laws.items())
    with new_figure(11.0, 14.0, _DPI, 10.0, layout="constrained") as figure:
        _title(figure, "A maximum of thrust, or a twist that saturates: one term decides")
        grid = figure.subplots(len(_QUANTITIES), len(laws), squeeze=False, sharey="row")
        for row, (field, at_optimum, marks, label, factor, limits) in zip(
            grid, _QUANTITIES, strict=True
        ):
            row[0].set_ylabel(label)
            for axes, (name, law) in zip(row, laws, strict=True):
                optima = {"o": law.thrust, "^": law.ratio}
                for conf, (words, colour) in _CONFS.items():
                    rpm, points = _curve(conf, name, 50.0)
                    axes.plot(rpm, getattr(points, field) * factor, color=colour, label=words)
                    for mark in marks:
                        best = optima[mark].get(conf)
                        if best is not None and best.inside:
                            y = getattr(best, at_optimum)
                            axes.plot(best.speed_rpm, y, mark, ms=5.5, color=colour)
                _over_speed(axes)
                if limits is not None:
                    axes.set_ylim(*limits)
        for axes, (name, _) in zip(grid[0], laws, strict=True):
            _heading(axes, name)
        for mark, text in (("o", "maximum thrust"), ("^", "maximum lift over drag")):
            grid[0][0].plot([], [], mark, color=style.MUTED, ms=5.5, label=text)
        handles, labels = grid[0][0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    return figure


def overview(r: Reproduction) -> Figure:
    """Draw six findings on one sheet: what docs/reproduction.md shows."""
    law = "published" if "published" in r.numbers.laws else next(iter(r.numbers.laws))
    order = {HOLDS: "grows with stiffness", FAILS: "does not grow with stiffness"}
    verdict = r.claim("thrust_follows_stiffness").verdict
    below = "all" if r.claim("collision_force").verdict == HOLDS else "not all"
    panels: list[tuple[Callable[[Axes, Reproduction], None], str]] = [
        (_table_3_ratio, f"Simulated lift over drag: {_under(r.laws('table_3_lift_over_drag'))}"),
        (_table_3_thrust, f"Measured thrust: {order.get(verdict, 'no order, but much scatter')}"),
        (_force_shares, f"Collision force: {below} below two-thirds"),
        (_maxima, f"A maximum of thrust: {_under(r.laws('omega_mtf_order'))}"),
        (partial(_ratio_over_speed, law=law),
         f"The printed ε_mld: {_under(r.laws('eps_mld'))} (shown: {law})"),
        (_universal, "13 propellers, one curve: a theorem"),
    ]  # fmt: skip
    with new_figure(15.0, 8.2, _DPI, 10.0, layout="constrained") as figure:
        _title(figure, f"{headline(r)}.\n{checks_summary(r)}")
        for axes, (draw, text) in zip(figure.subplots(2, 3).flat, panels, strict=True):
            draw(axes, r)
            _heading(axes, text)
            axes.legend(ncols=2)
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
    bars = axes.bar(range(len(confs)), shares, width=0.72, color=colours, lw=0)
    axes.bar_label(bars, fmt="%.2f", padding=2.0, size=8.5)
    axes.axhline(bound, color=_MEASURED, lw=1.2, ls=(0, (4, 2)), label="two-thirds")
    axes.set(ylabel="force / force of Conf. 0", ylim=(0.0, 0.82))
    _configurations(axes, confs)


def _configurations(axes: Axes, confs: list[int]) -> None:
    """Label the axis of configurations."""
    axes.set_xticks(range(len(confs)), ["rigid" if c == 0 else str(c) for c in confs])
    axes.set_xlabel("configuration; softest matrix first")
    axes.grid(visible=False, axis="x")


def _maxima(axes: Axes, r: Reproduction) -> None:
    """Draw thrust of Conf. 13 over speed under each law, with its maximum."""
    axes.axvspan(*_MEASURED_RPM, color=style.FAINT, alpha=0.8, lw=0, zorder=0, label="measured")
    for name, law in r.numbers.laws.items():
        rpm, points = _curve(13, name, 0.0)
        axes.plot(rpm, points.thrust_N, color=style.LAW_COLOURS[name], label=name)
        best = law.thrust[13]
        if best.inside:
            axes.plot(best.speed_rpm, best.value, "o", color=style.LAW_COLOURS[name], ms=6)
    axes.set(ylabel="thrust of Conf. 13 [N]", ylim=(0.0, 16.0))
    _over_speed(axes)


def _ratio_over_speed(axes: Axes, r: Reproduction, law: str) -> None:
    """Draw lift over drag of Conf. 0–3 under one law, and the printed largest value."""
    printed = r.paper.number("model", "largest_lift_over_drag")
    axes.axhline(printed.value, color=_MEASURED, lw=1.2, ls=(0, (4, 2)),
                 label=f"largest as printed, {printed.text}")  # fmt: skip
    for conf, (words, colour) in _CONFS.items():
        rpm, points = _curve(conf, law, 50.0)
        axes.plot(rpm, points.lift_over_drag, color=colour, label=words)
    axes.set(ylabel="lift over drag", ylim=(1.2, 2.795))  # room for the legend above the curves
    _over_speed(axes)


def _universal(axes: Axes, r: Reproduction) -> None:
    """Draw thrust over the nodus' shear modulus G_N of all configurations, law by law."""
    for law in r.numbers.laws:
        s, curves = collapse(law)
        for curve in curves:
            axes.plot(np.sqrt(s), 1e6 * curve[0], ".", ms=3, color=style.LAW_COLOURS[law])
        axes.plot([], [], color=style.LAW_COLOURS[law], label=law)
    axes.set(xlabel="ω / √G_N [rad/(s √Pa)]", ylabel="T / G_N [µN/Pa]")


def _title(figure: Figure, text: str) -> None:
    """Put the finding of a sheet above it."""
    figure.suptitle(text, x=0.01, ha="left", weight="bold", size=12.5, parse_math=False)


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
