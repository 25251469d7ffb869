"""One picture that tells a flight: the vehicle at instants around the collision, and z(t)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from numpy.typing import NDArray

from tombo_bringup.report import style
from tombo_bringup.report.flight_plot import RC, envelope
from tombo_bringup.report.shapes import Airframe, Camera, Part, circle
from tombo_bringup.report.story import (
    FRONT_LEFT,
    FlightStory,
    Obstacle,
    Verdict,
    nearest,
    tell,
)

if TYPE_CHECKING:
    from tombo_bringup.flight_record import FlightRecord

Array = NDArray[np.float64]

SIZE_IN: Final = (16.0, 9.0)
DPI: Final = 100
BEFORE_S: Final = 3.0
AFTER_S: Final = 7.0
APPROACH_S: Final = 2.5
"""How long before the contact the first snapshot is."""

BACKGROUND: Final = "#F4F7F9"
_LIGHT: Final = np.array((-0.5, -0.75, 0.6)) / np.linalg.norm((-0.5, -0.75, 0.6))
_PAINT: Final = {
    "leg": "#5A6672",
    "arm": "#2B3742",
    "motor": "#8A959F",
    "side": "#26313B",
    "deck": "#43525F",
    "nose": "#F2F5F7",
}
_FREE: Final = (0.03, 0.985, 0.24, 0.93)
"""Left, right, bottom, top of the area that words and strip leave to the vehicle."""


def draw_poster(record: FlightRecord) -> Figure:
    """Draw the collision in space, with a strip of height against time below; 1600 x 900 px.

    A flight that touches nothing is drawn with snapshots spread over its whole length.
    """
    story = tell(record)
    start_s, end_s = _stretch(story)
    instants = _apart(record, _instants(story))
    with mpl.rc_context({**RC, "font.size": 12.0}):
        figure = Figure(figsize=SIZE_IN, dpi=DPI, facecolor=BACKGROUND)
        FigureCanvasAgg(figure)
        scene = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        veil = figure.add_axes((0.0, 0.0, 1.0, 0.238), facecolor=(1.0, 1.0, 1.0, 0.9))
        strip = figure.add_axes((0.055, 0.082, 0.915, 0.125), facecolor="none")
        veil.set(xticks=[], yticks=[])
        veil.spines[:].set_visible(False)
        first, last = nearest(record.t, start_s), nearest(record.t, end_s)
        _scene(scene, record, story, instants, slice(first, last + 1))
        _strip(strip, record, story, instants)
        _words(figure, story)
    return figure


def _stretch(story: FlightStory) -> tuple[float, float]:
    """Start and end of what the picture shows."""
    if story.mark_s is None:
        return 0.0, story.duration_s
    return max(0.0, story.mark_s - BEFORE_S), min(story.duration_s, story.mark_s + AFTER_S)


def _instants(story: FlightStory) -> list[float]:
    """When to draw the vehicle: far enough apart in space that the pictures do not pile up."""
    start_s, end_s = _stretch(story)
    zero = story.contact_s
    if zero is None:
        return [float(t) for t in np.linspace(start_s, end_s, 4)]
    wanted = [zero - APPROACH_S, zero]
    if story.lowest_s is not None and story.fall_m is not None and story.fall_m > 0.2:
        wanted.append(story.lowest_s)
    if story.recovery_end_s is not None:
        wanted.append(story.recovery_end_s)
    return [t for t in wanted if start_s <= t <= end_s]


def _apart(record: FlightRecord, instants: Sequence[float]) -> list[float]:
    """Leave out an instant at which the vehicle is where an earlier picture already is."""
    kept: list[float] = []
    for t in instants:
        here = record.log["position"][nearest(record.t, t)]
        others = [record.log["position"][nearest(record.t, k)] for k in kept]
        if all(np.linalg.norm(here - other) > 0.45 for other in others):
            kept.append(t)
    return kept


def _colour(story: FlightStory, time_s: float) -> str:
    """The phase's colour, the same in space and in the strip."""
    if story.contact_s is None or time_s < story.contact_s - 1e-6:
        return style.BLUE
    if story.verdict is Verdict.CRASHED:
        return style.VERMILLION
    if story.unstable_end_s is not None and time_s <= story.unstable_end_s:
        return style.VERMILLION
    if story.recovery_end_s is None or time_s < story.recovery_end_s - 1e-6:
        return style.PURPLE
    return style.GREEN


def _camera(path: Array) -> Camera:
    """Look from the side and a little above, from far enough to keep uprights upright."""
    middle = (path.min(axis=0) + path.max(axis=0)) / 2.0
    heading, lift = np.radians(-70.0), np.radians(12.0)
    away = (np.cos(lift) * np.cos(heading), np.cos(lift) * np.sin(heading), np.sin(lift))
    distance = max(5.0, 2.2 * float(np.ptp(path, axis=0).max()))
    return Camera(eye=middle + distance * np.array(away), target=middle)


