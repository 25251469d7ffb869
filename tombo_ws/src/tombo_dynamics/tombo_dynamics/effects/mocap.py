"""Errors of motion capture: the frame, the time, the noise, the gaps."""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P
from tombo_dynamics.rotation import (
    relative_rotation,
    rotate_by_vector,
    rotation_matrix,
)


@effect(
    "mocap_misalignment",
    Stage.MOCAP,
    [
        Param("yaw", "rad", 0.0, (-3.2, 3.2), "mocap frame turned about map z", 0.1),
        Param("roll", "rad", 0.0, (-0.5, 0.5), "mocap frame tilted about map x", 0.02),
        Param("pitch", "rad", 0.0, (-0.5, 0.5), "mocap frame tilted about map y", 0.02),
    ],
    signature="velocity from mocap and acceleration from the IMU differ by a fixed rotation",
    separates_from={"steady_wind": "fly a square: a rotated frame turns with the velocity"},
)
def mocap_misalignment(m: Array, noise: Array, yaw: float, roll: float, pitch: float) -> None:
    """Turn position and attitude by Rz(yaw) Ry(pitch) Rx(roll) about the map's origin."""
    turn = np.zeros(13)
    turn[3] = 1.0
    rotate_by_vector(turn, 0, 0.0, 0.0, yaw)
    rotate_by_vector(turn, 0, 0.0, pitch, 0.0)
    rotate_by_vector(turn, 0, roll, 0.0, 0.0)
    rotation_matrix(turn, 0, turn, 4)
    x, y, z = m[P.mocap], m[P.mocap + 1], m[P.mocap + 2]
    for i in range(3):
        m[P.mocap + i] = turn[4 + 3 * i] * x + turn[5 + 3 * i] * y + turn[6 + 3 * i] * z
    # turn * q, written as conj(conj(turn)) * q
    turn[0], turn[1], turn[2] = -turn[0], -turn[1], -turn[2]
    qx, qy, qz, qw = relative_rotation(m, P.mocap + 3, turn, 0)
    m[P.mocap + 3], m[P.mocap + 4], m[P.mocap + 5], m[P.mocap + 6] = qx, qy, qz, qw


@effect(
    "mocap_noise",
    Stage.MOCAP,
    [
        Param("position", "m", 0.0, (0.0, 0.2), "standard deviation of each axis", 0.002),
        Param("attitude", "rad", 0.0, (0.0, 0.2), "standard deviation of each axis", 0.005),
    ],
    signature="white noise on the pose",
)
def mocap_noise(m: Array, noise: Array, position: float, attitude: float) -> None:
    """Add white noise to position and attitude."""
    for i in range(3):
        m[P.mocap + i] += position * noise[i]
    rotate_by_vector(m, P.mocap + 3, attitude * noise[3], attitude * noise[4], attitude * noise[5])


@effect(
    "mocap_latency",
    Stage.MOCAP,
    [
        Param("delay", "s", 0.0, (0.0, 0.2), "from capture to arrival", 0.03),
        Param("jitter", "s", 0.0, (0.0, 0.05), "standard deviation of the delay", 0.002),
    ],
    signature="pose trails the IMU; the stamp, being the capture time, stays right",
)
def mocap_latency(m: Array, noise: Array, delay: float, jitter: float) -> None:
    """Let the sample arrive later than it was captured; its stamp stays the capture time."""
    m[P.mocap + 7] += max(0.0, delay + jitter * noise[6])


@effect(
    "mocap_dropouts",
    Stage.MOCAP,
    [
        Param("probability", "1", 0.0, (0.0, 1.0), "chance of a sample to begin a gap", 0.01),
        Param("duration", "s", 0.0, (0.0, 5.0), "mean length of a gap", 0.1),
    ],
    signature="missing samples, singly or in gaps",
)
def mocap_dropouts(m: Array, noise: Array, probability: float, duration: float) -> None:
    """Drop samples in gaps whose lengths are exponentially distributed."""
    if m[P.mocap + 9] <= 0.0 and 0.5 * math.erfc(noise[7] / math.sqrt(2.0)) < probability:
        chance = max(0.5 * math.erfc(noise[8] / math.sqrt(2.0)), 1e-9)
        m[P.mocap + 9] = 1e-9 - duration * math.log(chance)
    if m[P.mocap + 9] > 0.0:
        m[P.mocap + 8] = 1.0
