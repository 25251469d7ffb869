"""The vehicle's pieces and the camera of the moving picture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import rotation_matrix
from tombo_flight.report.replay_data import DrawnAirframe


@dataclass(frozen=True)
class VehiclePart:
    """A piece of the vehicle: a filled outline, or a line with a thickness; map frame, metres."""

    kind: str
    points_m: Array
    thickness_m: float = 0.0
    rotor: int | None = None


def _disc(airframe: DrawnAirframe, fold: float) -> Array:
    """Rim of a swept disc about its rotor axis, in base_link.

    The tip draws in to the radius at which the simulation has it, linear in the fold; a
    stiff wing hinged at the nodus then stands out of the rotor plane. It is drawn downwards.
    """
    wing = airframe.rotor_radius - airframe.nodus_radius
    stretched = 1.0 - min(max(fold, 0.0), 1.0)
    sink = wing * float(np.sqrt(1.0 - stretched**2))
    return circle(airframe.nodus_radius + wing * stretched, -sink)


def vehicle_parts(
    airframe: DrawnAirframe, position: Array, attitude: Array, fold: Array
) -> list[VehiclePart]:
    """Return the pieces of the vehicle at a pose.

    Args:
        airframe: its lengths.
        position: (3,) centre of mass, map ENU, metres.
        attitude: (4,) quaternion xyzw, map<-base_link.
        fold: (4,) fold of each rotor, 0 stretched to 1 folded.
    """
    turn = matrix(attitude)

    def put(points: Sequence[Sequence[float]] | Array) -> Array:
        placed: Array = position + np.asarray(points, dtype=np.float64) @ turn.T
        return placed

    low = -airframe.leg_height
    parts = []
    for y in (-0.11, 0.11):
        parts.append(VehiclePart("leg", put(((0.0, y / 2, 0.0), (0.0, y, low))), 0.010))
        parts.append(VehiclePart("leg", put(((-0.12, y, low), (0.13, y, low))), 0.012))
    for rotor, hub in enumerate(airframe.rotors_m):
        x, y, z = hub
        parts.append(VehiclePart("arm", put(((0.2 * x, 0.2 * y, 0.0), (x, y, 0.0))), 0.020, rotor))
        parts.append(VehiclePart("motor", put(((x, y, -0.004), (x, y, z - 0.006))), 0.028, rotor))
        if fold[rotor] > 0.02:
            parts.append(VehiclePart("ghost", put(hub + _disc(airframe, 0.0)), 0.002, rotor))
        parts.append(
            VehiclePart("disc", put(hub + _disc(airframe, float(fold[rotor]))), 0.006, rotor)
        )
    bottom, top = circle(0.07, -0.02, 9), circle(0.07, 0.022, 9)
    for k in range(8):
        parts.append(VehiclePart("side", put((bottom[k], bottom[k + 1], top[k + 1], top[k]))))
    parts.append(VehiclePart("deck", put(top)))
    parts.append(VehiclePart("nose", put(((0.02, 0.0, 0.024), (0.06, 0.0, 0.024))), 0.014))
    return parts


def circle(radius_m: float, height_m: float = 0.0, points: int = 49) -> Array:
    """(points, 3) closed outline of a horizontal circle about the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, points)
    return np.stack(
        (radius_m * np.cos(angle), radius_m * np.sin(angle), np.full(points, height_m)), axis=1
    )


def matrix(attitude: Array) -> Array:
    """(4,) quaternion xyzw to the (3, 3) matrix that turns base_link into map."""
    turn = np.zeros((3, 3))
    rotation_matrix(np.asarray(attitude, dtype=np.float64), turn)
    return turn


@dataclass(frozen=True)
class Camera:
    """A pinhole camera at `eye` that looks at `target`, z up; metres, map ENU."""

    eye: Array
    target: Array

    @property
    def axes(self) -> Array:
        """Rows right, up, forward of the camera, in the map frame."""
        forward = (self.target - self.eye) / np.linalg.norm(self.target - self.eye)
        right = np.cross(forward, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return np.stack((right, np.cross(right, forward), forward))

    def project(self, points: Array) -> Array:
        """(..., 3) map points to (..., 3): picture x right, picture y up, depth [m]."""
        seen = (points - self.eye) @ self.axes.T
        flat = seen[..., :2] / np.maximum(seen[..., 2:], 1e-3)
        return np.concatenate((flat, seen[..., 2:]), axis=-1)
