"""Collision detection on the mocap pose: a known region, or an unknown obstacle by innovation.

A Kalman filter predicts the next pose of a vehicle that flies freely: the acceleration follows
from the measured attitude (thrust about equal to weight), rates change slowly. A blade strike
breaks this within one or two samples: a push at the rim, a kick in yaw, one corner without thrust.
The test is the squared innovation over its covariance.

`free_flight_filter` is the filter as filterpy has it. No axis has to do with another in it, so the
compiled update works axis by axis; a test holds it to filterpy's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from filterpy.kalman import KalmanFilter

from tombo_collision.params import DetectorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled_call
from tombo_dynamics.params import as_tuple, tuple_type
from tombo_dynamics.vehicle import GRAVITY

_TRACK_TIME = 0.5
"""s: the flight's direction is that over the last half second."""
_TRACK_LENGTH = 512
"""Samples that a track can hold: half a second at 1 kHz."""
_RATE_STEP = 0.033
"""s: `rate_noise` holds for attitudes this far apart or more; closer ones give noisier rates."""
_SLOW = 0.03
"""m: a track shorter than this has no direction."""
_WARM_UP_SAMPLES = 8
_MIN_SAMPLES_FOR_GATE = 2
"""Samples after which the filter's velocity is good enough to tell a jump."""
_POSES_TO_ACCEPT_JUMP = 3
"""Samples at the new place that make a jump the truth."""

USED, EVENT, NOT_FINITE_POSE, OUT_OF_ORDER_POSE, JUMPED_POSE = range(5)
"""What became of a pose: used, used and shows a collision, refused."""
NOT_FINITE, OUT_OF_ORDER, JUMP = "not_finite", "out_of_order", "jump"
"""Why a pose was refused."""
_REFUSALS = ("", "", NOT_FINITE, OUT_OF_ORDER, JUMP)
TRIGGER_NAMES = ("", "region", "innovation")

_POSE = np.dtype(
    [("stamp_s", np.float64), ("position", np.float64, 3), ("attitude", np.float64, 4)]
)
DETECTOR = np.dtype(
    [
        ("innovation", np.bool_),  # triggers: the innovation
        ("region", np.bool_),  # and the known region
        ("follows", np.bool_),  # the filter has begun
        ("samples", np.int64),  # since it began, or since the last event
        ("position", np.float64, 3),  # filter's state: [m]
        ("velocity", np.float64, 3),  # [m/s]
        ("rates", np.float64, 3),  # [rad/s], body frame
        ("covariance", np.float64, (3, 3)),  # an axis a row: position, both, velocity
        ("rate_variance", np.float64, 3),
        ("residual", np.float64, 6),  # of the last sample: position [m], rates [rad/s]
        ("statistic", np.float64),  # normalised innovation squared; 0 where there was none
        ("ground", np.float64),  # height of the first pose, or of the floor [m]; NaN before
        ("last", _POSE),  # last sample used
        ("jumps", np.int64),  # samples on end that have jumped
        ("jumped", _POSE),  # the last of them
        ("holdoff_until", np.float64),  # no event before [s]
        ("inside", np.bool_),  # in the known region
        ("track_begin", np.int64),  # ring: first sample
        ("track_length", np.int64),
        ("track", np.float64, (_TRACK_LENGTH, 4)),  # time [s], position [m]
        ("count", np.int64),  # events so far
        ("trigger", np.int64),  # of the last event, 1 region, 2 innovation
        ("contact_s", np.float64),
        ("x_c", np.float64, 3),
        ("direction", np.float64, 3),  # of the flight before contact, unit vector
        ("confidence", np.float64),
    ],
    align=True,
)
"""Memory of the detector. Positions and directions in map."""
_Params: Any = tuple_type(DetectorParams, "_Params", __name__)


def detector_params(params: DetectorParams) -> Any:
    """Return the parameters as compiled code takes them."""
    return as_tuple(params, _Params)


def set_triggers(r: Any, params: DetectorParams) -> None:
    """Write into the memory what triggers."""
    r["innovation"] = params.trigger in ("innovation", "both")
    r["region"] = params.trigger in ("region", "both")


