"""A course: waypoints that a mission flies after its hover, in place of the approach."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tombo_control.planning.leg import ACCELERATION, Leg, Point, turning_leg
from tombo_control.planning.timed_course import timed_course_text
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.jit import compiled
from tombo_dynamics.params import from_mapping, param

MOST_WAYPOINTS = 500
YAW_RATE = 1.0
"""rad/s: of a course that asks for nothing else, two thirds of the controller's own limit."""


@dataclass(frozen=True)
class Waypoint:
    """A point of a course. A field that is None keeps the value of the waypoint before."""

    x: float | None = param(None, "m", (-1e3, 1e3), "map x")
    y: float | None = param(None, "m", (-1e3, 1e3), "map y")
    z: float | None = param(None, "m", (0.3, 50.0), "height")
    yaw: float | None = param(
        None, "rad", (-100.0, 100.0), "heading, not wrapped: from 0 to 6.28 is a whole turn"
    )
    speed: float | None = param(None, "m/s", (0.05, 8.0), "on the way there")
    acceleration: float | None = param(None, "m/s^2", (0.1, 6.0), "of speed, up and down")
    yaw_rate: float | None = param(None, "rad/s", (0.05, 5.0), "of a turn on the way there")
    hold: float | None = param(None, "s", (0.0, 600.0), "time there, once way and turn are over")


class ResolvedWaypoint(NamedTuple):
    """A waypoint with everything known, in the order of `Waypoint`."""

    x: float
    y: float
    z: float
    yaw: float
    speed: float
    acceleration: float
    yaw_rate: float
    hold: float


Course = tuple[Waypoint, ...]


def read_course(name: str, given: object) -> Course | str | None:
    """Return a checked course from the plain values of a scenario file.

    Args:
        name: what to call it in an error, as mission.course.
        given: a list of mappings, or `timed_course_text`'s path or text; None or an empty text:
            there is none.

    Returns:
        waypoints, or the text of a timed course.

    Raises:
        InputError: not such a list, empty, too long, or a waypoint with an unknown key or a value
            out of bounds; or as `timed_course_text`.
    """
    if given is None or given == "":
        return None
    if isinstance(given, str):
        return timed_course_text(name, given)
    accepted = (
        f"accepted: a list of 1 to {MOST_WAYPOINTS} waypoints, the path of a CSV, or null for none"
    )
    if not isinstance(given, list | tuple):
        raise InputError(f"{name}: {shown(given)} is not a list; {accepted}")
    if not 1 <= len(given) <= MOST_WAYPOINTS:
        raise InputError(f"{name}: {len(given)} waypoints; {accepted}")
    return tuple(_waypoint(f"{name}[{i}]", each) for i, each in enumerate(given))


def _waypoint(name: str, given: object) -> Waypoint:
    if isinstance(given, Waypoint):
        given = dataclasses.asdict(given)
    if not isinstance(given, Mapping):
        raise InputError(f"{name}: {shown(given)} is not a mapping of parameters")
    known = {key: value for key, value in given.items() if value is not None}
    return from_mapping(Waypoint, known, name)


def waypoint_table(course: Sequence[Waypoint] | None) -> Array:
    """Return the waypoints (N, 8) as compiled code takes them; NaN: as at the one before."""
    rows = [[getattr(w, name) for name in ResolvedWaypoint._fields] for w in course or ()]
    return np.array(rows, dtype=np.float64).reshape(-1, len(ResolvedWaypoint._fields))


@compiled(inline=False)
def resolved_waypoint(table: Array, row: int, hover: Point, speed: float) -> ResolvedWaypoint:
    """Return a waypoint of a `waypoint_table` with all fields filled in.

    Args:
        table: of the course.
        row: of the waypoint.
        hover: where the vehicle is before the first one, heading east.
        speed: of a course that does not mention it [m/s].
    """
    x, y, z = hover
    values = np.array([x, y, z, 0.0, speed, ACCELERATION, YAW_RATE, 0.0])
    for i in range(row + 1):
        for k in range(8):
            if not math.isnan(table[i, k]):
                values[k] = table[i, k]
    return ResolvedWaypoint(
        values[0], values[1], values[2], values[3], values[4], values[5], values[6], values[7]
    )


@compiled(inline=False)
def leg_to(target: ResolvedWaypoint, start: Point, yaw: float, now_s: float) -> Leg:
    """Return the leg from `start`, heading `yaw`, to a waypoint."""
    return turning_leg(
        start,
        (target.x, target.y, target.z),
        (yaw, target.yaw),
        now_s,
        target.speed,
        target.acceleration,
        target.yaw_rate,
        target.hold,
    )
