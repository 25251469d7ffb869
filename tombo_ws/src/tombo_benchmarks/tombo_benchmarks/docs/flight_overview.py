"""Overview of a flight: the vehicle at instants around the collision, and z(t)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from tombo_benchmarks.docs.overview_scene import SIZE_IN, draw_scene, phase_colour
from tombo_collision.reactions.none import NoReaction
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.milestones import (
    FlightMilestones,
    FlightOutcome,
    find_milestones,
    nearest,
)
from tombo_flight.report.panels import envelope

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

DPI: Final = 100
BEFORE_S: Final = 3.0
AFTER_S: Final = 7.0
APPROACH_S: Final = 2.5
"""How long before the contact the first snapshot is."""


def draw_overview(flight: Flight) -> Figure:
    """Draw the collision in space, with a strip of height against time below; 1600 x 900 px.

    A flight that touches nothing is drawn with snapshots spread over its whole length.
    """
    milestones = find_milestones(flight)
    start_s, end_s = _stretch(milestones)
    instants = _apart(flight, _instants(milestones))
    with new_figure(*SIZE_IN, DPI, font_size=12.0, facecolor="#F4F7F9") as figure:
        scene = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        veil = figure.add_axes((0.0, 0.0, 1.0, 0.238), facecolor=(1.0, 1.0, 1.0, 0.9))
        strip = figure.add_axes((0.055, 0.082, 0.915, 0.125), facecolor="none")
        veil.set(xticks=[], yticks=[])
        veil.spines[:].set_visible(False)
        first, last = nearest(flight.t, start_s), nearest(flight.t, end_s)
        named = {t: _name(milestones, t) for t in instants}
        draw_scene(scene, flight, milestones, named, slice(first, last + 1))
        _strip(strip, flight, milestones, instants)
        _words(figure, milestones)
    return figure


def _stretch(milestones: FlightMilestones) -> tuple[float, float]:
    """Start and end of what the picture shows."""
    if milestones.mark_s is None:
        return 0.0, milestones.duration_s
    return max(0.0, milestones.mark_s - BEFORE_S), min(
        milestones.duration_s, milestones.mark_s + AFTER_S
    )


def _instants(milestones: FlightMilestones) -> list[float]:
    """When to draw the vehicle: far enough apart in space that the pictures do not pile up."""
    start_s, end_s = _stretch(milestones)
    zero = milestones.contact_s
    if zero is None:
        return [float(t) for t in np.linspace(start_s, end_s, 4)]
    wanted = [zero - APPROACH_S, zero]
    if milestones.verdict is FlightOutcome.CRASHED:
        wanted.append(end_s if milestones.crash_s is None else milestones.crash_s)
    elif (
        milestones.lowest_s is not None
        and milestones.falling_distance_m is not None
        and milestones.falling_distance_m > 0.2
    ):
        wanted.append(milestones.lowest_s)
    if milestones.recovery_end_s is not None:
        wanted.append(milestones.recovery_end_s)
    return [t for t in wanted if start_s <= t <= end_s]


def _apart(flight: Flight, instants: Sequence[float]) -> list[float]:
    """Leave out an instant at which the vehicle is where an earlier picture already is."""
    kept: list[float] = []
    for t in instants:
        here = flight.log["position"][nearest(flight.t, t)]
        others = [flight.log["position"][nearest(flight.t, k)] for k in kept]
        if all(np.linalg.norm(here - other) > 0.45 for other in others):
            kept.append(t)
    return kept


def _name(milestones: FlightMilestones, t: float) -> str:
    if milestones.contact_s is None:
        return f"{t:.1f} s"
    after = t - milestones.contact_s
    if after == 0.0:
        return "contact"
    names = {
        milestones.lowest_s: "lowest, ",
        milestones.recovery_end_s: "settled, ",
        milestones.crash_s: "crash, ",
    }
    what = names.get(t, "")
    return f"{what}{'−' if after < 0 else '+'}{abs(after):.1f} s"


def _strip(
    axes: Axes, flight: Flight, milestones: FlightMilestones, instants: Sequence[float]
) -> None:
    zero = milestones.mark_s or 0.0
    start, end = _stretch(milestones)
    inside = (flight.t >= start) & (flight.t <= end)
    t, z = envelope(flight.t[inside], flight.log["position"][inside, 2], 1200)
    bands = (
        (milestones.contact_s, milestones.unstable_end_s, style.UNSTABLE, "unstable"),
        (milestones.unstable_end_s, milestones.recovery_end_s, style.RECOVERY, "recovery"),
    )
    for a, b, colour, name in bands:
        if a is None or b is None or b > end:
            continue
        axes.axvspan(a - zero, b - zero, color=colour, alpha=0.42, lw=0)
        middle = (a + b) / 2 - zero
        axes.annotate(
            f"{name} {b - a:.1f} s", (middle, 1.0), (0, 3), textcoords="offset points",
            xycoords=axes.get_xaxis_transform(), ha="center", va="bottom", size=11,
        )  # fmt: skip
    points = np.stack((t - zero, z), axis=1)
    colours = [phase_colour(milestones, float(time_s)) for time_s in t[:-1]]
    segments = list(np.stack((points[:-1], points[1:]), axis=1))
    axes.add_collection(
        LineCollection(segments, colors=colours, linewidths=2.6, capstyle="round", zorder=3)
    )
    for instant in instants:
        height = float(flight.log["position"][nearest(flight.t, instant), 2])
        colour = phase_colour(milestones, instant)
        axes.plot(instant - zero, height, "o", ms=9, mfc=colour, mec="white", mew=1.5, zorder=4)
    low, high = (float(z.min()), float(z.max())) if len(z) else (0.0, 1.0)
    axes.set_xlim(start - zero, max(end - zero, start - zero + 1e-3))
    axes.set_ylim(low - 0.15 * (high - low) - 0.05, high + 0.2 * (high - low) + 0.05)
    axes.set_ylabel("height [m]")
    axes.set_xlabel("time from contact [s]" if milestones.contact_s is not None else "time [s]")


def _title(milestones: FlightMilestones) -> str:
    who = {0: "A quadrotor with rigid propellers", None: "A quadrotor"}.get(
        milestones.conf, "A Tombo quadrotor"
    )
    if milestones.verdict is FlightOutcome.RECOVERED:
        return f"{who} collides,\nfolds a propeller and recovers"
    if milestones.verdict is FlightOutcome.CRASHED:
        how = "collides" if milestones.reaction != NoReaction.name else "collides, does not react"
        return (
            f"{who} {how}\nand crashes" if milestones.contact_s is not None else f"{who} crashes"
        )
    if milestones.verdict is FlightOutcome.NO_CONTACT:
        return f"{who} flies without contact"
    return f"{who} collides"


def _words(figure: Figure, milestones: FlightMilestones) -> None:
    title = _title(milestones)
    figure.text(0.03, 0.965, title, size=20, weight="bold", va="top", linespacing=1.25)
    facts = [
        f"{milestones.name}, seed {milestones.seed}"
        if milestones.seed is not None
        else milestones.name
    ]
    if milestones.falling_distance_m is not None:
        facts.append(f"falls {milestones.falling_distance_m:.2f} m")
    if milestones.recovery_time_s is not None:
        facts.append(f"recovers in {milestones.recovery_time_s:.1f} s")
    figure.text(
        0.03,
        0.885 if "\n" in title else 0.92,
        "  ·  ".join(facts),
        size=13,
        color=style.MUTED,
        va="top",
        parse_math=False,
    )