@compiled_call
def begin_detector(r: Any) -> None:
    """Begin before the first pose."""
    r.ground = math.nan
    r.last.stamp_s = -math.inf
    r.holdoff_until = -math.inf


@compiled_call
def _track_entry(r: Any, i: int) -> Array:
    """Return time [s] and position [m] of sample `i` of the track; -1: the last."""
    if i < 0:
        i += r.track_length
    entry: Array = r.track[(r.track_begin + i) % _TRACK_LENGTH]
    return entry


@compiled_call
def _append_to_track(r: Any, stamp_s: float, position: Array, step: float) -> None:
    """Append a sample and forget those of more than half a second ago."""
    if r.track_length == _TRACK_LENGTH:
        r.track_begin += 1
        r.track_length -= 1
    r.track_length += 1
    entry = _track_entry(r, -1)
    entry[0] = stamp_s
    for i in range(3):
        entry[1 + i] = position[i]
    oldest = stamp_s - _TRACK_TIME - 0.5 * step
    while r.track_length > 1 and _track_entry(r, 0)[0] < oldest:
        r.track_begin += 1
        r.track_length -= 1


@compiled_call
def detect(r: Any, p: Any, stamp_s: float, position: Array, attitude: Array) -> int:
    """Take a pose captured at `stamp_s` [s]; return what became of it, `USED` and so on.

    A sample that is not finite, not newer than the last one, or has jumped to where no strike
    could have put the vehicle, is refused: it changes nothing. A stamp that lies further back than
    `gap_max` means that the clock was set, three samples that agree on a new place that this is
    the truth: the filter starts anew.

    Args:
        r: the detector's memory.
        p: `detector_params`.
        stamp_s: capture time.
        position: (3) in map [m].
        attitude: quaternion xyzw (4), map from base_link.
    """
    total = stamp_s
    for i in range(3):
        total += position[i]
    for i in range(4):
        total += attitude[i]
    if not math.isfinite(total):
        return _refuse(r, NOT_FINITE_POSE)
    step = stamp_s - r.last.stamp_s
    if -p.gap_max <= step <= 0.0:
        return _refuse(r, OUT_OF_ORDER_POSE)
    follows = r.follows and 0.0 < step <= p.gap_max
    moved = False
    if not follows:
        r.jumps = 0
    elif r.samples >= _MIN_SAMPLES_FOR_GATE and _has_jumped(
        r, p, stamp_s, position, attitude, step
    ):
        if r.jumps < _POSES_TO_ACCEPT_JUMP:
            return _refuse(r, JUMPED_POSE)
        r.jumps = 0
        moved = True
        follows = False
    if math.isnan(r.ground):
        floor = p.floor_height
        r.ground = floor if position[2] > floor + p.arm_height else position[2]
    event = False
    if step < 0.0:
        r.holdoff_until = -math.inf
    if follows:
        _predict_and_update(r, p, step, position, attitude)
        armed = position[2] - r.ground > p.arm_height and stamp_s >= r.holdoff_until
        if armed:
            event = _evaluate_triggers(r, p, stamp_s, position)
    else:
        _restart(r, position)
        if moved:  # into the region, perhaps: no entry
            r.inside = _in_region(r, p, position)
    _keep_pose(r.last, stamp_s, position, attitude)
    if event:
        r.holdoff_until = stamp_s + p.holdoff
        r.track_length = 0
        r.samples = 0
        return EVENT
    if stamp_s >= r.holdoff_until and r.statistic < p.threshold:
        _append_to_track(r, stamp_s, position, step)
    return USED


@compiled_call
def _refuse(r: Any, reason: int) -> int:
    r.statistic = 0.0
    return reason


@compiled_call
def _keep_pose(pose: Any, stamp_s: float, position: Array, attitude: Array) -> None:
    pose.stamp_s = stamp_s
    for i in range(3):
        pose.position[i] = position[i]
    for i in range(4):
        pose.attitude[i] = attitude[i]


