"""Markers for RViz and Foxglove as messages (CDR): obstacle, discs, points; all in map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from tombo_bag.columnar_cdr import encode
from tombo_bag.flight_time import stamp
from tombo_bag.topics import MARKERS
from tombo_dynamics.frames import FRAME_MAP

_CYLINDER, _SPHERE = 3, 2
_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
RED, GREEN = (0.9, 0.2, 0.15, 1.0), (0.1, 0.6, 0.3, 1.0)
_GREY, _BLUE = (0.6, 0.6, 0.65, 0.8), (0.25, 0.45, 0.85, 0.45)
_POINT_DIAMETER_M = 0.12
_DISC_LIFETIME_NS = 500_000_000


def obstacle_marker(stamp_ns: int, obstacle: Sequence[float]) -> bytes:
    """Return the cylinder (x, y, radius, top) [m]."""
    x, y, radius, top = obstacle
    size = (2.0 * radius, 2.0 * radius, top)
    place = (x, y, 0.5 * top)
    return _message([_marker(stamp_ns, "obstacle", _CYLINDER, place, size, _GREY)])


def point_marker(
    stamp_ns: int, name: str, place: Sequence[float], colour: Sequence[float]
) -> bytes:
    """Return a point, such as x_c."""
    size = (_POINT_DIAMETER_M,) * 3
    return _message([_marker(stamp_ns, name, _SPHERE, place, size, colour)])


def disc_markers(
    stamp_ns: int, hubs: Iterable[Sequence[float]], attitude: Sequence[float], radius: float
) -> bytes:
    """Return the propeller discs around their hubs (map), for half a second."""
    size = (2.0 * radius, 2.0 * radius, 0.01)
    lifetime = {"nanosec": _DISC_LIFETIME_NS}
    return _message(
        {
            **_marker(stamp_ns, "discs", _CYLINDER, hub, size, _BLUE, attitude),
            "id": number,
            "lifetime": lifetime,
        }
        for number, hub in enumerate(hubs)
    )


def _marker(
    stamp_ns: int,
    name: str,
    shape: int,
    position: Sequence[float],
    scale: Sequence[float],
    colour: Sequence[float],
    attitude: Sequence[float] = _UPRIGHT,
) -> dict[str, Any]:
    return {
        "header": {"stamp": stamp(stamp_ns), "frame_id": FRAME_MAP},
        "ns": name,
        "type": shape,
        "pose": {
            "position": dict(zip("xyz", position, strict=True)),
            "orientation": dict(zip("xyzw", attitude, strict=True)),
        },
        "scale": dict(zip("xyz", scale, strict=True)),
        "color": dict(zip("rgba", colour, strict=True)),
        "frame_locked": True,
        "text": name,
    }


def _message(markers: Iterable[Mapping[str, Any]]) -> bytes:
    return encode(MARKERS.typename, {"markers": list(markers)})
