"""The collision in space for the poster: ground, obstacle, path and vehicle, seen by a camera."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.patheffects import withStroke

from tombo_dynamics.arrays import Array
from tombo_flight.report import style
from tombo_flight.report.milestones import (
    FRONT_LEFT,
    DrawnObstacle,
    FlightMilestones,
    FlightOutcome,
    nearest,
)
from tombo_flight.report.replay_data import Camera, DrawnAirframe, VehiclePart, circle

if TYPE_CHECKING:
    from tombo_bag.flight import Flight

SIZE_IN: Final = (16.0, 9.0)
_FREE: Final = (0.03, 0.985, 0.24, 0.93)
"""Left, right, bottom, top of the area that words and strip leave to the vehicle."""
_LIGHT: Final = np.array((-0.5, -0.75, 0.6)) / np.linalg.norm((-0.5, -0.75, 0.6))
_PAINT: Final = {
    "leg": "#5A6672",
    "arm": "#2B3742",
    "motor": "#8A959F",
    "side": "#26313B",
    "deck": "#43525F",
    "nose": "#F2F5F7",
}


def phase_colour(milestones: FlightMilestones, time_s: float) -> str:
    """The phase's colour, the same in space and in the strip."""
    if milestones.contact_s is None or time_s < milestones.contact_s - 1e-6:
        return style.BLUE
    if milestones.verdict is FlightOutcome.CRASHED:
        return style.VERMILLION
    if milestones.unstable_end_s is not None and time_s <= milestones.unstable_end_s:
        return style.VERMILLION
    if milestones.recovery_end_s is None or time_s < milestones.recovery_end_s - 1e-6:
        return style.PURPLE
    return style.GREEN


def _camera(path: Array) -> Camera:
    """Look from the side and a little above, from far enough to keep uprights upright."""
    middle = (path.min(axis=0) + path.max(axis=0)) / 2.0
    heading, lift = np.radians(-70.0), np.radians(12.0)
    away = (np.cos(lift) * np.cos(heading), np.cos(lift) * np.sin(heading), np.sin(lift))
    distance = max(5.0, 2.2 * float(np.ptp(path, axis=0).max()))
    return Camera(eye=middle + distance * np.array(away), target=middle)


def _in_sight(
    milestones: FlightMilestones, path: Array, vehicles: Sequence[Sequence[VehiclePart]]
) -> Array:
    """Points that the picture must hold: path, vehicles with their names, obstacle, x_c, x_r."""
    seen = [path]
    for parts in vehicles:
        points = np.vstack([part.points_m for part in parts])
        seen += [points, points - np.array((0.0, 0.0, 0.15))]
    for place in (milestones.x_c_m, milestones.x_r_m):
        if place is not None:
            seen.append(np.array([place]) + np.array((0.0, 0.0, 0.34)))
    if milestones.obstacle is not None and milestones.x_c_m is not None:
        edge = milestones.obstacle.x_m + milestones.obstacle.radius_m
        seen.append(np.array([(edge, milestones.obstacle.y_m, milestones.x_c_m[2])]))
    return np.vstack(seen)


def _frame(axes: Axes, camera: Camera, points: Array) -> None:
    """Set the limits so that these points fill the free area."""
    seen = camera.project(points)[:, :2]
    low, high = seen.min(axis=0), seen.max(axis=0)
    left, right, bottom, top = _FREE
    least = 1.6 / float(np.linalg.norm(camera.eye - camera.target))
    wide = max(
        (high[0] - low[0]) / (right - left),
        (high[1] - low[1]) / (top - bottom) * SIZE_IN[0] / SIZE_IN[1],
        least,
    )
    tall = wide * SIZE_IN[1] / SIZE_IN[0]
    x0 = (low[0] + high[0]) / 2.0 - wide * (left + right) / 2.0
    y0 = (low[1] + high[1]) / 2.0 - tall * (bottom + top) / 2.0
    axes.set_xlim(x0, x0 + wide)
    axes.set_ylim(y0, y0 + tall)


