"""The collision as a moving picture: the README's GIF, with ground, obstacle, path and vehicle."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from mpl_toolkits.mplot3d.art3d import Line3DCollection, Poly3DCollection
from PIL import Image
from scipy.spatial.transform import Rotation

from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import VehicleParams
from tombo_flight.report import style
from tombo_flight.report.figures import FRONT_LEFT, FlightMilestones, find_milestones, nearest
from tombo_flight.report.flight_report import drawn_vehicle
from tombo_flight.report.style import new_figure

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
_SQUARE: Final = (0.0, 0.5 - 8.0 / 9.0, 1.0, 16.0 / 9.0)
"""Of the axes in the figure: as high as wide, cut by the figure above and below."""
_COLOURS: Final = 128
_REACH_M: Final = 1.0
"""Margin between the path and the sides of the picture."""
_GRID_M: Final = 6.0
_POSE: Final = ("position", "attitude", "fold")
"""Columns of the log that the vehicle is drawn by."""
_UP: Final = np.array((0.0, 0.0, 1.0))
_ZOOM: Final = 1.5
"""Of matplotlib's axes, which leave a margin for labels."""


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
    airframe, log = drawn_vehicle(flight.scenario), flight.log
    frames = []
    with new_figure(*_SIZE_IN, _DPI, font_size=10.0, facecolor="#F4F7F9") as figure:
        axes: Any = figure.add_axes(_SQUARE, projection="3d", computed_zorder=False)
        axes.patch.set_visible(False)
        _draw_scene(axes, flight.t[shown], log["position"][shown], milestones)
        clock = figure.text(0.03, 0.9, "", size=15.0)
        stage = figure.text(0.27, 0.9, "", size=15.0, weight="bold")
        for time_s in _times(contact_s):
            k, after_s = nearest(flight.t, time_s), time_s - contact_s
            clock.set_text(f"{'−' if after_s < 0 else '+'}{abs(after_s):.2f} s")
            stage.set_text(_stage(milestones, time_s))
            drawn = _draw_vehicle(axes, airframe, *(log[n][k] for n in _POSE))
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


def _draw_scene(axes: Any, t: Array, path: Array, milestones: FlightMilestones) -> None:
    """Draw what stands still, seen from the side and a little above."""
    middle = (path.min(axis=0) + path.max(axis=0)) / 2.0
    half_m = float(np.ptp(path, axis=0).max()) / 2.0 + _REACH_M
    axes.set(
        **{f"{axis}lim": (c - half_m, c + half_m) for axis, c in zip("xyz", middle, strict=True)}
    )
    axes.set_box_aspect((1.0, 1.0, 1.0), zoom=_ZOOM)
    axes.view_init(elev=12.0, azim=-70.0)
    axes.set_proj_type("persp", focal_length=0.7)
    axes.set_axis_off()
    _draw_ground(axes, np.round(middle))
    if milestones.obstacle is not None:
        _draw_cylinder(axes, milestones.obstacle)
    axes.plot(*path[:, :2].T, 0.0, color=style.INK, alpha=0.13, lw=1.5, zorder=2)
    colours = [_STAGE_COLOURS[_stage(milestones, float(time_s))] for time_s in t[:-1]]
    pieces = np.stack((path[:-1], path[1:]), axis=1)
    axes.add_collection(Line3DCollection(pieces, colors=colours, linewidths=2.0, zorder=5))
    if milestones.x_c_m is not None and milestones.x_r_m is not None:
        tail, tip = np.array((milestones.x_c_m, milestones.x_r_m)) + 0.25 * _UP
        axes.quiver(*tail, *(tip - tail), color=style.INK, lw=1.0, arrow_length_ratio=0.1)
        length_m = float(np.linalg.norm(tip - tail))
        words = (("$x_c$", tail), ("$x_r$", tip), (f"$n_r$, {length_m:.2f} m", (tail + tip) / 2.0))
        for text, place in words:
            axes.text(*(place + 0.04 * _UP), text, ha="center", zorder=8)
    if milestones.contact_point_m is not None:
        star = {"marker": (9, 2, 10), "ms": 20.0, "mew": 1.2, "color": style.VERMILLION}
        axes.plot(*np.array(milestones.contact_point_m)[:, None], **star, zorder=7)


