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
from typing import Any, NamedTuple

import numpy as np
from filterpy.kalman import KalmanFilter

from tombo_collision.params import DetectorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY

Model = tuple[Array, Array, Array, Array]

NOT_FINITE, OUT_OF_ORDER, JUMP = "not_finite", "out_of_order", "jump"
"""Why a pose was refused."""

_DEGREES = 6
_TRACK_TIME = 0.5
"""s: the flight's direction is that over the last half second."""
_RATE_STEP = 0.033
"""s: `rate_noise` holds for attitudes this far apart or more; closer ones give noisier rates."""
_SLOW = 0.03
"""m: a track shorter than this has no direction."""
_WARM_UP_SAMPLES = 8
_MIN_SAMPLES_FOR_GATE = 2
"""Samples after which the filter's velocity is good enough to tell a jump."""
_POSES_TO_ACCEPT_JUMP = 3
"""Samples at the new place that make a jump the truth."""
_MODELS = 256


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


class _Pose(NamedTuple):
    stamp_s: float
    position: tuple[float, ...]
    attitude: tuple[float, ...]


class CollisionDetector:
    """Watches capture-stamped poses; `update` returns an event when one is detected."""

    def __init__(self, params: DetectorParams) -> None:
        self.set_params(params)
        self._filter: Any = None
        self._ground = math.nan
        self._last_stamp = -math.inf
        self._last_attitude: tuple[float, ...] = (0.0, 0.0, 0.0, 1.0)
        self._track: deque[tuple[float, Array]] = deque()
        self._samples = 0
        self._holdoff_until = -math.inf
        self._count = 0
        self._inside = False
        self._jump_candidates: list[_Pose] = []
        self.statistic = 0.0
        """Normalised innovation squared of the last sample; 0 where there was none."""
        self.refused = ""
        """Why the last sample was not used; empty if it was."""

    def set_params(self, params: DetectorParams) -> None:
        """Go on with other parameters; what was seen so far stays."""
        self._p = params
        self._innovation = params.trigger in ("innovation", "both")
        self._region = params.trigger in ("region", "both")
        self._models: dict[float, Model] = {}

    def reset_clock(self) -> None:
        """The clock was set: take the next sample whatever its stamp is, and start anew there."""
        self._last_stamp = math.inf

    def update(self, stamp_s: float, position: Array, attitude: Array) -> CollisionEvent | None:
        """Take a pose captured at `stamp_s` [s]; return an event if it shows a collision.

        A sample that is not finite, not newer than the last one, or has jumped to where no strike
        could have put the vehicle, is refused: it changes nothing, `refused` says why. A stamp
        that lies further back than `gap_max` means that the clock was set, three samples that
        agree on a new place that this is the truth: the filter starts anew. The arrays may be used
        again by the caller.

        Args:
            stamp_s: capture time.
            position: (3) in map [m].
            attitude: quaternion xyzw (4), map from base_link.
        """
        pose = _Pose(stamp_s, tuple(position.tolist()), tuple(attitude.tolist()))
        if not math.isfinite(stamp_s + sum(pose.position) + sum(pose.attitude)):
            self._refuse(NOT_FINITE)
            return None
        step = stamp_s - self._last_stamp
        if -self._p.gap_max <= step <= 0.0:
            self._refuse(OUT_OF_ORDER)
            return None
        follows = self._filter is not None and 0.0 < step <= self._p.gap_max
        moved = False
        if not follows:
            self._jump_candidates.clear()
        elif self._samples >= _MIN_SAMPLES_FOR_GATE and self._has_jumped(pose, step):
            if len(self._jump_candidates) < _POSES_TO_ACCEPT_JUMP:
                self._refuse(JUMP)
                return None
            self._jump_candidates.clear()
            moved, follows = True, False
        self.refused = ""
        position = position.copy()
        if self._ground != self._ground:
            floor, first = self._p.floor_height, pose.position[2]
            self._ground = floor if first > floor + self._p.arm_height else first
        event = None
        if step < 0.0:
            self._holdoff_until = -math.inf
        if follows:
            self._predict_and_update(step, pose)
            armed = (
                pose.position[2] - self._ground > self._p.arm_height
                and stamp_s >= self._holdoff_until
            )
            if armed:
                event = self._evaluate_triggers(stamp_s, position)
        else:
            self._restart(position)
            if moved:  # into the region, perhaps: no entry
                self._inside = self._in_region(position)
        self._last_stamp = stamp_s
        self._last_attitude = pose.attitude
        if event is not None:
            self._holdoff_until = stamp_s + self._p.holdoff
            self._track.clear()
            self._samples = 0
        elif stamp_s >= self._holdoff_until and self.statistic < self._p.threshold:
            self._track.append((stamp_s, position))
            oldest = stamp_s - _TRACK_TIME - 0.5 * step
            while len(self._track) > 1 and self._track[0][0] < oldest:
                self._track.popleft()
        return event

    def _refuse(self, reason: str) -> None:
        self.refused = reason
        self.statistic = 0.0

    def _has_jumped(self, pose: _Pose, step: float) -> bool:
        """Say whether a pose is where no strike could have put it; `_jump_candidates` keeps those.

        Once one has jumped, the next belongs to whichever it is nearer to, the old place or the
        new one: the longer no pose comes from the old place, the further away that could be.
        """
        x, y, z, vx, vy, vz = self._filter.x[:6, 0].tolist()
        velocity, speed = (vx, vy, vz), math.sqrt(vx * vx + vy * vy + vz * vz)
        near, off = self._is_reachable((x, y, z), velocity, speed, self._last_attitude, pose, step)
        if not self._jump_candidates:
            if not near:
                self._jump_candidates.append(pose)
            return not near
        last = self._jump_candidates[-1]
        since = pose.stamp_s - last.stamp_s
        if since <= 0.0:
            return True
        agrees, off_new = self._is_reachable(
            last.position, velocity, speed, last.attitude, pose, since
        )
        if near and off <= off_new:
            self._jump_candidates.clear()
            return False
        if not agrees:
            self._jump_candidates.clear()
        self._jump_candidates.append(pose)
        return True

    def _is_reachable(
        self,
        place: tuple[float, ...],
        velocity: tuple[float, ...],
        speed: float,
        attitude: tuple[float, ...],
        pose: _Pose,
        step: float,
    ) -> tuple[bool, float]:
        """Return whether a strike could lead to `pose` within `step` [s], and how far off it is.

        Off in units of `jump_distance` and `jump_angle`: 0 where nothing has happened.
        """
        p = self._p
        px, py, pz = pose.position
        dx = px - place[0] - velocity[0] * step
        dy = py - place[1] - velocity[1] * step
        dz = pz - place[2] - velocity[2] * step
        distance = math.sqrt(dx * dx + dy * dy + dz * dz)
        x0, y0, z0, w0 = attitude
        x, y, z, w = pose.attitude
        size = math.sqrt((x0 * x0 + y0 * y0 + z0 * z0 + w0 * w0) * (x * x + y * y + z * z + w * w))
        cosine = min(abs(x0 * x + y0 * y + z0 * z + w0 * w) / size, 1.0) if size > 0.0 else 1.0
        angle = 2.0 * math.acos(cosine)
        near = (
            distance <= p.jump_distance + (p.jump_speed + speed) * step
            and angle <= p.jump_angle + p.jump_rate * step
        )
        return near, distance / p.jump_distance + angle / p.jump_angle

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

    def _model(self, step: float) -> Model:
        """Return the filter's matrices for a step [s], rounded to microseconds."""
        step = round(step, 6)
        model = self._models.get(step)
        if model is None:
            if len(self._models) >= _MODELS:
                self._models.clear()
            model = self._models[step] = _model(self._p, step)
        return model

    def _predict_and_update(self, step: float, pose: _Pose) -> None:
        """Predict over `step` [s], compare with the sample and correct."""
        kf = self._filter
        kf.F, kf.B, kf.Q, kf.R = self._model(step)
        x0, y0, z0, w0 = self._last_attitude
        x, y, z, w = pose.attitude
        # acceleration of a free flight, from the mean attitude over the step
        mx, my, mz, mw = x0 + x, y0 + y, z0 + z, w0 + w
        if x0 * x + y0 * y + z0 * z + w0 * w < 0.0:
            mx, my, mz, mw = x - x0, y - y0, z - z0, w - w0
        level, tilted = mw * mw + mz * mz, mx * mx + my * my
        # beyond 57 deg of tilt it is no free flight: limited, and upside down no division by 0
        upright = max(mw * mw + mz * mz - mx * mx - my * my, 0.3 * level, 0.1 * (level + tilted))
        ax = GRAVITY * 2.0 * (mx * mz + mw * my) / upright
        ay = GRAVITY * 2.0 * (my * mz - mw * mx) / upright
        rx, ry, rz = _rotation_vector(x0, y0, z0, w0, x, y, z, w)
        kf.predict(u=np.array([[ax], [ay], [0.0]]))
        px, py, pz = pose.position
        kf.update(np.array([[px], [py], [pz], [rx / step], [ry / step], [rz / step]]))
        y_ = kf.y[:, 0]
        self._samples += 1
        self.statistic = float(y_ @ kf.SI @ y_) if self._samples > _WARM_UP_SAMPLES else 0.0

    def _evaluate_triggers(self, stamp_s: float, position: Array) -> CollisionEvent | None:
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
    inverse = np.zeros((_DEGREES, _DEGREES))
    inverse.flat[:: _DEGREES + 1] = 1.0 / matrix.diagonal()
    return inverse


def _model(p: DetectorParams, step: float) -> Model:
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