def draw_scene(
    axes: Axes,
    flight: Flight,
    milestones: FlightMilestones,
    instants: Mapping[float, str],
    window: slice,
) -> None:
    """Fill the axes with the samples of `window`, and the vehicle at the instants by name."""
    step = max(1, (window.stop - window.start) // 900)
    path_t, path = flight.t[window][::step], flight.log["position"][window][::step]
    camera = _camera(path)
    vehicles = _vehicles(flight, milestones, instants)
    _frame(axes, camera, _in_sight(milestones, path, list(vehicles.values())))
    axes.set_axis_off()
    _ground(axes, camera)
    axes.plot(*_flat(camera, path * (1.0, 1.0, 0.0)), color=style.INK, alpha=0.13, lw=2.0)
    if milestones.obstacle is not None:
        _cylinder(axes, camera, milestones.obstacle)
    seen = camera.project(path)[:, :2]
    axes.add_collection(
        LineCollection(
            list(np.stack((seen[:-1], seen[1:]), axis=1)),
            colors=[phase_colour(milestones, float(time_s)) for time_s in path_t[:-1]],
            linewidths=3.0,
            capstyle="round",
            zorder=5,
        )
    )
    _bounce(axes, camera, milestones)
    _burst(axes, camera, milestones)
    order = sorted(vehicles, key=lambda t: -_depth(camera, vehicles[t]))
    for t in order:
        _vehicle(axes, camera, vehicles[t])
        _name_below(axes, camera, vehicles[t], instants[t], phase_colour(milestones, t))


def _vehicles(
    flight: Flight, milestones: FlightMilestones, instants: Mapping[float, str]
) -> dict[float, list[VehiclePart]]:
    """The vehicle's pieces at each instant; at contact folded as it is just after."""
    airframe = DrawnAirframe.of(flight.scenario)
    positions, attitudes, folds = (flight.log[k] for k in ("position", "attitude", "fold"))
    vehicles = {}
    for t in instants:
        i = nearest(flight.t, t)
        folded = _most_folded(flight, i) if t == milestones.contact_s else i
        vehicles[t] = airframe.parts(positions[i], attitudes[i], folds[folded])
    return vehicles


def _depth(camera: Camera, parts: Sequence[VehiclePart]) -> float:
    return float(np.mean([camera.project(part.points_m)[:, 2].mean() for part in parts]))


def _name_below(
    axes: Axes, camera: Camera, parts: Sequence[VehiclePart], name: str, colour: str
) -> None:
    seen = np.vstack([camera.project(part.points_m)[:, :2] for part in parts])
    left, right = axes.get_xlim()
    axes.text(
        float(seen[:, 0].min() + seen[:, 0].max()) / 2.0,
        float(seen[:, 1].min()) - 0.012 * (right - left),
        name,
        ha="center",
        va="top",
        size=12.5,
        weight="bold",
        color=colour,
        zorder=8,
        path_effects=[withStroke(linewidth=3.5, foreground="#F4F7F9")],
    )


def _most_folded(flight: Flight, i: int) -> int:
    """The sample within 60 ms after `i` at which the propellers are folded most."""
    ahead = flight.log["fold"][i : i + 60].sum(axis=1)
    return i + int(np.argmax(ahead))


def _flat(camera: Camera, points: Array) -> Array:
    """(N, 3) map points to the rows x, y of the picture."""
    rows: Array = camera.project(points)[:, :2].T
    return rows


def _spot(camera: Camera, point: Array) -> tuple[float, float]:
    x, y, _ = camera.project(point)
    return float(x), float(y)


def _width(axes: Axes, camera: Camera, points: Array, thickness_m: float) -> float:
    """Line width in typographic points of something `thickness_m` thick at these points."""
    depth = float(camera.project(points)[:, 2].mean())
    left, right = axes.get_xlim()
    return thickness_m / depth / (right - left) * SIZE_IN[0] * 72.0


def _ground(axes: Axes, camera: Camera) -> None:
    cx, cy = np.round(camera.target[:2])
    reach = 14.0
    pieces, colours, widths = [], [], []
    for k in np.arange(-reach, reach + 0.25, 0.5):
        along = np.linspace(-reach, reach, 80)
        still = np.full_like(along, k)
        for line in (
            np.stack((cx + still, cy + along, 0.0 * along), axis=1),
            np.stack((cx + along, cy + still, 0.0 * along), axis=1),
        ):
            seen = camera.project(line)
            far = np.linalg.norm(line[:, :2] - camera.target[:2], axis=1) / reach
            fade = np.clip(1.0 - far, 0.0, 1.0) ** 1.5
            for a in np.flatnonzero((seen[:-1, 2] > 0.5) & (fade[:-1] > 0.02)):
                pieces.append(seen[a : a + 2, :2])
                colours.append((0.66, 0.71, 0.76, float(fade[a])))
                widths.append(1.2 if float(k).is_integer() else 0.6)
    axes.add_collection(LineCollection(pieces, colors=colours, linewidths=widths, zorder=1))


def _cylinder(axes: Axes, camera: Camera, obstacle: DrawnObstacle) -> None:
    foot = circle(obstacle.radius_m, 0.0, 73) + np.array((obstacle.x_m, obstacle.y_m, 0.0))
    head = foot + np.array((0.0, 0.0, obstacle.top_m))
    normals = circle(1.0, 0.0, 145)[1::2]
    quads, colours = [], []
    for k, normal in enumerate(normals):
        if normal @ (camera.eye - foot[k]) > 0.0:
            quads.append(_flat(camera, np.array((foot[k], foot[k + 1], head[k + 1], head[k]))).T)
            light = 0.70 + 0.50 * max(0.0, float(normal @ _LIGHT))
            colours.append(np.clip(np.array(to_rgb("#A9B4BF")) * light, 0.0, 1.0))
    axes.add_collection(PolyCollection(quads, fc=colours, ec=colours, lw=0.6, zorder=3))
    axes.fill(*_flat(camera, head), fc="#D5DCE2", ec="#98A4AF", lw=0.8, zorder=3.1)


def _bounce(axes: Axes, camera: Camera, milestones: FlightMilestones) -> None:
    """A dimension line from x_c to x_r, above the vehicles, and the point of contact."""
    if milestones.x_c_m is None or milestones.x_r_m is None:
        return
    lift = np.array((0.0, 0.0, 0.22))
    ends = [np.array(milestones.x_c_m), np.array(milestones.x_r_m)]
    for end in ends:
        axes.plot(
            *_flat(camera, np.array((end, end + 1.1 * lift))), color=style.INK, lw=0.9, zorder=4
        )
    tail, tip = (_spot(camera, end + lift) for end in ends)
    arrow = {"arrowstyle": "-|>,head_width=0.35,head_length=0.8", "color": style.INK, "lw": 1.5}
    axes.annotate("", tip, tail, arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0}, zorder=4)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    for spot, words in (
        (((tail[0] + tip[0]) / 2.0, (tail[1] + tip[1]) / 2.0), f"$n_r$, {length:.2f} m"),
        (_spot(camera, ends[0] + 1.1 * lift), "$x_c$"),
        (_spot(camera, ends[1] + 1.1 * lift), "$x_r$"),
    ):
        axes.annotate(
            words,
            spot,
            (0, 5),
            textcoords="offset points",
            size=14,
            ha="center",
            va="bottom",
            zorder=8,
        )


