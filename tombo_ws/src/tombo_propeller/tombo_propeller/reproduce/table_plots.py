"""The paper's tables as figures: printed against computed, and what was measured."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from tombo_dynamics.propeller import configuration
from tombo_flight.report import style
from tombo_propeller.reproduce.claims.claim import FAILS, HOLDS, OPEN
from tombo_propeller.reproduce.computed_values import law_moduli
from tombo_propeller.reproduce.paper_values import PrintedNumber, Row3
from tombo_propeller.reproduce.plot_style import (
    LAW_COLOURS,
    LAW_MARKS,
    MEASURED,
    heading,
    legend_below,
    sheet,
    styled,
)
from tombo_propeller.reproduce.reproduction import Reproduction

ORDER = {
    HOLDS: "it grows with stiffness, as in the model",
    FAILS: "it does not grow with stiffness, as the model has it",
    OPEN: "no order by stiffness is seen, but the scatter could hide it",
}
BLIND = "#8A97A3"


@styled
def table_1(r: Reproduction) -> Figure:
    """How far computed moduli are from the printed ones, in last digits."""
    confs = list(r.paper.table_1)
    ours = {c: law_moduli(configuration(c), "repaired") for c in confs}
    met = sum(p.agrees(v) for c in confs for p, v in zip(r.paper.table_1[c], ours[c], strict=True))
    title = f"Table I: {met} of {2 * len(confs)} printed moduli met to the last digit"
    figure, (young, shear) = sheet(title, 1, 2, (11.0, 3.9), share_y=True)
    for k, axes in enumerate((young, shear)):
        axes.axhspan(-0.5, 0.5, color=style.GREEN, alpha=0.16, lw=0)
        axes.axhline(0.0, color=style.MUTED, lw=0.8)
        off = [_digits(r.paper.table_1[c][k], ours[c][k]) for c in confs]
        label = f"G_f = {r.numbers.fibre_shear_MPa:g} MPa" if k else "Eq. 2"
        axes.plot(confs, off, "o", ms=7, color=style.BLUE, zorder=4, label=label)
        axes.set_xticks(confs)
        axes.set(xlabel="configuration", xlim=(0.4, 13.6), ylim=(-2.4, 2.4))
    other = [_digits(r.paper.table_1[c][1], r.numbers.shear_from_ratio[c]) for c in confs]
    shear.plot(confs, other, "o", ms=7, mfc="none", color=style.VERMILLION,
               label="G_f = E_f / 2.7, as in the authors' program")  # fmt: skip
    young.set_ylabel("computed less printed\n[units of the last digit]")
    young.text(13.5, -0.58, "in the band: rounds to the printed value", ha="right", va="top",
               color=style.GREEN, size=9)  # fmt: skip
    heading(young, "E_N")
    heading(shear, "G_N")
    shear.legend(loc="lower left")
    return figure


@styled
def table_3_ratio(r: Reproduction) -> Figure:
    """Lift over drag, printed and computed."""
    claim = r.claim("table_3_lift_over_drag")
    met = ", ".join(f"{law} {n:.0f}" for law, n in claim.computed.items() if n is not None)
    title = f"Table III, lift over drag: printed values met of {len(r.paper.table_3)}: {met}"
    figure, panels = sheet(title, 1, 1, (11.0, 3.9))
    ratio_axes(panels[0], r)
    panels[0].legend(ncols=4, loc="upper right")
    return figure


def ratio_axes(axes: Axes, r: Reproduction) -> None:
    """Draw Table III's lift over drag, printed as rings, computed as dots."""
    confs, at = _places(r)
    for law, numbers in r.numbers.laws.items():
        axes.plot(at, [numbers.low[c].ratio for c in confs], LAW_MARKS[law], ms=5,
                  color=LAW_COLOURS[law], label=law, zorder=4)  # fmt: skip
    axes.plot(at, [r.paper.table_3[c].ratio.value for c in confs], "o", ms=12, mfc="none",
              mew=1.5, color=MEASURED, label="printed")  # fmt: skip
    axes.set(ylabel="lift over drag", ylim=(1.7, 2.2))
    _configurations(axes, confs)


@styled
def table_3_thrust(r: Reproduction) -> Figure:
    """Thrust, measured and computed."""
    seen = r.claim("thrust_follows_stiffness").verdict
    title = f"Table III, thrust at 2000 rpm: {ORDER[seen]}"
    figure, panels = sheet(title, 1, 1, (11.0, 4.3))
    thrust_axes(panels[0], r)
    legend_below(figure, panels[0])
    return figure


def thrust_axes(axes: Axes, r: Reproduction) -> None:
    """Draw Table III's thrusts with their deviations, and what each law computes."""
    confs, at = _places(r)
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
        fmt="_", ms=14, mew=2.2, color=MEASURED, elinewidth=1.0, capsize=3, label="measured",
        zorder=3,
    )  # fmt: skip
    mean = float(np.mean(soft))
    axes.plot([0.5, len(confs) - 0.5], [mean, mean], color=BLIND, ls=(0, (4, 2)), lw=1.3,
              label="mean of Conf. 5–13", zorder=2)  # fmt: skip
    shift = np.linspace(-0.16, 0.16, max(len(r.numbers.laws), 2))
    for dx, (law, numbers) in zip(shift, r.numbers.laws.items(), strict=False):
        axes.plot([x + dx for x in at], [numbers.low[c].thrust_N for c in confs], LAW_MARKS[law],
                  ms=5.5, color=LAW_COLOURS[law], label=law, zorder=4)  # fmt: skip
    axes.set(ylabel="thrust [N]", ylim=(0.3, 0.95))
    _configurations(axes, confs)


