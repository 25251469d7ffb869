"""The collision as a moving picture: the README's GIF, with ground, obstacle, path and vehicle."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from PIL import Image

from tombo_benchmarks.docs.drawn_vehicle import Camera, VehiclePart, circle, vehicle_parts
from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.figure import new_figure
from tombo_flight.report.milestones import (
    FRONT_LEFT,
    DrawnObstacle,
    FlightMilestones,
    find_milestones,
    nearest,
)
from tombo_flight.report.replay_data import DrawnAirframe

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

_BEFORE_S: Final = 1.4
_AFTER_S: Final = 5.6
_SLOW_S: Final = (-0.1, 0.9)
"""Interval around the contact that is shown four times slower."""
_CONTACT_S: Final = 0.15
"""Time after the contact with that label: in slow motion 0.6 s, long enough to be read."""
_STEP_S: Final = 0.1
_FRAME_MS, _LAST_MS = 100, 1500
_SIZE_IN, _DPI = (8.0, 4.5), 100
_COLOURS: Final = 128
_REACH_M: Final = 0.45
"""From the path to the limits of the picture: the vehicle's half width, with its names."""
_GRID_M: Final = 14.0
_PAINT: Final = {
    "leg": "#5A6672", "arm": "#2B3742", "motor": "#8A959F", "side": "#26313B", "deck": "#43525F",
    "nose": "#F2F5F7", "disc": "#6F8CA6", "ghost": "#6F8CA6",
}  # fmt: skip
_PAINT_FRONT_LEFT: Final = {
    **_PAINT, "arm": "#A34700", "disc": style.FRONT_LEFT, "ghost": style.FRONT_LEFT,
}  # fmt: skip
_NEARER_M: Final = {"disc": 0.02, "deck": 0.03, "nose": 0.04}
"""Parts that are drawn over others at the same distance."""


def animation(flight: Flight) -> bytes:
    """Return a GIF of the collision of a flight, 800 x 450 px.

    Raises:
        ValueError: the flight touches nothing.
    """
    milestones = find_milestones(flight)
    contact_s = milestones.contact_s
    if contact_s is None:
        raise ValueError("the flight touches nothing")
    first, last = (nearest(flight.t, contact_s + t) for t in (-_BEFORE_S, _AFTER_S))
    shown = slice(first, last + 1, 8)
    airframe, log = DrawnAirframe.of(flight.scenario), flight.log
    frames = []
    with new_figure(*_SIZE_IN, _DPI, font_size=10.0, facecolor="#F4F7F9") as figure:
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        camera = _draw_scene(axes, flight.t[shown], log["position"][shown], milestones)
        clock = figure.text(0.03, 0.9, "", size=15.0)
        stage = figure.text(0.27, 0.9, "", size=15.0, weight="bold")
        for time_s in _times(contact_s):
            k, after_s = nearest(flight.t, time_s), time_s - contact_s
            clock.set_text(f"{'−' if after_s < 0 else '+'}{abs(after_s):.2f} s")
            stage.set_text(_stage(milestones, time_s))
            pose = (log[name][k] for name in ("position", "attitude", "fold"))
            parts = vehicle_parts(airframe, *pose)
            drawn = _draw_vehicle(axes, camera, parts)
            figure.canvas.draw()
            picture = np.asarray(figure.canvas.buffer_rgba())  # type: ignore[attr-defined]
            image = Image.fromarray(picture[:, :, :3].copy())
            frames.append(image.quantize(_COLOURS, dither=Image.Dither.NONE))
            for artist in drawn:
                artist.remove()
    buffer, durations = io.BytesIO(), [_FRAME_MS] * (len(frames) - 1) + [_LAST_MS]
    frames[0].save(
        buffer, "GIF", save_all=True, append_images=frames[1:], duration=durations, loop=0
    )
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


_STAGE_COLOURS: Final = {
    "approach": style.BLUE, "contact": style.VERMILLION, "fall": style.VERMILLION,
    "return to x_r": style.PURPLE, "recovered": style.GREEN,
}  # fmt: skip


