"""Quaternions xyzw (as in ROS): rotation from `base_link` (FLU) to `map` (ENU).

A quaternion is an array (4), a rotation matrix one of (3, 3).
"""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.vectors import AnyVector, Vector, cross, norm, scale, store, vector


@compiled
def normalize_quaternion(q: Array) -> None:
    """Scale the quaternion `q` to unit length, in place."""
    n = 1.0 / math.sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3])
    q[0] *= n
    q[1] *= n
    q[2] *= n
    q[3] *= n


@compiled
def relative_rotation(reference: Array, q: Array) -> tuple[float, float, float, float]:
    """Return conj(q) * reference (xyzw), with non-negative scalar part.

    It is the rotation from `q` to `reference`, expressed in the frame of `q`.
    """
    rx, ry, rz, rw = reference[0], reference[1], reference[2], reference[3]
    x0, y0, z0, w0 = q[0], q[1], q[2], q[3]
    x = w0 * rx - x0 * rw - y0 * rz + z0 * ry
    y = w0 * ry + x0 * rz - y0 * rw - z0 * rx
    z = w0 * rz - x0 * ry + y0 * rx - z0 * rw
    w = w0 * rw + x0 * rx + y0 * ry + z0 * rz
    if w < 0.0:
        return -x, -y, -z, -w
    return x, y, z, w


@compiled
def rotation_vector(reference: Array, q: Array) -> Vector:
    """Return the rotation vector [rad] from `q` to `reference`, in the frame of `q`."""
    x, y, z, w = relative_rotation(reference, q)
    sine = norm((x, y, z))
    angle_by_sine = 2.0 * math.atan2(sine, w) / sine if sine > 1e-12 else 2.0
    return scale(angle_by_sine, (x, y, z))


@compiled
def rotate_by_vector(q: Array, turn: AnyVector) -> None:
    """Turn the quaternion `q` by the rotation vector `turn` [rad], own frame, in place."""
    square = turn[0] * turn[0] + turn[1] * turn[1] + turn[2] * turn[2]
    if square < 1e-4:
        # series to the fourth order of the angle: error below 1e-14 for 0.01 rad
        s = 0.5 - square * (1.0 / 48.0) + square * square * (1.0 / 3840.0)
        c = 1.0 - 0.125 * square + square * square * (1.0 / 384.0)
    else:
        angle = math.sqrt(square)
        s = math.sin(0.5 * angle) / angle
        c = math.cos(0.5 * angle)
    bx, by, bz = scale(s, turn)
    x0, y0, z0, w0 = q[0], q[1], q[2], q[3]
    x = w0 * bx + x0 * c + y0 * bz - z0 * by
    y = w0 * by - x0 * bz + y0 * c + z0 * bx
    z = w0 * bz + x0 * by - y0 * bx + z0 * c
    w = w0 * c - x0 * bx - y0 * by - z0 * bz
    n = 1.0 / math.sqrt(x * x + y * y + z * z + w * w)
    q[0] = n * x
    q[1] = n * y
    q[2] = n * z
    q[3] = n * w


@compiled
def rotate_by_angles(q: Array, yaw: float, pitch: float, roll: float) -> None:
    """Turn the quaternion `q` by Rz(yaw) Ry(pitch) Rx(roll) [rad], on the right, in place."""
    rotate_by_vector(q, (0.0, 0.0, yaw))
    rotate_by_vector(q, (0.0, pitch, 0.0))
    rotate_by_vector(q, (roll, 0.0, 0.0))