@styled
def comparison(r: Reproduction) -> Figure:
    """The nine configurations by five criteria, each as a share of its best."""
    title = "Nine configurations by what was printed: none is best in everything"
    figure, panels = sheet(title, 1, 5, (11.0, 4.3), share_y=True)
    confs = [c for c in r.paper.table_3 if c]
    rows = [r.paper.table_3[c] for c in confs]
    for axes, (label, pick, high) in zip(panels, _CRITERIA, strict=True):
        printed = [pick(row) for row in rows]
        values = np.array([p.value for p in printed])
        best = values.max() if high else values.min()
        share = values / best if high else best / values
        y = np.arange(len(confs))[::-1]
        colours = [style.GREEN if v == best else "#9DB4C8" for v in values]
        axes.barh(y, share, height=0.72, color=colours, lw=0)
        for place, text, s in zip(y, printed, share, strict=True):
            weight = "bold" if s == 1.0 else "normal"
            axes.text(0.03, place, text.text, va="center", size=9, weight=weight)
        axes.set_yticks(y, [f"Conf. {c}" for c in confs])
        axes.set(xlim=(0.0, 1.04), xticks=[0.0, 0.5, 1.0])
        axes.set_xlabel("share of the best")
        axes.grid(visible=False, axis="y")
        axes.tick_params(left=False)
        heading(axes, label)
    return figure


@styled
def collision_force(r: Reproduction) -> Figure:
    """Force by configuration and by radius."""
    claim = r.claim("collision_force")
    title = f"Collision force: “less than two-thirds” {claim.verdict}; largest at 60 mm"
    if claim.verdict == "fails":
        above = [c for c in r.paper.table_3 if c and _share(r, c) >= 2.0 / 3.0]
        title = (
            "Collision force: “less than two-thirds of the rigid one” fails for Conf. "
            f"{', '.join(map(str, above))}"
        )
    figure, (left, right) = sheet(title, 1, 2, (11.0, 4.1))
    share_axes(left, r)
    heading(left, "Table III, 2000 rpm")
    for row in r.paper.table_2:
        at, force = row.r_mm.value, row.force_N.value
        right.bar(at, force, width=7.2, color="#9DB4C8", lw=0)
        right.text(at, force + 5.0, f"{row.force_N.text} N", ha="center", size=8.5)
        right.text(at, 8.0, f"{row.thickness_mm.text} mm\nthick", ha="center", size=8.5)
    right.set(xlabel="where the blade is struck, from the hub [mm]", ylabel="largest force [N]")
    right.set_ylim(0.0, 385.0)
    right.grid(visible=False, axis="x")
    heading(right, "Table II, Conf. 13, 2500 rpm")
    return figure


def share_axes(axes: Axes, r: Reproduction) -> None:
    """Draw each configuration's collision force over the rigid propeller's."""
    confs = [c for c in r.paper.table_3 if c]
    bound = 2.0 / 3.0
    shares = [_share(r, c) for c in confs]
    colours = [style.VERMILLION if s >= bound else "#9DB4C8" for s in shares]
    axes.bar(range(len(confs)), shares, width=0.72, color=colours, lw=0)
    for k, s in enumerate(shares):
        axes.text(k, s + 0.01, f"{s:.2f}", ha="center", size=8.5)
    axes.axhline(bound, color=MEASURED, lw=1.2, ls=(0, (4, 2)))
    axes.text(-0.45, bound + 0.012, "two-thirds", size=8.5, va="bottom")
    axes.set(ylabel="force / force of Conf. 0", ylim=(0.0, 0.82))
    _configurations(axes, confs)


_CRITERIA: tuple[tuple[str, Callable[[Row3], PrintedNumber], bool], ...] = (
    ("thrust [N]", lambda row: row.thrust_N, True),
    ("collision force [N]", lambda row: row.force_N, False),
    ("recovery time [s]", lambda row: row.recovery_s or PrintedNumber("nan"), False),
    ("lift over drag", lambda row: row.ratio, True),
    ("noise [dB]", lambda row: row.noise_dB, False),
)
"""Name, value, and whether more is better."""


def _share(r: Reproduction, conf: int) -> float:
    return r.paper.table_3[conf].force_N.value / r.paper.table_3[0].force_N.value


def _digits(printed: PrintedNumber, value: float) -> float:
    return (value - printed.value) / (2.0 * printed.half)


def _places(r: Reproduction) -> tuple[list[int], list[int]]:
    confs = list(r.paper.table_3)
    return confs, list(range(len(confs)))


def _configurations(axes: Axes, confs: list[int]) -> None:
    axes.set_xticks(range(len(confs)), ["rigid" if c == 0 else str(c) for c in confs])
    axes.set_xlabel("configuration; softest matrix first")
    axes.grid(visible=False, axis="x")
