"""Drawings of the documentation: the propeller, and frames and rotors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Arc, Circle, FancyArrowPatch

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import Blade
from tombo_dynamics.propeller.blade import shape
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES, SPIN
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.replay_data import DrawnAirframe

_DPI: Final = 120
_FOLDED_DEG: Final = 40.0
_NODUS_M: Final = 0.012
"""Length of the nodus of the paper's configurations, from 23 to 35 mm."""


def draw_propeller(blade: Blade) -> Figure:
    """Draw a blade from above, and from the side with its wing stretched and folded."""
    outer = blade.joint.outer_radius_m
    inner = outer - _NODUS_M
    x: Array = np.linspace(blade.pieces[0].start_m, blade.tip_radius_m, 200).astype(np.float64)
    depth, pitch = shape(blade, x)
    chord = depth * np.cos(pitch)
    with new_figure(8.0, 5.6, _DPI) as figure:
        above = figure.add_axes((0.08, 0.66, 0.9, 0.29))
        side = figure.add_axes((0.08, 0.09, 0.9, 0.5))
        parts = ((x < inner, style.MUTED), (x >= outer, style.BLUE))
        for inside, colour in parts:
            above.fill_between(
                1e3 * x[inside], -500 * chord[inside], 500 * chord[inside], color=colour, alpha=0.6
            )
        joint = (x >= inner) & (x <= outer)
        above.fill_between(
            1e3 * x[joint], -500 * chord[joint], 500 * chord[joint], color=style.VERMILLION
        )
        for ax in (above, side):
            ax.add_patch(Circle((0.0, 0.0), 5.0, color=style.INK))
            ax.set_aspect("equal", adjustable="datalim")
            ax.set_xlim(-8.0, 1e3 * blade.tip_radius_m + 6.0)
        above.set(title="from above", ylabel="chord [mm]")
        root, tip = 1e3 * outer, 1e3 * blade.tip_radius_m
        turn = np.radians(_FOLDED_DEG)
        end = (root + (tip - root) * np.cos(turn), -(tip - root) * np.sin(turn))
        side.plot((0.0, 1e3 * inner), (0.0, 0.0), color=style.MUTED, lw=5)
        side.plot((1e3 * inner, root), (0.0, 0.0), color=style.VERMILLION, lw=5)
        side.plot((root, tip), (0.0, 0.0), color=style.BLUE, lw=4)
        side.plot((root, end[0]), (0.0, end[1]), color=style.BLUE, lw=4, alpha=0.4)
        side.add_patch(Arc((root, 0.0), 50, 50, theta1=-_FOLDED_DEG, theta2=0, color=style.INK))
        words = ((0.0, 9.0, "hub"), (500 * (inner + outer), 6.0, "nodus"), (tip - 18, 4.0, "wing"))
        for at, above_mm, text in words:
            side.text(at, above_mm, text, ha="center")
        side.text(end[0] + 4.0, end[1], "wing folded by an impact", va="center")
        side.set(title="from the side", xlabel="distance from the hub's centre [mm]")
        side.set_ylim(end[1] - 6.0, 14.0)
    return figure


def draw_frames() -> Figure:
    """Draw the vehicle from above with body axes, rotor numbers and spins, beside the map's."""
    airframe = DrawnAirframe()
    with new_figure(6.4, 5.2, _DPI) as figure:
        ax = figure.add_axes((0.02, 0.02, 0.96, 0.96))
        ax.set_aspect("equal")
        ax.set_axis_off()
        # The picture's right is y to the right of the vehicle, its top is forward.
        for number, (name, spin) in enumerate(zip(ROTOR_NAMES, SPIN, strict=True)):
            x, y = airframe.arm_length * ARM_X[number], airframe.arm_length * ARM_Y[number]
            colour = style.ROTOR_COLOURS[number]
            ax.plot((0.0, -y), (0.0, x), color=style.INK, lw=5, solid_capstyle="round", zorder=1)
            ax.add_patch(Circle((-y, x), airframe.rotor_radius, color=colour, alpha=0.25))
            arc = FancyArrowPatch(
                (-y + 0.08 * spin, x - 0.03), (-y - 0.08 * spin, x - 0.03),
                connectionstyle=f"arc3,rad={0.9 * spin}", arrowstyle="-|>", mutation_scale=14,
                color=colour, lw=2,
            )  # fmt: skip
            ax.add_patch(arc)
            ax.text(
                -y,
                x,
                str(number),
                ha="center",
                va="center",
                size=14,
                weight="bold",
                zorder=4,
                bbox={"boxstyle": "circle", "facecolor": "white", "edgecolor": "none"},
            )
            ax.text(-y, x + 0.14 * np.sign(x), name.replace("_", " "), ha="center", va="center")
        ax.add_patch(Circle((0.0, 0.0), 0.05, color=style.INK, zorder=2))
        _axes_of(
            ax, (0.0, 0.0), (((0.0, 0.2), "x forward"), ((-0.2, 0.0), "y left")), "base_link", 0.3
        )
        corner = (0.42, -0.38)
        _axes_of(ax, corner, (((0.16, 0.0), "x east"), ((0.0, 0.16), "y north")), "map", 0.07)
        ax.set(xlim=(-0.42, 0.72), ylim=(-0.5, 0.42))
    return figure


def _axes_of(
    ax: Axes,
    origin: tuple[float, float],
    arrows: Sequence[tuple[tuple[float, float], str]],
    name: str,
    below: float,
) -> None:
    x, y = origin
    for (dx, dy), text in arrows:
        ax.annotate(
            "", (x + dx, y + dy), origin,
            arrowprops={"arrowstyle": "-|>", "color": style.VERMILLION, "lw": 2},
        )  # fmt: skip
        ax.text(x + 1.12 * dx, y + 1.12 * dy, text, color=style.VERMILLION,
                ha="right" if dx < 0 else "left" if dx > 0 else "center",
                va="bottom" if dy > 0 else "center")  # fmt: skip
    ax.text(x, y - below, f"{name}, z up", color=style.MUTED, ha="center", va="top")
