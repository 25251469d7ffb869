"""Collision detection on the mocap pose: a known region, or an unknown obstacle by innovation.

A Kalman filter (filterpy) predicts the next pose of a vehicle that flies freely: the acceleration
follows from the measured attitude (thrust about equal to weight), rates change slowly. A blade
strike breaks this within one or two samples: a push at the rim, a kick in yaw, one corner without
thrust. The test is the squared innovation over its covariance.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from tombo_collision.params import TRIGGERS, DetectorParams
from tombo_dynamics.errors import unknown_name
from tombo_dynamics.vehicle import GRAVITY

Array = NDArray[np.float64]

_DEGREES = 6
_TRACK_TIME = 0.5
"""s: the flight's direction is that over the last half second."""
_RATE_STEP = 0.033
"""s: `rate_noise` holds for attitudes this far apart or more; closer ones give noisier rates."""
_SLOW = 0.03
"""m: a track shorter than this has no direction."""
_SETTLE_SAMPLES = 8


@dataclass(frozen=True)
class CollisionEvent:
    """A detected collision. Positions and directions in map."""

    stamp_s: float
    """Capture time of the sample that triggered [s]."""
    trigger: str
    """'region' or 'innovation'."""
    contact_time_s: float
    """Estimated time of contact [s]."""
    x_c: Array
    """Estimated position of the vehicle at contact (3) [m]."""
    flight_direction: Array
    """Unit vector of the flight before contact (3)."""
    confidence: float
    """0..1, that a contact has happened."""
    statistic: float
    """Normalised innovation squared of the triggering sample (6 degrees of freedom)."""
    count: int
    """1 for the first event of a flight."""


class CollisionDetector:
    """Watches capture-stamped poses; `update` returns an event when one is detected.

    Raises:
        InputError: the trigger's name is unknown.
    """

    def __init__(self, params: DetectorParams) -> None:
        if params.trigger not in TRIGGERS:
            raise unknown_name("detector.trigger", params.trigger, TRIGGERS)
        self._p = params
        self._innovation = params.trigger in ("innovation", "both")
        self._region = params.trigger in ("region", "both")
        self._filter: Any = None
        self._first_height = math.nan
        self._last_stamp = -math.inf
        self._last_attitude: Array = np.array([0.0, 0.0, 0.0, 1.0])
        self._track: deque[tuple[float, Array]] = deque()
        self._samples = 0
        self._blocked_until = -math.inf
        self._count = 0
        self._inside = False
        self.statistic = 0.0
        """Normalised innovation squared of the last sample; 0 where there was none."""

    def update(self, stamp_s: float, position: Array, attitude: Array) -> CollisionEvent | None:
        """Take a pose captured at `stamp_s` [s]; return an event if it shows a collision.

        Samples that are not finite, or not newer than the last one, are ignored. A stamp that lies
        further back than `gap_max` means that the clock was set: the filter starts anew. The
        arrays may be used again by the caller.

        Args:
            stamp_s: capture time.
            position: (3) in map [m].
            attitude: quaternion xyzw (4), map from base_link.
        """
        if not math.isfinite(stamp_s + sum(position.tolist()) + sum(attitude.tolist())):
            return None
        step = stamp_s - self._last_stamp
        if -self._p.gap_max <= step <= 0.0:
            return None
        position, attitude = position.copy(), attitude.copy()
        if self._first_height != self._first_height:
            self._first_height = float(position[2])
        event = None
        if step < 0.0:
            self._blocked_until = -math.inf
        if self._filter is None or not 0.0 < step <= self._p.gap_max:
            self._restart(position)
        else:
            self._advance(step, position, attitude)
            armed = (
                position[2] - self._first_height > self._p.arm_height
                and stamp_s >= self._blocked_until
            )
            if armed:
                event = self._judge(stamp_s, position)
        self._last_stamp = stamp_s
        self._last_attitude = attitude
        if event is not None:
            self._blocked_until = stamp_s + self._p.holdoff
            self._track.clear()
            self._samples = 0
        elif stamp_s >= self._blocked_until and self.statistic < self._p.threshold:
            self._track.append((stamp_s, position))
            oldest = stamp_s - _TRACK_TIME - 0.5 * step
            while len(self._track) > 1 and self._track[0][0] < oldest:
                self._track.popleft()
        return event

    def _restart(self, position: Array) -> None:
        kf = KalmanFilter(dim_x=9, dim_z=_DEGREES, dim_u=3)
        kf.x[:3, 0] = position
        kf.P = np.diag([1e-6] * 3 + [1.0] * 3 + [1.0] * 3)
        kf.H = np.zeros((_DEGREES, 9))
        kf.H[[0, 1, 2, 3, 4, 5], [0, 1, 2, 6, 7, 8]] = 1.0
        kf.inv = _inverse
        self._filter = kf
        self._samples = 0
        self.statistic = 0.0
        self._track.clear()

    def _advance(self, step: float, position: Array, attitude: Array) -> None:
        """Predict over `step` [s], compare with the sample and correct."""
        kf = self._filter
        kf.F, kf.B, kf.Q, kf.R = _model(self._p, round(step, 6))
        x0, y0, z0, w0 = self._last_attitude.tolist()
        x, y, z, w = attitude.tolist()
        # acceleration of a free flight, from the mean attitude over the step
        mx, my, mz, mw = x0 + x, y0 + y, z0 + z, w0 + w
        if x0 * x + y0 * y + z0 * z + w0 * w < 0.0:
            mx, my, mz, mw = x - x0, y - y0, z - z0, w - w0
        upright = max(mw * mw + mz * mz - mx * mx - my * my, 0.3 * (mw * mw + mz * mz))
        ax = GRAVITY * 2.0 * (mx * mz + mw * my) / upright
        ay = GRAVITY * 2.0 * (my * mz - mw * mx) / upright
        rx, ry, rz = _rotation_vector(x0, y0, z0, w0, x, y, z, w)
        kf.predict(u=np.array([[ax], [ay], [0.0]]))
        px, py, pz = position.tolist()
        kf.update(np.array([[px], [py], [pz], [rx / step], [ry / step], [rz / step]]))
        y_ = kf.y[:, 0]
        self._samples += 1
        self.statistic = float(y_ @ kf.SI @ y_) if self._samples > _SETTLE_SAMPLES else 0.0

    def _judge(self, stamp_s: float, position: Array) -> CollisionEvent | None:
        """Apply the triggers to the present sample."""
        p = self._p
        if self._innovation and self.statistic > p.threshold:
            return self._event(stamp_s, position, "innovation")
        if self._region:
            inside = self._in_region(position)
            entered = inside and not self._inside
            self._inside = inside
            if entered:
                return self._event(stamp_s, position, "region")
        return None

    def _in_region(self, position: Array) -> bool:
        p = self._p
        direction = self._direction(position)
        off = position - (p.region_x, p.region_y, p.region_z)
        along = float(off @ direction)
        across = off - along * direction
        return abs(along) < p.region_depth and float(across @ across) < p.region_radius**2

    def _direction(self, position: Array) -> Array:
        """Unit vector of the flight over the last half second before now, or zero."""
        if not self._track:
            return np.zeros(3)
        way = self._track[-1][1] - self._track[0][1]
        length = math.sqrt(float(way @ way))
        if length < _SLOW:
            return np.zeros(3)
        direction: Array = way / length
        return direction

    def _event(self, stamp_s: float, position: Array, trigger: str) -> CollisionEvent:
        self._count += 1
        direction = self._direction(position)
        if trigger == "region" or not self._track:
            contact_time, x_c = stamp_s, position.copy()
        else:
            quiet_time, quiet = self._track[-1]
            contact_time = 0.5 * (quiet_time + stamp_s)
            begin_time, begin = self._track[0]
            velocity = (quiet - begin) / max(quiet_time - begin_time, 1e-3)
            x_c = quiet + velocity * (contact_time - quiet_time)
        if not direction.any():
            # struck at rest: the flight is taken as opposite to the push
            push = self._filter.y[:3, 0]
            size = math.sqrt(float(push @ push))
            direction = -push / size if size > 0.0 else np.array([1.0, 0.0, 0.0])
        excess = 0.5 * (self.statistic - self._p.threshold)
        confidence = 1.0 / (1.0 + math.exp(-min(max(excess, -30.0), 30.0)))
        return CollisionEvent(
            stamp_s, trigger, contact_time, x_c, direction, confidence, self.statistic, self._count
        )