@compiled_call
def _has_jumped(
    r: Any, p: Any, stamp_s: float, position: Array, attitude: Array, step: float
) -> bool:
    """Say whether a pose is where no strike could have put it; counts those, keeps the last.

    Once one has jumped, the next belongs to whichever it is nearer to, the old place or the
    new one: the longer no pose comes from the old place, the further away that could be.
    """
    near, off = _is_reachable(r, p, r.position, r.last.attitude, position, attitude, step)
    if r.jumps > 0:
        since = stamp_s - r.jumped.stamp_s
        if since <= 0.0:
            return True
        agrees, off_new = _is_reachable(
            r, p, r.jumped.position, r.jumped.attitude, position, attitude, since
        )
        near = near and off <= off_new
        if near or not agrees:
            r.jumps = 0
    if near:
        return False
    r.jumps += 1
    _keep_pose(r.jumped, stamp_s, position, attitude)
    return True


@compiled_call
def _is_reachable(
    r: Any, p: Any, place: Array, before: Array, position: Array, attitude: Array, step: float
) -> tuple[bool, float]:
    """Return whether a strike could lead to a pose within `step` [s], and how far off it is.

    Off in units of `jump_distance` and `jump_angle`: 0 where nothing has happened.

    Args:
        r: the detector's memory.
        p: `detector_params`.
        place: (3) where it was [m].
        before: (4) attitude that it had.
        position: (3) of the pose.
        attitude: (4) of the pose.
        step: time between the two.
    """
    vx, vy, vz = r.velocity[0], r.velocity[1], r.velocity[2]
    speed = math.sqrt(vx * vx + vy * vy + vz * vz)
    dx = position[0] - place[0] - vx * step
    dy = position[1] - place[1] - vy * step
    dz = position[2] - place[2] - vz * step
    distance = math.sqrt(dx * dx + dy * dy + dz * dz)
    a = 0.0
    b = 0.0
    dot = 0.0
    for i in range(4):
        a += before[i] * before[i]
        b += attitude[i] * attitude[i]
        dot += before[i] * attitude[i]
    size = math.sqrt(a * b)
    cosine = min(abs(dot) / size, 1.0) if size > 0.0 else 1.0
    angle = 2.0 * math.acos(cosine)
    near = (
        distance <= p.jump_distance + (p.jump_speed + speed) * step
        and angle <= p.jump_angle + p.jump_rate * step
    )
    return near, distance / p.jump_distance + angle / p.jump_angle


@compiled_call
def _restart(r: Any, position: Array) -> None:
    """Begin the filter at a position, as `free_flight_filter`."""
    for i in range(3):
        r.position[i] = position[i]
        r.velocity[i] = 0.0
        r.rates[i] = 0.0
        r.covariance[i, 0] = 1e-6
        r.covariance[i, 1] = 0.0
        r.covariance[i, 2] = 1.0
        r.rate_variance[i] = 1.0
    r.follows = True
    r.samples = 0
    r.statistic = 0.0
    r.track_length = 0


@compiled_call
def _predict_and_update(r: Any, p: Any, step: float, position: Array, attitude: Array) -> None:
    """Predict over `step` [s], compare with the sample and correct."""
    ax, ay = free_acceleration(r.last.attitude, attitude)
    push = (ax, ay, 0.0)
    turn = rotation_vector(r.last.attitude, attitude)
    rate_noise = p.rate_noise * max(1.0, _RATE_STEP / step)
    half = 0.5 * step * step
    statistic = 0.0
    for i in range(3):
        size = p.acceleration_z if i == 2 else p.acceleration_xy
        spread = size * size
        x = r.position[i] + step * r.velocity[i] + half * push[i]
        v = r.velocity[i] + step * push[i]
        a, b, c = r.covariance[i, 0], r.covariance[i, 1], r.covariance[i, 2]
        a += 2.0 * step * b + step * step * c + spread * half * half
        b += step * c + spread * half * step
        c += spread * step * step
        error = position[i] - x
        total = a + p.position_noise * p.position_noise
        gain_x, gain_v = a / total, b / total
        r.position[i] = x + gain_x * error
        r.velocity[i] = v + gain_v * error
        r.covariance[i, 0] = a - gain_x * a
        r.covariance[i, 1] = b - gain_x * b
        r.covariance[i, 2] = c - gain_v * b
        r.residual[i] = error
        statistic += error * error / total

        jerk = (p.yaw_acceleration if i == 2 else p.tilt_acceleration) * step
        variance = r.rate_variance[i] + jerk * jerk
        error = turn[i] / step - r.rates[i]
        total = variance + rate_noise * rate_noise
        gain = variance / total
        r.rates[i] += gain * error
        r.rate_variance[i] = variance - gain * variance
        r.residual[3 + i] = error
        statistic += error * error / total
    r.samples += 1
    r.statistic = statistic if r.samples > _WARM_UP_SAMPLES else 0.0


