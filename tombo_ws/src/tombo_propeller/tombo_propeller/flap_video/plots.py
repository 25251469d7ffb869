"""Flap angle over time, and thrust traces with their recoveries."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tombo_flight.report.style import BLUE, GREEN, MUTED, RC, SKY, VERMILLION

if TYPE_CHECKING:
    from tombo_propeller.flap_video.measure import FlapMeasurement
    from tombo_propeller.flap_video.trace import RotorTrace
    from tombo_propeller.recovery import ThrustRecovery


def plot_beta(found: FlapMeasurement, path: Path) -> None:
    """Draw each window's angle with its interval, the paper's formula, and the disc's radius."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(8.0, 5.4), layout="constrained")
        angles, radii = figure.subplots(2, 1, sharex=True, height_ratios=[3, 2])
        t = np.array([w.time for w in found.windows])
        if found.steady:
            low, high = (math.degrees(a) for a in (found.overall.low, found.overall.high))
            angles.axhspan(low, high, color=SKY, alpha=0.35, lw=0, label="all windows, 95 %")
        for window in found.windows:
            for piece in window.angle.pieces:
                angles.plot([window.time] * 2, np.degrees(piece), color=BLUE, lw=2.2, alpha=0.8)
        named = [w for w in found.windows if w.angle.resolved and not w.angle.inconsistent]
        angles.plot([], [], color=BLUE, lw=2.2, label="a window, 95 %")
        angles.plot([w.time for w in named], [math.degrees(w.angle.best) for w in named], "o",
                    color=BLUE, ms=4, label="most likely, where resolved")  # fmt: skip
        angles.plot(t, np.degrees([w.paper for w in found.windows]), "x", color=VERMILLION, ms=5,
                    label="paper's formula on the hull's circle")  # fmt: skip
        angles.set_ylabel("flap β [deg]")
        angles.set_ylim(bottom=-0.3)
        angles.legend(loc="best")
        text = found.overall.as_text() if found.steady else "it changes over the film"
        figure.suptitle(f"Flap angle: {text}", fontsize=10.5)
        radius = np.array([w.radius for w in found.windows]) * 1e3
        sd = np.array([w.radius_sd for w in found.windows]) * 1e3
        radii.errorbar(t, radius, yerr=1.96 * sd, fmt="o", ms=3, color=BLUE, label="disc")
        radii.axhline(found.span.tip * 1e3, color=GREEN, lw=1.0, label="straight blades")
        radii.set_ylabel("apparent radius [mm]")
        radii.set_xlabel("time [s]")
        radii.legend(loc="best")
        figure.savefig(path, dpi=130)


def plot_recovery(
    trace: RotorTrace, found: tuple[ThrustRecovery, ...], share: float, path: Path
) -> None:
    """Draw the trace, and for each collision the time until `share` of its level is back."""
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(RC):
        figure = Figure(figsize=(8.0, 3.8), layout="constrained")
        axes: Any = figure.subplots()
        axes.plot(trace.time, trace.value, color=MUTED, lw=0.7)
        for k, r in enumerate(found):
            axes.axvline(r.time, color=VERMILLION, lw=1.0, label=None if k else "collision")
            end = r.time + (r.recovered if math.isfinite(r.recovered) else r.low)
            axes.plot([r.time, end], [share * r.level] * 2, color=GREEN, lw=1.4,
                      label=None if k else f"until {share:.0%} of the level before")  # fmt: skip
            if math.isfinite(r.high):
                axes.axvspan(r.time + r.low, r.time + r.high, color=GREEN, alpha=0.3, lw=0)
            least = "≥ " if trace.is_speed else ""
            shown = f"{least}{r.recovered:.2f} s" if not r.why else f"> {r.low:.2f} s"
            axes.annotate(shown, (0.5 * (r.time + end), share * r.level), xytext=(0, 4),
                          textcoords="offset points", ha="center", color=GREEN)  # fmt: skip
        whole = [r for r in found if not r.why]
        figure.suptitle(
            f"{len(found)} collision{'s' if len(found) > 1 else ''}, "
            f"{len(whole)} with a recovery", fontsize=10.5,
        )  # fmt: skip
        axes.set_xlabel("time [s]")
        axes.set_ylabel(f"{trace.kind} [{trace.unit}]")
        axes.legend(loc="lower right")
        figure.savefig(path, dpi=130)
