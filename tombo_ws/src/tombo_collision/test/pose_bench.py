"""Made-up mocap poses: a vehicle that hovers or flies straight, and is pushed or kicked."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from core_calls import CollisionDetector, DetectedCollision
from tombo_collision.params import DetectorParams
from tombo_dynamics.arrays import Array


@dataclass
class Poses:
    """Stamped poses: t (n,) [s], position (n, 3) in map, attitude (n, 4) xyzw."""

    t: Array
    position: Array
    attitude: Array

    def __len__(self) -> int:
        return len(self.t)

    def pushed(self, at: float, velocity: Any) -> Poses:
        """From `at` [s] on it flies with `velocity` [m/s] on top."""
        after = np.maximum(self.t - at, 0.0)
        return Poses(self.t, self.position + after[:, None] * np.array(velocity), self.attitude)

    def rotate(self, at: float, rates: Any) -> Poses:
        """From `at` [s] on it turns with `rates` [rad/s, body frame] for a tenth of a second."""
        after = np.clip(self.t - at, 0.0, 0.1)
        turn = Rotation.from_rotvec(after[:, None] * np.array(rates))
        return Poses(self.t, self.position, (Rotation.from_quat(self.attitude) * turn).as_quat())

    def without(self, keep: Any) -> Poses:
        return Poses(self.t[keep], self.position[keep], self.attitude[keep])


def flight(
    seconds: float = 6.0,
    velocity: Any = (0.0, 0.0, 0.0),
    start: Any = (0.0, 0.0, 2.0),
    seed: int = 0,
    rate: float = 30.0,
    noise: tuple[float, float] = (0.0007, 0.002),
) -> Poses:
    """One pose on the floor, a gap of a second, then a straight flight with the paper's noise."""
    rng = np.random.default_rng(seed)
    t = np.append(0.0, np.round(np.arange(1.0, seconds, 1.0 / rate), 3))
    position = np.array(start) + np.maximum(t - 1.0, 0.0)[:, None] * np.array(velocity)
    position[0, 2] = 0.18
    position += noise[0] * rng.standard_normal(position.shape)
    attitude = Rotation.from_rotvec(noise[1] * rng.standard_normal(position.shape)).as_quat()
    return Poses(t, position, attitude)


def watch(
    poses: Poses, detector: CollisionDetector | None = None, **params: Any
) -> tuple[list[DetectedCollision], Array]:
    """Feed poses to a detector; return its events and the statistic at each sample."""
    detector = detector or CollisionDetector(DetectorParams(**params))
    events, statistics = [], []
    for t, position, attitude in zip(poses.t, poses.position, poses.attitude, strict=True):
        event = detector.update(float(t), position, attitude)
        statistics.append(detector.statistic)
        if event is not None:
            events.append(event)
    return events, np.array(statistics)
