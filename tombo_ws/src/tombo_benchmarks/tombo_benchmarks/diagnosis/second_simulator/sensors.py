"""What a laboratory would measure of a flight: IMU with its filter, motion capture, drives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import butter, lfilter, lfilter_zi
from scipy.spatial.transform import Rotation

from tombo_benchmarks.diagnosis.second_simulator.flight import Flown
from tombo_benchmarks.diagnosis.second_simulator.hidden import LATENCY_S, Hidden
from tombo_benchmarks.diagnosis.second_simulator.vehicles import Array

CHAINS = ("plain", "filtered")
"""plain: white noise alone. filtered: vibration at the rotors' rates, a low-pass in the IMU that
nobody takes back, jumps of the motion capture."""
IMU_HZ = 1000.0
_IMU_NOISE = 0.01, 0.3
"""rad/s, m/s^2: of a sample at that rate."""
_SHAKE = 0.01, 0.3
"""rad/s, m/s^2: standard deviation of a rotor's share in the vibration of an axis."""
_POSITION_NOISE, _ATTITUDE_NOISE = 0.0007, 0.002
"""m, rad: motion capture, of a sample."""
_LATENCY_JITTER_S, _STAMP_JITTER_S = 0.001, 0.0002
_SPEED_NOISE = 1.5
"""rad/s"""
_VOLTAGE_NOISE = 0.01


@dataclass(frozen=True)
class Stream:
    """One sensor: its stamps (N,) [s], values, and arrivals where the logger notes them."""

    t: Array
    values: Array
    arrival: Array | None = None


def measure(
    flown: Flown,
    flight: int,
    hidden: Hidden,
    formulation: str,
    chain: str,
    rng: np.random.Generator,
) -> dict[str, Stream]:
    """Return the streams of one flight: pose, imu, speed, command, supply.

    Values: pose (N, 7) position and quaternion wxyz; imu (N, 6) gyro and accelerometer; speed and
    command (N, 4) rad/s; supply (N, 2) V and A.
    """
    found = {"pose": _pose(flown, flight, hidden, chain, rng)}
    if formulation.startswith("imu"):
        found["imu"] = _imu(flown, flight, hidden, chain, rng)
    if formulation.endswith("rpm"):
        speed = flown.rotor[:, flight]
        noisy = speed + _SPEED_NOISE * rng.standard_normal(speed.shape)
        found["speed"] = Stream(flown.t, noisy)
    found["command"] = Stream(flown.t, flown.command[:, flight])
    supply = flown.electric[::25, flight].copy()
    supply[:, 0] += _VOLTAGE_NOISE * rng.standard_normal(len(supply))
    found["supply"] = Stream(flown.t[::25], supply)
    return found