@compiled
def quaternion_slope(q: Array, rates: AnyVector) -> tuple[float, float, float, float]:
    """Return the derivative of the quaternion `q` at the body rates [rad/s]."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    wx, wy, wz = vector(rates)
    return (
        0.5 * (w * wx + y * wz - z * wy),
        0.5 * (w * wy + z * wx - x * wz),
        0.5 * (w * wz + x * wy - y * wx),
        -0.5 * (x * wx + y * wy + z * wz),
    )


@compiled
def rotation_matrix(q: Array, out: Array) -> None:
    """Write the matrix (3, 3) that takes body vectors to `map` into `out`."""
    x, y, z, w = q[0], q[1], q[2], q[3]
    out[0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[0, 1] = 2.0 * (x * y - z * w)
    out[0, 2] = 2.0 * (x * z + y * w)
    out[1, 0] = 2.0 * (x * y + z * w)
    out[1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[1, 2] = 2.0 * (y * z - x * w)
    out[2, 0] = 2.0 * (x * z - y * w)
    out[2, 1] = 2.0 * (y * z + x * w)
    out[2, 2] = 1.0 - 2.0 * (x * x + y * y)


@compiled
def to_map(turn: Array, v: AnyVector) -> Vector:
    """Return a body vector turned into `map` by the matrix `turn` (3, 3), map from body."""
    return (
        turn[0, 0] * v[0] + turn[0, 1] * v[1] + turn[0, 2] * v[2],
        turn[1, 0] * v[0] + turn[1, 1] * v[1] + turn[1, 2] * v[2],
        turn[2, 0] * v[0] + turn[2, 1] * v[1] + turn[2, 2] * v[2],
    )


@compiled
def to_body(turn: Array, v: AnyVector) -> Vector:
    """Return a `map` vector turned into the body frame by the matrix `turn` (3, 3)."""
    return (
        turn[0, 0] * v[0] + turn[1, 0] * v[1] + turn[2, 0] * v[2],
        turn[0, 1] * v[0] + turn[1, 1] * v[1] + turn[2, 1] * v[2],
        turn[0, 2] * v[0] + turn[1, 2] * v[1] + turn[2, 2] * v[2],
    )


def quaternion_multiply(a: Array, b: Array) -> Array:
    """Return the Hamilton product a*b of quaternions xyzw (..., 4)."""
    ax, ay, az, aw = (a[..., i] for i in range(4))
    bx, by, bz, bw = (b[..., i] for i in range(4))
    return np.stack(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
            aw * bw - ax * bx - ay * by - az * bz,
        ],
        axis=-1,
    )


def conjugate(q: Array) -> Array:
    """Return the inverse rotations of unit quaternions xyzw (..., 4)."""
    return np.asarray(q * np.array([-1.0, -1.0, -1.0, 1.0]))


def body_to_map(attitude: Array, vectors: Array) -> Array:
    """Turn vectors (N, 3), or one (3), by quaternions (N, 4)."""
    axis, w = attitude[:, :3], attitude[:, 3:]
    twice = 2.0 * np.cross(axis, vectors)
    turned: Array = vectors + w * twice + np.cross(axis, twice)
    return turned


def map_to_body(attitude: Array, vectors: Array) -> Array:
    """Turn vectors (N, 3), or one (3), by the inverse of quaternions (N, 4)."""
    return body_to_map(conjugate(attitude), vectors)


def unwrap_quaternions(q: Array) -> Array:
    """Return the same rotations (N, 4) with signs such that no step is the long way round.

    Quaternions that are zero or not finite stay unchanged.
    """
    out = np.array(q, np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        norm = np.linalg.norm(out, axis=1)
    good = np.flatnonzero(np.isfinite(norm) & (norm > 1e-6))
    if good.size > 1:
        rotations = out[good]
        flips = np.where(np.einsum("ij,ij->i", rotations[1:], rotations[:-1]) < 0.0, -1.0, 1.0)
        out[good[1:]] *= np.cumprod(flips)[:, None]
    return out


def yaw_pitch_roll(q: Array) -> Array:
    """Return yaw, pitch, roll [rad] (Z-Y-X) of quaternions (..., 4), as an array (..., 3)."""
    x, y, z, w = (q[..., i] for i in range(4))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    return np.stack([yaw, pitch, roll], axis=-1)


def yaw_of(q: Array) -> float:
    """Return the yaw [rad] of one quaternion (4)."""
    x, y, z, w = (float(v) for v in q)
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def up_in_body(q: Array) -> Array:
    """Return `map` z in the body frame (..., 3) of quaternions (..., 4)."""
    x, y, z, w = (q[..., i] for i in range(4))
    up = [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)]
    return np.stack(up, axis=-1)


def tilt(q: Array) -> Array:
    """Return the angle [rad] between body z and `map` z of quaternions (..., 4)."""
    upright = 1.0 - 2.0 * (q[..., 0] ** 2 + q[..., 1] ** 2)
    angle: Array = np.arccos(np.clip(upright, -1.0, 1.0))
    return angle


@compiled
def upright(q: Array) -> float:
    """Return the cosine of the tilt of one quaternion (4)."""
    return float(1.0 - 2.0 * (q[0] * q[0] + q[1] * q[1]))


@compiled
def rotated(q: Array, v: AnyVector) -> Vector:
    """Return a vector turned by the quaternion `q` (4) xyzw."""
    return _rotate(q, q[3], v)


@compiled
def rotated_back(q: Array, v: AnyVector) -> Vector:
    """Return a vector turned by the inverse of the quaternion `q` (4) xyzw."""
    return _rotate(q, -q[3], v)


@compiled
def rotated_back_rows(q: Array, vectors: Array) -> Array:
    """Turn vectors (N, 3) by the inverse of quaternions (N, 4), each as `rotated_back` does."""
    out = np.empty_like(vectors)
    for i in range(len(vectors)):
        store(out[i], rotated_back(q[i], vectors[i]))
    return out


@compiled
def _rotate(axis: Array, w: float, v: AnyVector) -> Vector:
    """Return a vector turned by the quaternion of a vector part and the scalar part `w`."""
    x, y, z = axis[0], axis[1], axis[2]
    tx, ty, tz = scale(2.0, cross(axis, v))
    return (
        v[0] + w * tx + y * tz - z * ty,
        v[1] + w * ty + z * tx - x * tz,
        v[2] + w * tz + x * ty - y * tx,
    )


@compiled
def rotate_vector(q: Array, v: Array) -> Array:
    """Return the vector `v` (3) turned by the quaternion `q` (4) xyzw."""
    out = np.empty(3)
    store(out, rotated(q, v))
    return out