def _draw_ground(axes: Any, middle: Array) -> None:
    """Draw lines 0.5 m apart that fade with the distance."""
    along, across = np.meshgrid(
        np.arange(-_GRID_M, _GRID_M, 0.25), np.arange(-_GRID_M, _GRID_M, 0.5)
    )
    lines = np.stack((along, across, 0.0 * along), axis=-1)
    points = np.concatenate((lines, lines[..., [1, 0, 2]]))
    fade = np.clip(1.0 - np.linalg.norm(points[:, :-1], axis=-1) / _GRID_M, 0.0, 1.0).ravel()
    pieces = np.stack((points[:, :-1], points[:, 1:]), axis=2).reshape(-1, 2, 3)
    pieces += middle * (1.0, 1.0, 0.0)
    colours = [(0.66, 0.71, 0.76, share**1.5) for share in fade]
    axes.add_collection(Line3DCollection(pieces, colors=colours, linewidths=0.5, zorder=1))


def _draw_cylinder(axes: Any, obstacle: Mapping[str, float]) -> None:
    foot = _circle(obstacle["radius_m"], 73) + np.array((obstacle["x_m"], obstacle["y_m"], 0.0))
    head = foot + obstacle["top_m"] * _UP
    quads = np.stack((foot[:-1], foot[1:], head[1:], head[:-1]), axis=1)
    axes.add_collection3d(
        Poly3DCollection(quads, facecolors="#A9B4BF", edgecolors="#A9B4BF", shade=True, zorder=3)
    )


def _draw_vehicle(
    axes: Any, airframe: VehicleParams, position: Array, attitude: Array, fold: Array
) -> list[Any]:
    """Draw the vehicle and the shadows of its discs; return the artists.

    A folded wing lies back in the plane of the disc: the disc that it sweeps is smaller.

    Args:
        axes: the scene.
        airframe: lengths of the vehicle.
        position: (3,) centre of mass, map ENU [m].
        attitude: (4,) quaternion xyzw, map<-base_link.
        fold: (4,) fold of each rotor, 0 stretched to 1 folded.
    """
    turn = Rotation.from_quat(attitude)

    def put(points: Any) -> Array:
        placed: Array = position + turn.apply(np.asarray(points, np.float64))
        return placed

    hubs = airframe.rotor_positions()
    low, colours = -airframe.leg_height, ["#2B3742"] * 4
    colours[FRONT_LEFT] = style.FRONT_LEFT
    sticks: list[tuple[Array, str, float]] = []
    for y in (-0.11, 0.11):
        sticks.append((put(((0.0, y / 2, 0.0), (0.0, y, low))), "#5A6672", 2.5))
        sticks.append((put(((-0.12, y, low), (0.13, y, low))), "#5A6672", 3.0))
    for (x, y, z), colour in zip(hubs, colours, strict=True):
        sticks.append((put(((0.2 * x, 0.2 * y, 0.0), (x, y, 0.0))), colour, 5.0))
        sticks.append((put(((x, y, -0.004), (x, y, z - 0.006))), "#8A959F", 7.0))
    sticks.append((put(((0.02, 0.0, 0.024), (0.06, 0.0, 0.024))), "#F2F5F7", 3.0))
    points, paints, widths = zip(*sticks, strict=True)
    wing = airframe.rotor_radius - airframe.nodus_radius
    radii = airframe.nodus_radius + wing * (1.0 - np.clip(fold, 0.0, 1.0))
    rims = [put(hub + _circle(r)) for hub, r in zip(hubs, radii, strict=True)]
    full = [put(hub + _circle(airframe.rotor_radius)) for hub in hubs]
    discs = ["#6F8CA6"] * 4
    discs[FRONT_LEFT] = style.FRONT_LEFT
    drawn = (
        Poly3DCollection([r * (1, 1, 0) for r in rims], fc=style.INK, alpha=0.08, zorder=2),
        Poly3DCollection([put(_circle(0.07, 9) + 0.022 * _UP)], fc="#43525F", zorder=6),
        Line3DCollection(points, colors=paints, linewidths=widths, zorder=6),
        Line3DCollection(full, colors=discs, linewidths=0.6, linestyles="dashed", zorder=6),
        Poly3DCollection(rims, facecolors=discs, edgecolors=discs, alpha=0.4, zorder=6),
    )
    for artist in drawn:
        axes.add_collection3d(artist)
    return list(drawn)


def _circle(radius_m: float, points: int = 49) -> Array:
    """(points, 3) closed outline of a horizontal circle about the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return radius_m * np.stack((np.cos(angle), np.sin(angle), 0.0 * angle), axis=1)
