"""Markers for RViz and Foxglove: obstacle, discs, points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Vector3
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker, MarkerArray

from tombo_dynamics.frames import FRAME_MAP
from tombo_ros.conversion import point, quaternion, to_time

_UPRIGHT = (0.0, 0.0, 0.0, 1.0)
RED, GREEN = (0.9, 0.2, 0.15, 1.0), (0.1, 0.6, 0.3, 1.0)
_GREY, _BLUE = (0.6, 0.6, 0.65, 0.8), (0.25, 0.45, 0.85, 0.45)
_POINT_DIAMETER = 0.12


def marker(
    stamp_ns: int,
    name: str,
    shape: int,
    position: Sequence[float],
    scale: Sequence[float],
    colour: Sequence[float],
    *,
    number: int = 0,
    attitude: Sequence[float] = _UPRIGHT,
    lifetime_s: float = 0.0,
) -> Any:
    """Return a marker in map; `lifetime_s` 0 stays."""
    made = Marker()
    made.header.frame_id = FRAME_MAP
    made.header.stamp = to_time(stamp_ns)
    made.ns, made.id, made.type, made.text = name, number, shape, name
    made.pose.position, made.pose.orientation = point(position), quaternion(attitude)
    x, y, z = (float(value) for value in scale)
    made.scale = Vector3(x=x, y=y, z=z)
    red, green, blue, alpha = colour
    made.color = ColorRGBA(r=red, g=green, b=blue, a=alpha)
    made.lifetime = Duration(nanosec=int(lifetime_s * 1e9))
    made.frame_locked = True
    return made


def obstacle_marker(stamp_ns: int, obstacle: Sequence[float]) -> Any:
    """Return the cylinder (x, y, radius, top) as a MarkerArray; None without an obstacle."""
    x, y, radius, top = (float(value) for value in obstacle)
    if radius <= 0.0:
        return None
    size = (2.0 * radius, 2.0 * radius, top)
    made = marker(stamp_ns, "obstacle", Marker.CYLINDER, (x, y, 0.5 * top), size, _GREY)
    return MarkerArray(markers=[made])


def point_marker(stamp_ns: int, name: str, place: Sequence[float], colour: Any) -> Any:
    """Return a point, such as x_c, as a MarkerArray."""
    size = (_POINT_DIAMETER,) * 3
    return MarkerArray(markers=[marker(stamp_ns, name, Marker.SPHERE, place, size, colour)])


def disc_markers(
    stamp_ns: int, hubs: Sequence[Sequence[float]], attitude: Sequence[float], radius: float
) -> Any:
    """Return the propeller discs around their hubs (map) as a MarkerArray, for half a second."""
    size = (2.0 * radius, 2.0 * radius, 0.01)
    return MarkerArray(
        markers=[
            marker(
                stamp_ns,
                "discs",
                Marker.CYLINDER,
                hub,
                size,
                _BLUE,
                number=number,
                attitude=attitude,
                lifetime_s=0.5,
            )
            for number, hub in enumerate(hubs)
        ]
    )
