"""The detector's filter by filterpy: a second implementation that recorded statistics are held to.

The detector decides which poses its filter uses and where the filter begins again. The filter
itself, prediction, update and innovation, is filterpy's, with full matrices.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from tombo_collision.detector import (
    RATE_STEP,
    RESUMED_SPEED,
    WARM_UP_SAMPLES,
    DetectorMemory,
    free_acceleration,
)
from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams
from tombo_dynamics.arrays import Array, Times
from tombo_dynamics.messages import Pose
from tombo_dynamics.rotation import rotation_vector

_POSITION_VARIANCE, _BEGIN_SPEED = 1e-6, 1.0
"""m^2, m/s: variance and standard deviation of a filter that begins at a pose."""


class ReferenceFilter:
    """Follows a detector: takes each pose that the detector has used.

    Attributes:
        filter: filterpy's filter. Its state is position (3) [m] and velocity (3) [m/s] in map,
            body rates (3) [rad/s].
        statistic: normalised innovation squared of the last pose [-]; 0 where the filter has
            begun, or has not settled.
    """

    def __init__(self) -> None:
        self.filter: Any = KalmanFilter(dim_x=9, dim_z=6, dim_u=3)
        self.filter.H = np.zeros((6, 9))
        self.filter.H[[0, 1, 2, 3, 4, 5], [0, 1, 2, 6, 7, 8]] = 1.0
        self.statistic = 0.0
        self._samples = 0
        self._attitude: Array = np.array([0.0, 0.0, 0.0, 1.0])

    def follow(self, memory: DetectorMemory, params: DetectorParams) -> None:
        """Take the pose that the detector has just used, `memory.last`."""
        position, attitude = np.array(memory.last.position), np.array(memory.last.attitude)
        if memory.collided or memory.samples == self._samples + 1:
            self._update(params, float(memory.period), position, attitude)
            self._samples = int(memory.samples)
        else:
            speed = RESUMED_SPEED  # the clock was set: velocity and rates stay
            if memory.samples == 0:
                self.filter.x, self._samples, speed = np.zeros((9, 1)), 0, _BEGIN_SPEED
            self.filter.x[:3, 0] = position
            self.filter.P = np.diag([_POSITION_VARIANCE] * 3 + [speed**2] * 3 + [1.0] * 3)
            self.statistic = 0.0
        self._attitude = attitude

    def _update(
        self, params: DetectorParams, step: float, position: Array, attitude: Array
    ) -> None:
        """Predict over a step [s] and correct by a pose.

        The acceleration of a free flight is the input; the process noise is an acceleration that
        is held over the step. Position and body rates are measured.
        """
        kf = self.filter
        kf.F, kf.B, kf.Q = np.eye(9), np.zeros((9, 3)), np.zeros((9, 9))
        accelerations = (params.acceleration_xy, params.acceleration_xy, params.acceleration_z)
        turns = (params.tilt_acceleration, params.tilt_acceleration, params.yaw_acceleration)
        gain = np.array([0.5 * step * step, step])
        for i in range(3):
            kf.F[i, 3 + i] = step
            kf.B[[i, 3 + i], i] = gain
            kf.Q[np.ix_([i, 3 + i], [i, 3 + i])] = accelerations[i] ** 2 * np.outer(gain, gain)
            kf.Q[6 + i, 6 + i] = (turns[i] * step) ** 2
        rate_noise = params.rate_noise * max(1.0, RATE_STEP / step)
        kf.R = np.diag([params.position_noise**2] * 3 + [rate_noise**2] * 3)
        turn = np.array(rotation_vector(attitude, self._attitude))
        kf.predict(u=np.array([[*free_acceleration(self._attitude, attitude), 0.0]]).T)
        kf.update(np.array([[*position, *(turn / step)]]).T)
        settled = self._samples + 1 > WARM_UP_SAMPLES
        self.statistic = float(kf.y[:, 0] @ kf.SI @ kf.y[:, 0]) if settled else 0.0


def reference_statistics(
    arrivals_ns: Times, poses: Iterable[Pose], params: DetectorParams
) -> Array:
    """Return filterpy's statistic of each pose (N) [-]; 0 for a pose that the detector refuses.

    Args:
        arrivals_ns: (N) when each pose came.
        poses: N of them, in order of arrival.
        params: of the detector.
    """
    core, reference = DetectorCore(params), ReferenceFilter()
    statistics = np.zeros(len(arrivals_ns))
    for row, (now_ns, pose) in enumerate(zip(arrivals_ns.tolist(), poses, strict=True)):
        used_before = int(core.memory.used)
        core.on("/mocap/pose", pose, now_ns)
        if int(core.memory.used) > used_before:
            reference.follow(core.memory.detector, params)
            statistics[row] = reference.statistic
    return statistics
