"""Markers for RViz and Foxglove as messages (CDR): the obstacle and points, in map."""

from __future__ import annotations

from collections.abc import Sequence

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import stamp
from tombo_bag.topics import MARKERS
from tombo_dynamics.frames import FRAME_MAP

_CYLINDER, _SPHERE = 3, 2
RED, GREEN = (0.9, 0.2, 0.15, 1.0), (0.1, 0.6, 0.3, 1.0)
_GREY = (0.6, 0.6, 0.65, 0.8)
_POINT_DIAMETER_M = 0.12


def obstacle_marker(stamp_ns: int, obstacle: Sequence[float]) -> bytes:
    """Return the cylinder (x, y, radius, top) [m]."""
    x, y, radius, top = obstacle
    size = (2.0 * radius, 2.0 * radius, top)
    place = (x, y, 0.5 * top)
    return _marker(stamp_ns, "obstacle", _CYLINDER, place, size, _GREY)


def point_marker(
    stamp_ns: int, name: str, place: Sequence[float], colour: Sequence[float]
) -> bytes:
    """Return a point, such as x_c."""
    size = (_POINT_DIAMETER_M,) * 3
    return _marker(stamp_ns, name, _SPHERE, place, size, colour)


def _marker(
    stamp_ns: int,
    name: str,
    shape: int,
    position: Sequence[float],
    scale: Sequence[float],
    colour: Sequence[float],
) -> bytes:
    marker = {
        "header": {"stamp": stamp(stamp_ns), "frame_id": FRAME_MAP},
        "ns": name,
        "type": shape,
        "pose": {"position": dict(zip("xyz", position, strict=True)), "orientation": {"w": 1.0}},
        "scale": dict(zip("xyz", scale, strict=True)),
        "color": dict(zip("rgba", colour, strict=True)),
        "frame_locked": True,
        "text": name,
    }
    return encode(MARKERS.typename, {"markers": [marker]})