@compiled_call
def free_acceleration(before: Array, after: Array) -> tuple[float, float]:
    """Return the acceleration in map x and y [m/s^2] of a free flight with the mean attitude.

    Args:
        before: quaternion xyzw (4), map from base_link.
        after: the same at the end.
    """
    x0, y0, z0, w0 = before[0], before[1], before[2], before[3]
    x, y, z, w = after[0], after[1], after[2], after[3]
    sign = -1.0 if x0 * x + y0 * y + z0 * z + w0 * w < 0.0 else 1.0
    mx, my, mz, mw = x + sign * x0, y + sign * y0, z + sign * z0, w + sign * w0
    level, tilted = mw * mw + mz * mz, mx * mx + my * my
    # beyond 57 deg of tilt it is no free flight: limited, and upside down no division by 0
    upright = max(level - tilted, 0.3 * level, 0.1 * (level + tilted))
    ax = GRAVITY * 2.0 * (mx * mz + mw * my) / upright
    return ax, GRAVITY * 2.0 * (my * mz - mw * mx) / upright


@compiled_call
def rotation_vector(before: Array, after: Array) -> tuple[float, float, float]:
    """Return the rotation vector [rad], body frame, from the first quaternion to the second."""
    x0, y0, z0, w0 = before[0], before[1], before[2], before[3]
    x, y, z, w = after[0], after[1], after[2], after[3]
    ex = w0 * x - x0 * w - y0 * z + z0 * y
    ey = w0 * y + x0 * z - y0 * w - z0 * x
    ez = w0 * z - x0 * y + y0 * x - z0 * w
    ew = w0 * w + x0 * x + y0 * y + z0 * z
    sine = math.sqrt(ex * ex + ey * ey + ez * ez)
    if ew < 0.0:
        ex, ey, ez, ew = -ex, -ey, -ez, -ew
    scale = 2.0 * math.atan2(sine, ew) / sine if sine > 1e-12 else 2.0
    return scale * ex, scale * ey, scale * ez


@compiled_call
def _evaluate_triggers(r: Any, p: Any, stamp_s: float, position: Array) -> bool:
    """Apply the triggers to the present sample; fill in an event and return True if one fires."""
    if r.innovation and r.statistic > p.threshold:
        _fill_event(r, p, stamp_s, position, 2)
        return True
    if r.region:
        inside = _in_region(r, p, position)
        entered = inside and not r.inside
        r.inside = inside
        if entered:
            _fill_event(r, p, stamp_s, position, 1)
            return True
    return False


@compiled_call
def _in_region(r: Any, p: Any, position: Array) -> bool:
    dx, dy, dz = _direction(r)
    x, y, z = position[0] - p.region_x, position[1] - p.region_y, position[2] - p.region_z
    along = x * dx + y * dy + z * dz
    x, y, z = x - along * dx, y - along * dy, z - along * dz
    across = x * x + y * y + z * z
    return bool(abs(along) < p.region_depth and across < p.region_radius * p.region_radius)


@compiled_call
def _direction(r: Any) -> tuple[float, float, float]:
    """Unit vector of the flight over the last half second before now, or zero."""
    if r.track_length > 0:
        first, last = _track_entry(r, 0), _track_entry(r, -1)
        x, y, z = last[1] - first[1], last[2] - first[2], last[3] - first[3]
        length = math.sqrt(x * x + y * y + z * z)
        if length >= _SLOW:
            return x / length, y / length, z / length
    return 0.0, 0.0, 0.0