def _burst(axes: Axes, camera: Camera, milestones: FlightMilestones) -> None:
    """Rays at the point of contact."""
    if milestones.contact_point_m is None:
        return
    x, y = camera.project(np.array(milestones.contact_point_m))[:2]
    ray = np.array((0.007, 0.016)) * (axes.get_xlim()[1] - axes.get_xlim()[0])
    for angle in np.radians(np.arange(0.0, 360.0, 40.0) + 10.0):
        axes.plot(
            x + ray * np.cos(angle), y + ray * np.sin(angle), color=style.VERMILLION, lw=2.2,
            solid_capstyle="round", zorder=7,
        )  # fmt: skip


def _vehicle(axes: Axes, camera: Camera, parts: Sequence[VehiclePart]) -> None:
    for part in parts:
        if part.kind == "disc":
            shadow = _flat(camera, part.points_m * (1.0, 1.0, 0.0))
            axes.fill(*shadow, color=style.INK, alpha=0.08, lw=0, zorder=2)

    def depth(part: VehiclePart) -> float:
        nearer = {"disc": 0.02, "deck": 0.03, "nose": 0.04}.get(part.kind, 0.0)
        return float(camera.project(part.points_m)[:, 2].mean()) - nearer

    for part in sorted(parts, key=depth, reverse=True):
        shape = _flat(camera, part.points_m)
        width = _width(axes, camera, part.points_m, part.thickness_m)
        if part.kind in ("disc", "ghost"):
            paint = style.FRONT_LEFT if part.rotor == FRONT_LEFT else "#6F8CA6"
            if part.kind == "ghost":
                axes.plot(*shape, color=paint, lw=1.2, ls=(0, (3, 2)), zorder=6)
            else:
                axes.fill(*shape, fc=(*to_rgb(paint), 0.34), ec=paint, lw=width, zorder=6)
        elif part.kind in ("side", "deck"):
            axes.fill(*shape, fc=_PAINT[part.kind], ec=_PAINT[part.kind], lw=0.5, zorder=6)
        else:
            front_left = part.rotor == FRONT_LEFT and part.kind == "arm"
            paint = "#A34700" if front_left else _PAINT[part.kind]
            axes.plot(*shape, color=paint, lw=width, solid_capstyle="round", zorder=6)
