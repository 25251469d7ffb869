"""Conversion between PX4's frames (NED, FRD) and ours (ENU, FLU); done nowhere else.

Ours: world `map`, ENU; body `base_link`, FLU; quaternions xyzw, map from base_link. PX4's: world
NED with the same origin, body FRD, quaternions wxyz, NED from FRD (MAVLink common, PX4 user guide
"frames"). All functions take leading axes; vectors and yaw are their own way back, which is why
each direction has its own name: a call names both frames.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array

PX4_ROTORS = (0, 1, 2, 3)
"""Our index of PX4's motor 1, 2, 3, 4 of a quad-x: front right, rear left, front left, rear right.

The first two turn counter-clockwise, seen from above (PX4 airframe reference, Quadrotor x).
"""
_EARTH_RADIUS_M = 6_371_000.0
_HALF = math.sqrt(0.5)
_UPPER = np.triu_indices(6)
UPPER_DIAGONAL = [0, 6, 11, 15, 18, 20]
"""Places of the diagonal in the upper triangle (21) of a covariance (6, 6)."""


def ned_from_enu(vector: ArrayLike) -> Array:
    """Turn (..., 3) from ENU into NED axes: x and y change places, z its sign."""
    v = np.asarray(vector, np.float64)
    return np.stack([v[..., 1], v[..., 0], -v[..., 2]], axis=-1)


def quaternion_of_angles(roll: float, pitch: float, yaw: float) -> tuple[float, ...]:
    """Return wxyz of roll, pitch and yaw [rad], turned in the order yaw, pitch, roll."""
    cr, sr = math.cos(0.5 * roll), math.sin(0.5 * roll)
    cp, sp = math.cos(0.5 * pitch), math.sin(0.5 * pitch)
    cy, sy = math.cos(0.5 * yaw), math.sin(0.5 * yaw)
    return (
        cr * cp * cy + sr * sp * sy,
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
    )


enu_from_ned = ned_from_enu
"""Turns (..., 3) from NED into ENU axes."""


def frd_from_flu(vector: ArrayLike) -> Array:
    """Turn (..., 3) from FLU into FRD axes: half a turn about forward."""
    v = np.asarray(vector, np.float64)
    return np.stack([v[..., 0], -v[..., 1], -v[..., 2]], axis=-1)


flu_from_frd = frd_from_flu
"""Turns (..., 3) from FRD into FLU axes."""


def px4_quaternion(attitude: ArrayLike) -> Array:
    """Return (..., 4) wxyz, NED from FRD, of an attitude xyzw, map from base_link.

    R_ned_frd = R_ned_enu R_enu_flu R_flu_frd; the result has w >= 0.
    """
    q = np.asarray(attitude, np.float64)
    x, y, z, w = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = _HALF * np.stack([w + z, x + y, x - y, w - z], axis=-1)
    return _w_positive(out, 0)


def px4_pose(position: ArrayLike, attitude: ArrayLike) -> tuple[Array, Array]:
    """Return a pose in PX4's axes: position (..., 3) in NED, attitude (..., 4) xyzw, NED from FRD.

    Args:
        position: (..., 3) in map.
        attitude: (..., 4) xyzw, map from base_link.
    """
    return ned_from_enu(position), np.roll(px4_quaternion(attitude), -1, axis=-1)


def ros_quaternion(attitude: ArrayLike) -> Array:
    """Return (..., 4) xyzw, map from base_link, of an attitude wxyz, NED from FRD.

    The result has w >= 0.
    """
    q = np.asarray(attitude, np.float64)
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = _HALF * np.stack([x + y, x - y, w - z, w + z], axis=-1)
    return _w_positive(out, 3)


def px4_yaw(yaw: float) -> float:
    """Return the heading clockwise from north of a yaw counter-clockwise from east [rad]."""
    return math.remainder(0.5 * math.pi - yaw, 2.0 * math.pi)


ros_yaw = px4_yaw
"""Returns the yaw counter-clockwise from east of a heading clockwise from north [rad]."""


def ros_pose_covariance(upper: ArrayLike) -> Array:
    """Return (6, 6) in axes of `map` from an upper triangle (21) in PX4's world axes."""
    c: Array = np.zeros((6, 6))
    c[_UPPER] = np.asarray(upper, np.float64)
    c = c + np.triu(c, 1).T
    turned: Array = _WORLD_TURN.T @ c @ _WORLD_TURN
    return turned


_WORLD_TURN = np.kron(np.eye(2), ned_from_enu(np.eye(3)).T)


def _w_positive(q: Array, w: int) -> Array:
    return np.where(q[..., w : w + 1] < 0.0, -q, q)


@dataclass(frozen=True)
class GeoOrigin:
    """Where the origin of `map` is on the globe; its z axis is up, its x axis east.

    The earth is flat here, which is exact to 1 mm within 100 m.
    """

    latitude_deg: float = 47.397742
    longitude_deg: float = 8.545594
    altitude_m: float = 488.0

    @property
    def _degree_m(self) -> tuple[float, float]:
        """Length of a degree of longitude and of latitude [m]."""
        degree = math.radians(_EARTH_RADIUS_M)
        return degree * math.cos(math.radians(self.latitude_deg)), degree

    def global_of(self, position: ArrayLike) -> tuple[float, float, float]:
        """Return latitude [deg], longitude [deg], altitude [m] of (3) in map [m]."""
        east, north, up = (float(p) for p in np.asarray(position, np.float64))
        x, y = self._degree_m
        return self.latitude_deg + north / y, self.longitude_deg + east / x, self.altitude_m + up

    def local_of(self, latitude_deg: float, longitude_deg: float, altitude_m: float) -> Array:
        """Return (3) in map [m] of a place on the globe."""
        x, y = self._degree_m
        turn = math.remainder(longitude_deg - self.longitude_deg, 360.0)
        place = turn * x, (latitude_deg - self.latitude_deg) * y, altitude_m - self.altitude_m
        return np.array(place)
