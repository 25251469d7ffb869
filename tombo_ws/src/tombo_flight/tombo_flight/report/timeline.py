"""The top row of the flight's figure: the strip of phases, and the instants by name.

Of a flight over MAVLink there is a second strip: PX4's modes.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from tombo_flight.report import style
from tombo_flight.report.panel import SMALL, Panel, zoom_around

_LETTER: Final = 0.0135
"""Width of a letter as a share of the panel, generously."""
_TOP: Final = 3.6
_PX4_LOW, _PX4_MIDDLE = -1.1, -0.6
_TOGETHER_S: Final = 0.005
"""Instants this close share one name."""


def timeline(panel: Panel) -> None:
    """Draw the strip; above it, zoomed, what happened when, else where the zoom is."""
    axes, window = panel.axes, panel.window
    px4 = panel.flight.summary.get("px4")
    low = 0.0 if px4 is None else _PX4_LOW
    axes.set_ylim(low, _TOP)
    axes.set_yticks([])
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.tick_params(bottom=False)
    axes.set_ylabel("phase", rotation=0, ha="right", va="center")
    axes.yaxis.set_label_coords(-0.012, (0.5 - low) / (_TOP - low))
    for span in panel.milestones.phases:
        colour = style.PHASE_COLOURS.get(span.phase, style.FAINT)
        _bar(panel, 0.5, 1.0, (span.start_s, span.end_s), span.name, colour)
    if px4 is not None:
        _px4_modes(panel, px4["modes"])
    if window.zoomed:
        _phases(panel)
        _instants(panel)
    elif panel.milestones.mark_s is not None:
        _mark_zoom(panel, panel.milestones.mark_s)


def _bar(
    panel: Panel, y: float, height: float, span: tuple[float, float], name: str, colour: str
) -> None:
    """Draw what the window shows of a span, with its name if there is room for it."""
    window = panel.window
    start, end = max(span[0], window.start_s), min(span[1], window.end_s)
    if end <= start:
        return
    left = start - window.zero_s
    panel.axes.barh(y, end - start, left=left, height=height, color=colour, lw=0)
    if _share(panel, end - start) > _LETTER * len(name):
        middle = (start + end) / 2.0 - window.zero_s
        panel.axes.text(middle, y - 0.02, name, ha="center", va="center", size=SMALL)


def _px4_modes(panel: Panel, modes: list[list[Any]]) -> None:
    """Draw the second strip, from [time, name] of each change."""
    times = [float(time_s) for time_s, _ in modes]
    for start, end, (_, name) in zip(times, [*times[1:], np.inf], modes, strict=False):
        colour = style.PX4_COLOURS.get(name, style.FAINT)
        _bar(panel, _PX4_MIDDLE, 0.8, (start, end), name, colour)
    panel.axes.text(
        -0.012,
        _PX4_MIDDLE,
        "PX4",
        transform=panel.axes.get_yaxis_transform(),
        ha="right",
        va="center",
    )


def _share(panel: Panel, length_s: float) -> float:
    return length_s / (panel.window.end_s - panel.window.start_s)


def _phases(panel: Panel) -> None:
    """Brackets for the unstable and the recovery phase, just above the strip of phases.

    A name too long for its bracket starts with the bracket and leaves the next one less room.
    """
    milestones, window = panel.milestones, panel.window
    free_from = -np.inf
    for start, end, name, colour in (
        (milestones.contact_s, milestones.unstable_end_s, "unstable", style.VERMILLION),
        (milestones.unstable_end_s, milestones.recovery_end_s, "recovery", style.BLUE),
    ):
        if start is None or end is None or start >= window.end_s:
            continue
        a, b = start - window.zero_s, min(end, window.end_s) - window.zero_s
        panel.axes.plot((a, b), (1.3, 1.3), color=colour, lw=2.2, solid_capstyle="butt")
        words = f"{name} {end - start:.2f} s"
        length = 0.0115 * len(words) * (window.end_s - window.start_s)
        left = max((a + b - length) / 2.0, a + 0.04, free_from)
        if left + length > window.end_s - window.zero_s:
            continue
        panel.axes.text(left, 1.45, words, color=colour, ha="left", va="bottom", size=SMALL)
        free_from = left + length


def _instants(panel: Panel) -> None:
    """Names of contact, detection and switch, on lines of their own so that none covers another.

    The contact's name stands left of its line, unless the detection came first.
    """
    milestones, window, axes = panel.milestones, panel.window, panel.axes
    if milestones.contact_s is None:
        return
    later = [
        (instant - milestones.contact_s, words, colour)
        for instant, words, colour in (
            (milestones.detection_s, "detection", style.PURPLE),
            (milestones.switch_s, "set point to $x_r$", style.GREEN),
        )
        if instant is not None and window.start_s <= instant <= window.end_s
    ]
    early = any(x < 0.0 for x, _, _ in later)
    if len(later) == 2 and (early or abs(later[0][0] - later[1][0]) < _TOGETHER_S):
        later = [(later[0][0], "detection, set point to $x_r$", style.PURPLE)]
    levels = [2.6] if early else [3.35, 2.6]
    right = 0.16 + max([0.0, *(x for x, _, _ in later)])
    for (x, words, colour), level in zip(later, levels, strict=False):
        axes.plot((x, x, right), (1.1, level, level), color=colour, lw=0.9)
        text = f"{words} {1e3 * x:+.0f} ms".replace("-", "−")
        axes.text(right + 0.04, level, text, color=colour, va="center", size=SMALL)
    axes.plot((0.0, 0.0), (1.1, 3.6), color=style.INK, lw=1.1)
    x, side = (right + 0.04, "left") if early else (-0.06, "right")
    text = f"contact, $t_c$ = {milestones.contact_s:.2f} s"
    axes.text(x, 3.35, text, ha=side, va="center", weight="bold", size=SMALL)


def _mark_zoom(panel: Panel, mark_s: float) -> None:
    start, end = zoom_around(mark_s)
    end = min(end, panel.window.end_s)
    panel.axes.plot((start, end), (1.45, 1.45), color=style.INK, lw=1.0, solid_capstyle="butt")
    for edge in (start, end):
        panel.axes.plot((edge, edge), (1.25, 1.65), color=style.INK, lw=1.0)
    name = "contact" if panel.milestones.contact_s is not None else "crash"
    late = mark_s > 0.55 * panel.window.end_s
    x, side = (end, "right") if late else (start, "left")
    words = f"{name} at {mark_s:.2f} s, enlarged on the right"
    panel.axes.text(x, 1.95, words, ha=side, va="bottom", size=SMALL)