def _frame(axes: Axes, camera: Camera, path: Array, story: FlightStory) -> None:
    """Set the limits so that the path, with a vehicle's room about it, fills the free area."""
    corners = np.array(
        [(x, y, z) for x in (-0.38, 0.38) for y in (-0.3, 0.3) for z in (-0.27, 0.36)]
    )
    points = (path[:, None, :] + corners).reshape(-1, 3)
    if story.obstacle is not None and story.x_c_m is not None:
        edge = story.obstacle.x_m + story.obstacle.radius_m
        points = np.vstack((points, (edge, story.obstacle.y_m, story.x_c_m[2])))
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


def _scene(
    axes: Axes,
    record: FlightRecord,
    story: FlightStory,
    instants: Sequence[float],
    window: slice,
) -> None:
    step = max(1, (window.stop - window.start) // 900)
    path_t, path = record.t[window][::step], record.log["position"][window][::step]
    camera = _camera(path)
    _frame(axes, camera, path, story)
    axes.set_axis_off()
    _ground(axes, camera)
    axes.plot(*_flat(camera, path * (1.0, 1.0, 0.0)), color=style.INK, alpha=0.13, lw=2.0)
    if story.obstacle is not None:
        _cylinder(axes, camera, story.obstacle)
    seen = camera.project(path)[:, :2]
    axes.add_collection(
        LineCollection(
            list(np.stack((seen[:-1], seen[1:]), axis=1)),
            colors=[_colour(story, float(time_s)) for time_s in path_t[:-1]],
            linewidths=3.0,
            capstyle="round",
            zorder=5,
        )
    )
    _bounce(axes, camera, story)
    _burst(axes, camera, story)
    airframe = Airframe.of(record.scenario)
    places = [(t, nearest(record.t, t)) for t in instants]
    places.sort(key=lambda place: -camera.project(record.log["position"][place[1]])[2])
    for t, i in places:
        folded = _most_folded(record, i) if t == story.contact_s else i
        parts = airframe.parts(
            record.log["position"][i], record.log["attitude"][i], record.log["fold"][folded]
        )
        _vehicle(axes, camera, parts)
        below = camera.project(record.log["position"][i] - (0.0, 0.0, 0.21))[:2]
        axes.text(
            *below, _name(story, t), ha="center", va="top", size=12.5, weight="bold",
            color=_colour(story, t), zorder=8,
        )  # fmt: skip


def _most_folded(record: FlightRecord, i: int) -> int:
    """The sample within 60 ms after `i` at which the propellers are folded most."""
    ahead = record.log["fold"][i : i + 60].sum(axis=1)
    return i + int(np.argmax(ahead))


def _flat(camera: Camera, points: Array) -> Array:
    """(N, 3) map points to the rows x, y of the picture."""
    rows: Array = camera.project(points)[:, :2].T
    return rows


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


def _cylinder(axes: Axes, camera: Camera, obstacle: Obstacle) -> None:
    foot = circle(obstacle.radius_m, 0.0, 73) + (obstacle.x_m, obstacle.y_m, 0.0)
    head = foot + (0.0, 0.0, obstacle.top_m)
    normals = circle(1.0, 0.0, 145)[1::2]
    quads, colours = [], []
    for k, normal in enumerate(normals):
        if normal @ (camera.eye - foot[k]) > 0.0:
            quads.append(_flat(camera, np.array((foot[k], foot[k + 1], head[k + 1], head[k]))).T)
            light = 0.70 + 0.50 * max(0.0, float(normal @ _LIGHT))
            colours.append(np.clip(np.array(to_rgb("#A9B4BF")) * light, 0.0, 1.0))
    axes.add_collection(PolyCollection(quads, fc=colours, ec=colours, lw=0.6, zorder=3))
    axes.fill(*_flat(camera, head), fc="#D5DCE2", ec="#98A4AF", lw=0.8, zorder=3.1)


def _bounce(axes: Axes, camera: Camera, story: FlightStory) -> None:
    """A dimension line from x_c to x_r, above the vehicles, and the point of contact."""
    if story.x_c_m is None or story.x_r_m is None:
        return
    lift = np.array((0.0, 0.0, 0.22))
    ends = [np.array(story.x_c_m), np.array(story.x_r_m)]
    for end in ends:
        axes.plot(
            *_flat(camera, np.array((end, end + 1.1 * lift))), color=style.INK, lw=0.9, zorder=4
        )
    tail, tip = (camera.project(end + lift)[:2] for end in ends)
    arrow = {"arrowstyle": "-|>,head_width=0.35,head_length=0.8", "color": style.INK, "lw": 1.5}
    axes.annotate("", tip, tail, arrowprops={**arrow, "shrinkA": 0, "shrinkB": 0}, zorder=4)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    for point, words, side in (
        ((tail + tip) / 2, f"$n_r$, {length:.2f} m", "center"),
        (camera.project(ends[0] + 1.1 * lift)[:2], "$x_c$", "center"),
        (camera.project(ends[1] + 1.1 * lift)[:2], "$x_r$", "center"),
    ):
        axes.annotate(
            words,
            point,
            (0, 5),
            textcoords="offset points",
            size=14,
            ha=side,
            va="bottom",
            zorder=8,
        )


def _burst(axes: Axes, camera: Camera, story: FlightStory) -> None:
    """Rays at the point of contact."""
    if story.contact_point_m is None:
        return
    x, y = camera.project(np.array(story.contact_point_m))[:2]
    ray = np.array((0.007, 0.016)) * (axes.get_xlim()[1] - axes.get_xlim()[0])
    for angle in np.radians(np.arange(0.0, 360.0, 40.0) + 10.0):
        axes.plot(
            x + ray * np.cos(angle), y + ray * np.sin(angle), color=style.VERMILLION, lw=2.2,
            solid_capstyle="round", zorder=7,
        )  # fmt: skip


def _vehicle(axes: Axes, camera: Camera, parts: Sequence[Part]) -> None:
    for part in parts:
        if part.kind == "disc":
            shadow = _flat(camera, part.points_m * (1.0, 1.0, 0.0))
            axes.fill(*shadow, color=style.INK, alpha=0.08, lw=0, zorder=2)

    def depth(part: Part) -> float:
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


def _name(story: FlightStory, t: float) -> str:
    if story.contact_s is None:
        return f"{t:.1f} s"
    after = t - story.contact_s
    if after == 0.0:
        return "contact"
    what = {story.lowest_s: "lowest, ", story.recovery_end_s: "settled, "}.get(t, "")
    return f"{what}{'−' if after < 0 else '+'}{abs(after):.1f} s"


def _strip(
    axes: Axes, record: FlightRecord, story: FlightStory, instants: Sequence[float]
) -> None:
    zero = story.mark_s or 0.0
    start, end = _stretch(story)
    inside = (record.t >= start) & (record.t <= end)
    t, z = envelope(record.t[inside], record.log["position"][inside, 2], 1200)
    bands = (
        (story.contact_s, story.unstable_end_s, style.UNSTABLE, "unstable"),
        (story.unstable_end_s, story.recovery_end_s, style.RECOVERY, "recovery"),
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
    colours = [_colour(story, float(time_s)) for time_s in t[:-1]]
    segments = list(np.stack((points[:-1], points[1:]), axis=1))
    axes.add_collection(
        LineCollection(segments, colors=colours, linewidths=2.6, capstyle="round", zorder=3)
    )
    for instant in instants:
        height = float(record.log["position"][nearest(record.t, instant), 2])
        axes.plot(
            instant - zero, height, "o", ms=9, mfc=_colour(story, instant), mec="white", mew=1.5,
            zorder=4,
        )  # fmt: skip
    low, high = (float(z.min()), float(z.max())) if len(z) else (0.0, 1.0)
    axes.set_xlim(start - zero, max(end - zero, start - zero + 1e-3))
    axes.set_ylim(low - 0.15 * (high - low) - 0.05, high + 0.2 * (high - low) + 0.05)
    axes.set_ylabel("height [m]")
    axes.set_xlabel("time from contact [s]" if story.contact_s is not None else "time [s]")


def _words(figure: Figure, story: FlightStory) -> None:
    titles = {
        Verdict.RECOVERED: "A Tombo quadrotor collides,\nfolds a propeller and recovers",
        Verdict.CRASHED: "A Tombo quadrotor crashes",
        Verdict.NO_CONTACT: "A Tombo quadrotor flies without contact",
        Verdict.NOT_SETTLED: "A Tombo quadrotor collides",
    }
    title = titles[story.verdict]
    figure.text(0.03, 0.965, title, size=20, weight="bold", va="top", linespacing=1.25)
    facts = [f"{story.name}, seed {story.seed}" if story.seed is not None else story.name]
    if story.fall_m is not None:
        facts.append(f"falls {story.fall_m:.2f} m")
    if story.contact_s is not None and story.recovery_end_s is not None:
        facts.append(f"recovers in {story.recovery_end_s - story.contact_s:.1f} s")
    figure.text(
        0.03,
        0.885 if "\n" in title else 0.92,
        "  ·  ".join(facts),
        size=13,
        color=style.MUTED,
        va="top",
        parse_math=False,
    )