@compiled_call
def _fill_event(r: Any, p: Any, stamp_s: float, position: Array, trigger: int) -> None:
    r.count += 1
    r.trigger = trigger
    r.contact_s = stamp_s
    for i in range(3):
        r.x_c[i] = position[i]
    if trigger == 2 and r.track_length > 0:
        first, quiet = _track_entry(r, 0), _track_entry(r, -1)
        r.contact_s = 0.5 * (quiet[0] + stamp_s)
        lasted = max(quiet[0] - first[0], 1e-3)
        for i in range(3):
            velocity = (quiet[1 + i] - first[1 + i]) / lasted
            r.x_c[i] = quiet[1 + i] + velocity * (r.contact_s - quiet[0])
    x, y, z = _direction(r)
    if x == 0.0 and y == 0.0 and z == 0.0:
        # struck at rest: the flight is taken as opposite to the push
        x, y, z = -r.residual[0], -r.residual[1], -r.residual[2]
        size = math.sqrt(x * x + y * y + z * z)
        if size > 0.0:
            x, y, z = x / size, y / size, z / size
        else:
            x, y, z = 1.0, 0.0, 0.0
    r.direction[0], r.direction[1], r.direction[2] = x, y, z
    excess = 0.5 * (r.statistic - p.threshold)
    r.confidence = 1.0 / (1.0 + math.exp(-min(max(excess, -30.0), 30.0)))


def free_flight_filter(params: DetectorParams, step: float) -> KalmanFilter:
    """Return the detector's filter at its start: position, velocity and rates, [m] and [rad].

    Transition, input, process noise (acceleration held a step) and measurement noise are for a
    step [s]; the input is the acceleration of a free flight, the measurement position and rates.
    """
    kf: Any = KalmanFilter(dim_x=9, dim_z=6, dim_u=3)
    kf.P = np.diag([1e-6] * 3 + [1.0] * 3 + [1.0] * 3)
    kf.H = np.zeros((6, 9))
    kf.H[[0, 1, 2, 3, 4, 5], [0, 1, 2, 6, 7, 8]] = 1.0
    kf.F, kf.B, kf.Q = np.eye(9), np.zeros((9, 3)), np.zeros((9, 9))
    sizes = (params.acceleration_xy, params.acceleration_xy, params.acceleration_z)
    turns = (params.tilt_acceleration, params.tilt_acceleration, params.yaw_acceleration)
    gain = np.array([0.5 * step * step, step])
    for i in range(3):
        kf.F[i, 3 + i] = step
        kf.B[[i, 3 + i], i] = gain
        kf.Q[np.ix_([i, 3 + i], [i, 3 + i])] = sizes[i] ** 2 * np.outer(gain, gain)
        kf.Q[6 + i, 6 + i] = (turns[i] * step) ** 2
    rate_noise = params.rate_noise * max(1.0, _RATE_STEP / step)
    kf.R = np.diag([params.position_noise**2] * 3 + [rate_noise**2] * 3)
    return kf


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
    """Watches capture-stamped poses; `update` returns an event when one is detected."""

    def __init__(self, params: DetectorParams) -> None:
        self.memory: Any = np.zeros(1, DETECTOR)[0]
        begin_detector(self.memory)
        self.refused = ""
        """Why the last sample was not used; empty if it was."""
        self.set_params(params)

    def set_params(self, params: DetectorParams) -> None:
        """Go on with other parameters; what was seen so far stays."""
        self._p = detector_params(params)
        set_triggers(self.memory, params)

    @property
    def statistic(self) -> float:
        """Normalised innovation squared of the last sample; 0 where there was none."""
        return float(self.memory["statistic"])

    def update(self, stamp_s: float, position: Array, attitude: Array) -> CollisionEvent | None:
        """Take a pose as `detect` does; return an event if it shows a collision."""
        r = self.memory
        result = detect(r, self._p, stamp_s, position, attitude)
        self.refused = _REFUSALS[result]
        if result != EVENT:
            return None
        return CollisionEvent(
            stamp_s,
            TRIGGER_NAMES[r["trigger"]],
            float(r["contact_s"]),
            r["x_c"].copy(),
            r["direction"].copy(),
            float(r["confidence"]),
            self.statistic,
            int(r["count"]),
        )
