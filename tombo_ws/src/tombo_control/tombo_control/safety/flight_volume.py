"""The flight volume: set points are kept inside, a vehicle outside is noticed."""

from __future__ import annotations

import math
from typing import Any

from tombo_control.safety.params import FlightVolume
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled


@compiled
def clamp_to_volume(place: Array, volume: Any) -> bool:
    """Move a place (3) [m] in map to the nearest one inside; return whether it was outside."""
    x = min(max(place[0], volume.x_min), volume.x_max)
    y = min(max(place[1], volume.y_min), volume.y_max)
    z = min(place[2], volume.z_max)
    if volume.radius > 0.0:
        off_x, off_y = x - volume.centre_x, y - volume.centre_y
        away = math.sqrt(off_x * off_x + off_y * off_y)
        if away > volume.radius:
            x = volume.centre_x + off_x * volume.radius / away
            y = volume.centre_y + off_y * volume.radius / away
    moved = x != place[0] or y != place[1] or z != place[2]
    place[0], place[1], place[2] = x, y, z
    return bool(moved)


@compiled
def outside_volume(place: Array, volume: Any) -> float:
    """Return how far a place (3) [m] is outside of box and cylinder [m]; 0 inside."""
    off = max(volume.x_min - place[0], place[0] - volume.x_max)
    off = max(off, volume.y_min - place[1], place[1] - volume.y_max)
    off = max(off, place[2] - volume.z_max, 0.0)
    if volume.radius > 0.0:
        x, y = place[0] - volume.centre_x, place[1] - volume.centre_y
        off = max(off, math.sqrt(x * x + y * y) - volume.radius)
    return float(off)


def check_volume(volume: FlightVolume) -> None:
    """Refuse a volume that is empty.

    Raises:
        InputError: the lowest x or y is not below the highest.
    """
    for axis in ("x", "y"):
        low, high = getattr(volume, f"{axis}_min"), getattr(volume, f"{axis}_max")
        if not low < high:
            raise InputError(
                f"volume.{axis}_min: {low:g} is not below volume.{axis}_max, {high:g}; accepted: "
                "a volume that the vehicle can be in"
            )
