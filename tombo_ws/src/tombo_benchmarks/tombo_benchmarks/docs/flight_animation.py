"""The collision as a moving picture: a GIF of the scene of the overview."""

from __future__ import annotations

import io
from typing import TYPE_CHECKING, Final

import numpy as np
from PIL import Image

from tombo_benchmarks.docs.overview_scene import SIZE_IN, draw_scene
from tombo_flight.report.figure import new_figure
from tombo_flight.report.milestones import FlightMilestones, find_milestones, nearest

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

_BEFORE_S: Final = 1.4
_AFTER_S: Final = 5.6
_SLOW_S: Final = (-0.1, 0.9)
"""From the contact, what is shown four times slower."""
_CONTACT_S: Final = 0.15
"""From the contact, what is called so: in slow motion 0.6 s, long enough to be read."""
_STEP_S: Final = 0.1
_FRAME_MS: Final = 100
_DPI: Final = 50
_COLOURS: Final = 48


def animation(flight: Flight) -> bytes:
    """Return a GIF of the collision of a flight, 800 x 450 px.

    Raises:
        ValueError: the flight touches nothing.
    """
    milestones = find_milestones(flight)
    if milestones.contact_s is None:
        raise ValueError("the flight touches nothing")
    times = _times(milestones.contact_s)
    frames = [_frame(flight, milestones, t) for t in times]
    first, *rest = (frame.quantize(_COLOURS, dither=Image.Dither.NONE) for frame in frames)
    buffer = io.BytesIO()
    last_ms = 1500
    durations = [_FRAME_MS] * len(rest) + [last_ms]
    first.save(buffer, "GIF", save_all=True, append_images=rest, duration=durations, loop=0)
    return buffer.getvalue()


def _times(contact_s: float) -> list[float]:
    """Return the instants of the frames; around the contact they are closer."""
    slow = np.arange(*_SLOW_S, _STEP_S / 4.0)
    before = np.arange(-_BEFORE_S, _SLOW_S[0], _STEP_S)
    after = np.arange(_SLOW_S[1], _AFTER_S, 2.0 * _STEP_S)
    return [contact_s + float(t) for t in np.concatenate((before, slow, after))]


def _stage(milestones: FlightMilestones, time_s: float) -> str:
    """Return in a word what the vehicle does at a time [s] of the flight."""
    contact_s, settled_s = milestones.contact_s or 0.0, milestones.recovery_end_s
    if time_s < contact_s:
        return "approach"
    if time_s < contact_s + _CONTACT_S:
        return "contact"
    if milestones.unstable_end_s is None or time_s < milestones.unstable_end_s:
        return "fall"
    return "recovered" if settled_s is not None and time_s >= settled_s else "return to x_r"


def _frame(flight: Flight, milestones: FlightMilestones, time_s: float) -> Image.Image:
    contact_s = milestones.contact_s or 0.0
    first, last = (nearest(flight.t, contact_s + t) for t in (-_BEFORE_S, _AFTER_S))
    after = time_s - contact_s
    with new_figure(*SIZE_IN, _DPI, font_size=20.0, facecolor="#F4F7F9") as figure:
        axes = figure.add_axes((0.0, -0.13, 1.0, 1.13))
        limits = []
        for instants in ({contact_s: "", contact_s + _AFTER_S: ""}, {time_s: ""}):
            axes.clear()
            draw_scene(axes, flight, milestones, instants, slice(first, last + 1))
            limits.append((axes.get_xlim(), axes.get_ylim()))
        axes.set(xlim=limits[0][0], ylim=limits[0][1])  # the same of all frames
        sign = "−" if after < 0 else "+"
        figure.text(0.03, 0.9, f"{sign}{abs(after):.2f} s", size=30.0)
        figure.text(0.27, 0.9, _stage(milestones, time_s), size=30.0, weight="bold")
        figure.canvas.draw()
        image = Image.frombuffer("RGBA", figure.canvas.get_width_height(),
                                 figure.canvas.buffer_rgba())  # type: ignore[attr-defined]  # fmt: skip
    return image.convert("RGB")
