"""Recorded and replayed drawn over each other: the detector's statistic, set points, commands."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_flight.replay.run import Replay
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure

WIDTH_IN: Final = 12.0
ROW_IN: Final = 2.4
DPI: Final = 120
_LEAST: Final = 0.05
"""Smaller statistics are drawn here."""
_AXES = ("x", "y", "z")
_COLOURS = (style.BLUE, style.GREEN, style.ORANGE)


def draw_replay(result: Replay) -> Figure:
    """Draw a row for each node that was replayed; time counts from the recording's begin."""
    rows = [(title, draw) for node, title, draw in _ROWS if node in result.nodes]
    height_in = 0.9 + ROW_IN * len(rows)
    with new_figure(WIDTH_IN, height_in, DPI, layout="constrained") as figure:
        figure.suptitle(
            f"Replay of {result.bag.name}   ·   {_verdict(result)}",
            x=0.01, ha="left", weight="bold", size=11, parse_math=False,
        )  # fmt: skip
        all_axes = figure.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (title, draw) in zip(all_axes, rows, strict=True):
            axes.set_title(title, loc="left", size=9)
            draw(axes, result)
            _key(axes)
        all_axes[-1].set_xlabel("time since the recording began [s]")
        all_axes[-1].set_xlim(0.0, max(result.duration_s, 1e-3))
    return figure


def _verdict(result: Replay) -> str:
    count = len(result.differences)
    return "no difference" if not count else f"{count} difference{'s' * (count > 1)}"


def _key(axes: Axes) -> None:
    if axes.get_legend_handles_labels()[0]:
        axes.legend(loc="center left", bbox_to_anchor=(1.0, 0.5), borderaxespad=0.6)


def _seconds(result: Replay, stamps_ns: ArrayLike) -> Array:
    """Return the time since the recording began [s]."""
    seconds: Array = (np.asarray(stamps_ns) - result.begin_ns) / 1e9
    return seconds


def _lines(
    axes: Axes, result: Replay, name: str, what: str, value: Callable[[Array], Array]
) -> None:
    """Draw a value of a series, recorded and replayed."""
    for outputs, colour, width, label in (
        (result.recorded, style.ORANGE, 3.0, "recorded"),
        (result.replayed, style.BLUE, 1.0, "replayed"),
    ):
        series = outputs.series.get(name)
        if series is not None and len(series.stamp_ns):
            axes.plot(
                _seconds(result, series.stamp_ns), value(series.values),
                color=colour, linewidth=width, label=f"{what}, {label}",
            )  # fmt: skip


def _statistic(axes: Axes, result: Replay) -> None:
    """Draw the statistic on a logarithmic axis, the threshold, and events as marks."""
    _lines(axes, result, "statistic", "statistic", lambda v: np.maximum(v[:, 0], _LEAST))
    axes.axhline(result.threshold, color=style.MUTED, linestyle="--", linewidth=0.9)
    axes.set_yscale("log")
    axes.set_ylabel("statistic")
    for contact_s in _seconds(result, result.contacts_ns or []):
        axes.axvline(contact_s, color=style.FAINT, linewidth=3.0, zorder=0)
    for events, marker, colour, label, size in (
        (result.recorded.events, "o", style.ORANGE, "event, recorded", 9.0),
        (result.replayed.events, "x", style.VERMILLION, "event, replayed", 6.0),
    ):
        if events:
            axes.plot(
                _seconds(result, [event.stamp_ns for event in events]),
                [max(event.statistic, _LEAST) for event in events], marker, color=colour,
                markersize=size, markerfacecolor="none", markeredgewidth=1.6, label=label,
            )  # fmt: skip


def _vectors(name: str, unit: str) -> Callable[[Axes, Replay], None]:
    def draw(axes: Axes, result: Replay) -> None:
        for outputs, width, alpha, label in (
            (result.recorded, 3.4, 0.35, "recorded"),
            (result.replayed, 1.1, 1.0, "replayed"),
        ):
            series = outputs.series.get(name)
            if series is None:
                continue
            for i, axis in enumerate(_AXES):
                axes.plot(
                    _seconds(result, series.stamp_ns), series.values[:, i], color=_COLOURS[i],
                    linewidth=width, alpha=alpha, label=f"{axis}, {label}",
                )  # fmt: skip
        axes.set_ylabel(unit)

    return draw


def _commands(axes: Axes, result: Replay) -> None:
    """Draw the mean command of the four rotors."""
    _lines(axes, result, "rotor_command", "mean of rotors", lambda v: v.mean(axis=1))
    axes.set_ylabel("rotor speed [rad/s]")


_ROWS: Final[tuple[tuple[str, str, Callable[[Axes, Replay], None]], ...]] = (
    ("detector", "detector: statistic, threshold, events, true contacts (grey)", _statistic),
    ("mission", "mission: set point", _vectors("mission_setpoint", "position [m]")),
    ("reaction", "reaction: set point", _vectors("setpoint", "position [m]")),
    ("estimator", "estimator: position", _vectors("odometry_position", "position [m]")),
    ("controller", "controller: rotor commands", _commands),
)