def _imu(flown: Flown, f: int, hidden: Hidden, chain: str, rng: np.random.Generator) -> Stream:
    t = np.arange(0.0, flown.t[-1], 1.0 / IMU_HZ) + float(rng.uniform(0.0, 1e-3))
    t = t[t < flown.t[-1]]
    rates, turning, felt = (
        CubicSpline(flown.t, x[:, f])(t) for x in (flown.rates, flown.turning, flown.felt)
    )
    # Where the box sits: the centre of gravity may have moved away from it.
    arm = np.array([hidden[f"imu_lever_arm.{a}"] for a in "xyz"])
    arm[:2] -= [hidden[f"cog_offset.{a}"] for a in "xy"]
    felt = felt + np.cross(turning, arm) + np.cross(rates, np.cross(rates, arm))
    own = matrix(_turned(*(hidden[f"imu_misalignment.{a}"] for a in ("yaw", "pitch", "roll"))))[0]
    rates, felt = rates @ own, felt @ own
    felt = felt * (1.0 + np.array([hidden[f"accel_scale.{a}"] for a in "xyz"]))
    bias = [hidden[f"imu_bias.{c}_{a}"] for c in ("gyro", "accel") for a in "xyz"]
    values = np.hstack([rates, felt]) + bias
    values += np.repeat(_IMU_NOISE, 3) * rng.standard_normal(values.shape)
    if chain == "plain":  # it gives the mean of two samples, as of their middle
        pairs = values[: t.size // 2 * 2].reshape(-1, 2, 6)
        return Stream(t[: t.size // 2 * 2].reshape(-1, 2).mean(axis=1), pairs.mean(axis=1))
    speed = np.column_stack([np.interp(t, flown.t, n) for n in flown.rotor[:, f].T])
    angle = np.cumsum(speed, axis=0) / IMU_HZ + rng.uniform(0.0, 2.0 * np.pi, 4)
    values += np.sin(angle) @ (rng.standard_normal((4, 6)) * np.repeat(_SHAKE, 3))
    b, a = butter(2, float(rng.uniform(150.0, 200.0)), fs=IMU_HZ)
    start = lfilter_zi(b, a)[:, None] * values[0]
    smooth = lfilter(b, a, values, axis=0, zi=start)[0]
    return Stream(t[::3], smooth[::3])


def _pose(flown: Flown, f: int, hidden: Hidden, chain: str, rng: np.random.Generator) -> Stream:
    rate = float(rng.choice([100.0, 120.0, 200.0]))
    taken = np.arange(flown.t[0], flown.t[-1], 1.0 / rate)
    place = np.column_stack([np.interp(taken, flown.t, x) for x in flown.position[:, f].T])
    q = np.column_stack([np.interp(taken, flown.t, x) for x in flown.attitude[:, f].T])
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    marker = np.array([hidden[f"mocap_marker_offset.{a}"] for a in "xyz"])
    marker[:2] -= [hidden[f"cog_offset.{a}"] for a in "xy"]
    place = place + matrix(q) @ marker
    body = [hidden[f"mocap_body_misalignment.{a}"] for a in ("yaw", "pitch", "roll")]
    q = _product(q, _turned(*body))
    world = _turned(0.0, *(hidden[f"mocap_misalignment.{a}"] for a in ("pitch", "roll")))
    place, q = place @ matrix(world)[0].T, _product(world, q)
    place = place + _POSITION_NOISE * rng.standard_normal(place.shape)
    q = _product(q, _small(_ATTITUDE_NOISE * rng.standard_normal((len(q), 3))))
    if chain == "filtered":
        for k in rng.integers(0, len(taken), int(rng.integers(0, 4))):
            place[k] += rng.uniform(0.03, 0.08) * _unit(rng)
    late = LATENCY_S + hidden["mocap_latency.delay"]
    arrival = taken + np.maximum(late + _LATENCY_JITTER_S * rng.standard_normal(taken.size), 0.0)
    stamps = taken + _STAMP_JITTER_S * rng.standard_normal(taken.size)
    stamps = stamps + hidden["mocap_stamp_error.offset"]
    return Stream(stamps, np.hstack([place, q]), np.maximum.accumulate(arrival))


def matrix(q: Array) -> Array:
    """Return rotation matrices (N, 3, 3) of unit quaternions wxyz (N, 4)."""
    return np.asarray(Rotation.from_quat(q[:, [1, 2, 3, 0]]).as_matrix())


def _unit(rng: np.random.Generator) -> Array:
    way = rng.standard_normal(3)
    return np.asarray(way / np.linalg.norm(way))


def _turned(yaw: float, pitch: float, roll: float) -> Array:
    """Return Rz(yaw) Ry(pitch) Rx(roll) as a quaternion (1, 4) wxyz."""
    about = [
        np.array([[np.cos(0.5 * a), *(np.sin(0.5 * a) * np.eye(3)[i])]])
        for i, a in ((2, yaw), (1, pitch), (0, roll))
    ]
    return _product(_product(about[0], about[1]), about[2])


def _small(angles: Array) -> Array:
    """Return quaternions (N, 4) wxyz of small rotations (N, 3) [rad]."""
    q = np.hstack([np.ones((len(angles), 1)), 0.5 * angles])
    return np.asarray(q / np.linalg.norm(q, axis=1, keepdims=True))


def _product(p: Array, q: Array) -> Array:
    """Return p ⊗ q of quaternions wxyz; one row goes with all."""
    pw, px, py, pz = p.T
    qw, qx, qy, qz = q.T
    return np.column_stack([
        pw * qw - px * qx - py * qy - pz * qz, pw * qx + px * qw + py * qz - pz * qy,
        pw * qy - px * qz + py * qw + pz * qx, pw * qz + px * qy - py * qx + pz * qw,
    ])  # fmt: skip