def _draw_scene(axes: Axes, t: Array, path: Array, milestones: FlightMilestones) -> Camera:
    """Draw what stands still, seen from the side and a little above; return the camera."""
    middle = (path.min(axis=0) + path.max(axis=0)) / 2.0
    heading, lift = np.radians(-70.0), np.radians(12.0)
    away = (np.cos(lift) * np.cos(heading), np.cos(lift) * np.sin(heading), np.sin(lift))
    distance_m = max(5.0, 2.2 * float(np.ptp(path, axis=0).max()))
    camera = Camera(eye=middle + distance_m * np.array(away), target=middle)
    axes.set_axis_off()
    _draw_ground(axes, camera)
    if milestones.obstacle is not None:
        _draw_cylinder(axes, camera, milestones.obstacle)
    axes.plot(*_flat(camera, path * (1.0, 1.0, 0.0)), color=style.INK, alpha=0.13, lw=1.5)
    seen = _flat(camera, path).T
    pieces = np.stack((seen[:-1], seen[1:]), axis=1)
    colours = [_STAGE_COLOURS[_stage(milestones, float(time_s))] for time_s in t[:-1]]
    axes.add_collection(LineCollection(list(pieces), colors=colours, linewidths=2.0, zorder=5))
    if milestones.x_c_m is not None and milestones.x_r_m is not None:
        above = np.array((milestones.x_c_m, milestones.x_r_m)) + np.array((0.0, 0.0, 0.22))
        tail, tip = _flat(camera, above).T
        arrow = {"arrowstyle": "-|>", "color": style.INK, "shrinkA": 0, "shrinkB": 0}
        axes.annotate("", tip, tail, arrowprops=arrow, zorder=4)
        length_m = float(np.linalg.norm(above[1] - above[0]))
        words = (("$x_c$", tail), ("$x_r$", tip), (f"$n_r$, {length_m:.2f} m", (tail + tip) / 2.0))
        for text, place in words:
            axes.annotate(text, place, (0, 4), textcoords="offset points", ha="center", zorder=8)
    if milestones.contact_point_m is not None:
        spot = _flat(camera, np.array(milestones.contact_point_m))
        axes.plot(*spot, marker=(9, 2, 10), ms=20.0, mew=1.2, color=style.VERMILLION, zorder=7)
    corners = path[:, None] + _REACH_M * np.array(((-1.0, 0.0, -0.8), (1.0, 0.0, 1.4)))
    low, high = (getattr(_flat(camera, corners.reshape(-1, 3)), end)(axis=1) for end in
                 ("min", "max"))  # fmt: skip
    size = float(np.max((high - low) / _SIZE_IN)) * np.array(_SIZE_IN)
    (left, bottom), (right, top) = (low + high - size) / 2.0, (low + high + size) / 2.0
    axes.set(xlim=(left, right), ylim=(bottom, top))
    return camera


def _flat(camera: Camera, points: Array) -> Array:
    """(N, 3) map points to the rows x, y of the picture."""
    rows: Array = camera.project(points)[..., :2].T
    return rows


def _draw_ground(axes: Axes, camera: Camera) -> None:
    """Draw lines 0.5 m apart that fade with the distance."""
    along, across = np.meshgrid(np.arange(-_GRID_M, _GRID_M, 0.35),
                                np.arange(-_GRID_M, _GRID_M, 0.5))  # fmt: skip
    lines = np.stack((along, across, 0.0 * along), axis=-1)
    points = np.concatenate((lines, lines[..., [1, 0, 2]]))
    far = np.linalg.norm(points[:, :-1], axis=-1) / _GRID_M
    seen = camera.project(points + np.round(camera.target) * (1.0, 1.0, 0.0))
    there = (seen[:, :-1, 2] > 0.5) & (far < 0.95)
    pieces = np.stack((seen[:, :-1, :2], seen[:, 1:, :2]), axis=2)[there]
    colours = [(0.66, 0.71, 0.76, (1.0 - share) ** 1.5) for share in far[there]]
    axes.add_collection(LineCollection(list(pieces), colors=colours, linewidths=0.5, zorder=1))


def _draw_cylinder(axes: Axes, camera: Camera, obstacle: DrawnObstacle) -> None:
    foot = circle(obstacle.radius_m, 0.0, 73) + np.array((obstacle.x_m, obstacle.y_m, 0.0))
    head = foot + np.array((0.0, 0.0, obstacle.top_m))
    light = np.array((-0.5, -0.75, 0.6)) / np.linalg.norm((-0.5, -0.75, 0.6))
    quads, colours = [], []
    for k, normal in enumerate(circle(1.0, 0.0, 145)[1::2]):
        if normal @ (camera.eye - foot[k]) > 0.0:
            quads.append(_flat(camera, np.array((foot[k], foot[k + 1], head[k + 1], head[k]))).T)
            bright = 0.70 + 0.50 * max(0.0, float(normal @ light))
            colours.append(np.clip(np.array(to_rgb("#A9B4BF")) * bright, 0.0, 1.0))
    axes.add_collection(PolyCollection(quads, fc=colours, ec=colours, lw=0.6, zorder=3))


def _draw_vehicle(axes: Axes, camera: Camera, parts: Sequence[VehiclePart]) -> list[Artist]:
    """Draw the parts, the farthest first, and the shadows of the discs; return what was drawn."""
    left, right = axes.get_xlim()
    points_per_unit = _SIZE_IN[0] * 72.0 / (right - left)
    drawn: list[Artist] = []
    for part in parts:
        if part.kind == "disc":
            shadow = _flat(camera, part.points_m * (1.0, 1.0, 0.0))
            drawn += axes.fill(*shadow, color=style.INK, alpha=0.08, lw=0, zorder=2)

    def depth_m(part: VehiclePart) -> float:
        return float(camera.project(part.points_m)[:, 2].mean()) - _NEARER_M.get(part.kind, 0.0)

    for part in sorted(parts, key=depth_m, reverse=True):
        shape, kind = _flat(camera, part.points_m), part.kind
        paint = (_PAINT_FRONT_LEFT if part.rotor == FRONT_LEFT else _PAINT)[kind]
        width = part.thickness_m / depth_m(part) * points_per_unit
        if kind == "ghost":
            drawn += axes.plot(*shape, color=paint, lw=0.6, ls=(0, (3, 2)), zorder=6)
        elif kind == "disc":
            drawn += axes.fill(*shape, fc=(*to_rgb(paint), 0.34), ec=paint, lw=width, zorder=6)
        elif kind in ("side", "deck"):
            drawn += axes.fill(*shape, fc=paint, ec=paint, lw=0.3, zorder=6)
        else:
            drawn += axes.plot(*shape, color=paint, lw=width, solid_capstyle="round", zorder=6)
    return drawn