def _rotation_vector(
    x0: float, y0: float, z0: float, w0: float, x: float, y: float, z: float, w: float
) -> tuple[float, float, float]:
    """Rotation vector [rad], body frame, from the first quaternion to the second."""
    ex = w0 * x - x0 * w - y0 * z + z0 * y
    ey = w0 * y + x0 * z - y0 * w - z0 * x
    ez = w0 * z - x0 * y + y0 * x - z0 * w
    ew = w0 * w + x0 * x + y0 * y + z0 * z
    sine = math.sqrt(ex * ex + ey * ey + ez * ez)
    if ew < 0.0:
        ex, ey, ez, ew = -ex, -ey, -ez, -ew
    scale = 2.0 * math.atan2(sine, ew) / sine if sine > 1e-12 else 2.0
    return scale * ex, scale * ey, scale * ez


def _inverse(matrix: Array) -> Array:
    """Inverse of the innovation's covariance. It is diagonal: no axis has to do with another."""
    inverse: Array = np.diag(1.0 / matrix.diagonal())
    return inverse


@lru_cache(maxsize=256)
def _model(p: DetectorParams, step: float) -> tuple[Array, Array, Array, Array]:
    """Transition, input, process noise (acceleration held a step) and measurement noise."""
    transition = np.eye(9)
    push = np.zeros((9, 3))
    noise = np.zeros((9, 9))
    sizes = (p.acceleration_xy, p.acceleration_xy, p.acceleration_z)
    turns = (p.tilt_acceleration, p.tilt_acceleration, p.yaw_acceleration)
    for i in range(3):
        transition[i, 3 + i] = step
        gain = np.array([0.5 * step * step, step])
        push[[i, 3 + i], i] = gain
        noise[np.ix_([i, 3 + i], [i, 3 + i])] = sizes[i] ** 2 * np.outer(gain, gain)
        noise[6 + i, 6 + i] = (turns[i] * step) ** 2
    rate_noise = p.rate_noise * max(1.0, _RATE_STEP / step)
    measured = np.diag([p.position_noise**2] * 3 + [rate_noise**2] * 3)
    return transition, push, noise, measured
