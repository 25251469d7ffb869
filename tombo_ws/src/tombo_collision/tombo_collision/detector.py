"""Collision detection on the mocap pose: a known region, or an unknown obstacle by innovation.

A Kalman filter predicts the next pose of a vehicle that flies freely: the acceleration follows
from the measured attitude (thrust about equal to weight), rates change slowly. A blade strike
breaks this within one or two samples: a push at the rim, a kick in yaw, one corner without thrust.
The test is the squared innovation over its covariance.

No axis of the filter has to do with another, so its update works axis by axis; a test holds it to
the whole filter of filterpy.
"""

from __future__ import annotations

import math
from typing import Any

from tombo_collision.params import DetectorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotation_vector
from tombo_dynamics.vectors import ZERO, norm, scale, subtract
from tombo_dynamics.vehicle import GRAVITY

_TRACK_TIME = 0.5
"""s: the flight's direction is that over the last half second."""
_TRACK_LENGTH = 512
"""Samples that a track can hold: half a second at 1 kHz."""
RATE_STEP = 0.033
"""s: `rate_noise` holds for attitudes this far apart or more; closer ones give noisier rates."""
_SLOW = 0.03
"""m: a track shorter than this has no direction."""
WARM_UP_SAMPLES = 8
_MIN_SAMPLES_FOR_GATE = 2
"""Samples after which the filter's velocity is good enough to tell a jump."""
_SAME_STEP, _MOST_PERIODS, _SURELY_NEARER = 0.1, 3, 0.25
"""A step that differs by this share may be a clock that was set; it is, where some periods explain
the way with less than this share of the error."""
RESUMED_SPEED = 0.3
"""m/s: standard deviation that the filter's velocity has behind a jump of the stamps."""
_POSES_TO_ACCEPT_JUMP = 3
"""Samples at the new position after which a jump is accepted."""


class StampedPose(Record):
    """A pose with its time."""

    stamp_s = field("s", "capture")
    position = field("m", "in map", 3)
    attitude = field("1", "quaternion xyzw, map from base_link", 4)


class TrackEntry(Record):
    """A place on the way."""

    stamp_s = field("s", "capture")
    position = field("m", "in map", 3)


class DetectorMemory(Record):
    """Memory of the detector. Positions and directions in map, rates in the body frame."""

    innovation = field("1", "the innovation triggers", kind=bool)
    region = field("1", "the known region triggers", kind=bool)
    follows = field("1", "the filter has begun", kind=bool)
    collided = field("1", "the last pose shows a collision", kind=bool)
    samples = field("1", "since it began, or since the last event", kind=int)
    position = field("m", "state of the filter, as the next ones", 3)
    velocity = field("m/s", "map", 3)
    rates = field("rad/s", "body", 3)
    covariance = field(
        "", "an axis a row: position [m^2], both [m^2/s], velocity [m^2/s^2]", (3, 3)
    )
    rate_variance = field("rad^2/s^2", "body", 3)
    position_residual = field("m", "of the last sample: position", 3)
    rate_residual = field("rad/s", "of the last sample", 3)
    statistic = field("1", "normalised innovation squared; 0 where there was none")
    ground = field("m", "height of the first pose, or of the floor; NaN before")
    last = field("", "last sample used", kind=StampedPose)
    period = field("s", "between the last two samples that followed each other")
    jumps = field("1", "consecutive samples that have jumped", kind=int)
    jumped = field("", "the last of them", kind=StampedPose)
    holdoff_until = field("s", "no event before")
    inside = field("1", "in the known region", kind=bool)
    track_begin = field("1", "ring: first sample", kind=int)
    track_length = field("1", "samples in the ring", kind=int)
    track = field("", "the way of the last half second, a ring", _TRACK_LENGTH, TrackEntry)
    count = field("1", "events so far", kind=int)
    trigger = field("1", "of the last event: a `Trigger`; 0: none yet", kind=int)
    contact_s = field("s", "of the last event")
    x_c = field("m", "of the last event: base_link at contact", 3)
    direction = field("1", "of the flight before contact, unit vector", 3)
    confidence = field("1", "of the last event")


def set_triggers(memory: DetectorMemory, params: DetectorParams) -> None:
    """Write into the memory what triggers."""
    memory.innovation = params.trigger in ("innovation", "both")
    memory.region = params.trigger in ("region", "both")


@compiled(inline=False)
def begin_detector(memory: DetectorMemory) -> None:
    """Begin before the first pose."""
    memory.ground = math.nan
    memory.last.stamp_s = -math.inf
    memory.holdoff_until = -math.inf


@compiled(inline=False)
def _track_index(memory: DetectorMemory, i: int) -> int:
    """Return where sample `i` of the track is in the ring; -1: the last."""
    if i < 0:
        i += memory.track_length
    return int((memory.track_begin + i) % _TRACK_LENGTH)


@compiled(inline=False)
def _append_to_track(memory: DetectorMemory, stamp_s: float, position: Array, step: float) -> None:
    """Append a sample and forget those of more than half a second ago."""
    if memory.track_length == _TRACK_LENGTH:
        memory.track_begin += 1
        memory.track_length -= 1
    memory.track_length += 1
    entry = memory.track[_track_index(memory, -1)]
    entry.stamp_s = stamp_s
    entry.position = position
    oldest = stamp_s - _TRACK_TIME - 0.5 * step
    while memory.track_length > 1 and memory.track[_track_index(memory, 0)].stamp_s < oldest:
        memory.track_begin += 1
        memory.track_length -= 1


@compiled(inline=False)
def detect(
    memory: DetectorMemory,
    params: DetectorParams,
    stamp_s: float,
    position: Array,
    attitude: Array,
) -> PoseRefusal:
    """Take a pose captured at `stamp_s` [s]; return why it is not used, a `PoseRefusal`.

    A sample that is not finite, not newer than the last one, or out of reach of a strike is
    refused: it changes nothing. The filter starts again after three samples that agree on a new
    position, and where stamps are more than `gap_max` apart. A clock was set if such a sample is
    where the vehicle would be a period later. It was also set if the distance matches several
    periods and the step does not. The filter then continues: this sample raises no alarm, the next
    one may.

    Args:
        memory: of the detector.
        params: of the detector.
        stamp_s: capture time.
        position: (3) in map [m].
        attitude: quaternion xyzw (4), map from base_link.
    """
    memory.collided = False
    total = stamp_s
    for i in range(3):
        total += position[i]
    for i in range(4):
        total += attitude[i]
    if not math.isfinite(total):
        return _refuse(memory, PoseRefusal.NOT_FINITE)
    step = stamp_s - memory.last.stamp_s
    if -params.gap_max <= step <= 0.0:
        return _refuse(memory, PoseRefusal.OUT_OF_ORDER)
    follows = memory.follows and 0.0 < step <= params.gap_max
    apart = not follows or _took_whole_periods(memory, position, step)
    clock_set = memory.follows and apart and _continues(memory, params, position, attitude)
    moved = False
    if clock_set:
        follows = False
        _shift_times(memory, stamp_s - memory.period - memory.last.stamp_s)
        step = memory.period
    if not follows:
        memory.jumps = 0
    elif memory.samples >= _MIN_SAMPLES_FOR_GATE and _has_jumped(
        memory, params, stamp_s, position, attitude, step
    ):
        if memory.jumps < _POSES_TO_ACCEPT_JUMP:
            return _refuse(memory, PoseRefusal.JUMP)
        memory.jumps = 0
        moved = True
        follows = False
    if math.isnan(memory.ground):
        floor = params.floor_height
        memory.ground = floor if position[2] > floor + params.arm_height else position[2]
    event = False
    if step < 0.0:
        memory.holdoff_until = -math.inf
    if follows:
        _predict_and_update(memory, params, step, position, attitude)
        armed = position[2] - memory.ground > params.arm_height and stamp_s >= memory.holdoff_until
        if armed:
            event = _evaluate_triggers(memory, params, stamp_s, position)
        memory.period = step
    elif clock_set:
        _put_filter(memory, position, RESUMED_SPEED)
    else:
        _restart(memory, position)
        if moved:  # into the region, perhaps: no entry
            memory.inside = _in_region(memory, params, position)
    _keep_pose(memory.last, stamp_s, position, attitude)
    if event:
        memory.holdoff_until = stamp_s + params.holdoff
        memory.track_length = 0
        memory.samples = 0
        memory.collided = True
    elif stamp_s >= memory.holdoff_until and memory.statistic < params.threshold:
        _append_to_track(memory, stamp_s, position, step)
    return PoseRefusal.NONE


@compiled(inline=False)
def _refuse(memory: DetectorMemory, reason: PoseRefusal) -> PoseRefusal:
    memory.statistic = 0.0
    return reason


@compiled(inline=False)
def _keep_pose(pose: Any, stamp_s: float, position: Array, attitude: Array) -> None:
    pose.stamp_s = stamp_s
    pose.position = position
    pose.attitude = attitude


@compiled(inline=False)
def _has_jumped(
    memory: DetectorMemory,
    params: DetectorParams,
    stamp_s: float,
    position: Array,
    attitude: Array,
    step: float,
) -> bool:
    """Say whether a pose is where no strike could have put it; counts those, keeps the last.

    Once one has jumped, the next belongs to whichever it is nearer to, the old place or the
    new one: the longer no pose comes from the old place, the further away that could be.
    """
    near, off = _is_reachable(
        memory, params, memory.position, memory.last.attitude, position, attitude, step
    )
    if memory.jumps > 0:
        since = stamp_s - memory.jumped.stamp_s
        if since <= 0.0:
            return True
        agrees, off_new = _is_reachable(
            memory,
            params,
            memory.jumped.position,
            memory.jumped.attitude,
            position,
            attitude,
            since,
        )
        near = near and off <= off_new
        if near or not agrees:
            memory.jumps = 0
    if near:
        return False
    memory.jumps += 1
    _keep_pose(memory.jumped, stamp_s, position, attitude)
    return True


@compiled(inline=False)
def _is_reachable(
    memory: DetectorMemory,
    params: DetectorParams,
    place: Array,
    before: Array,
    position: Array,
    attitude: Array,
    step: float,
) -> tuple[bool, float]:
    """Return whether a strike could lead to a pose within `step` [s], and how far off it is.

    Off in units of `jump_distance` and `jump_angle`: 0 where nothing has happened.

    Args:
        memory: of the detector.
        params: of the detector.
        place: (3) where it was [m].
        before: (4) attitude that it had.
        position: (3) of the pose.
        attitude: (4) of the pose.
        step: time between the two.
    """
    speed = norm(memory.velocity)
    distance = _distance_off(memory, place, position, step)
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
        distance <= params.jump_distance + (params.jump_speed + speed) * step
        and angle <= params.jump_angle + params.jump_rate * step
    )
    return near, distance / params.jump_distance + angle / params.jump_angle


@compiled(inline=False)
def _distance_off(memory: DetectorMemory, place: Array, position: Array, step: float) -> float:
    """Return how far a position is from where the filter's velocity leads from a place [m]."""
    return norm(subtract(subtract(position, place), scale(step, memory.velocity)))


@compiled(inline=False)
def _restart(memory: DetectorMemory, position: Array) -> None:
    """Begin the filter at a position."""
    _put_filter(memory, position, 1.0)
    memory.velocity = memory.rates = ZERO
    memory.follows = True
    memory.samples = 0
    memory.track_length = 0


@compiled(inline=False)
def _put_filter(memory: DetectorMemory, position: Array, speed_deviation: float) -> None:
    """Put the filter to a position; velocity and rates stay, but are not known so well."""
    for i in range(3):
        memory.position[i] = position[i]
        memory.covariance[i, 0] = 1e-6
        memory.covariance[i, 1] = 0.0
        memory.covariance[i, 2] = speed_deviation * speed_deviation
        memory.rate_variance[i] = 1.0
    memory.statistic = 0.0


@compiled(inline=False)
def _continues(
    memory: DetectorMemory, params: DetectorParams, position: Array, attitude: Array
) -> bool:
    """Return whether a pose is where the vehicle would be a period after the last one."""
    if memory.samples <= WARM_UP_SAMPLES or memory.period <= 0.0:
        return False
    near, _ = _is_reachable(
        memory, params, memory.position, memory.last.attitude, position, attitude, memory.period
    )
    return near


@compiled(inline=False)
def _took_whole_periods(memory: DetectorMemory, position: Array, step: float) -> bool:
    """Return whether the way since the last sample is that of some periods, and `step` another."""
    if abs(step - memory.period) < _SAME_STEP * memory.period:
        return False
    place = memory.position
    nearer = _SURELY_NEARER * _distance_off(memory, place, position, step)
    for periods in range(1, _MOST_PERIODS + 1):
        if _distance_off(memory, place, position, periods * memory.period) < nearer:
            return True
    return False


@compiled(inline=False)
def _shift_times(memory: DetectorMemory, by_s: float) -> None:
    """Move all that was seen to another time, as if the clock had always been set so."""
    memory.last.stamp_s += by_s
    memory.holdoff_until += by_s
    for i in range(memory.track_length):
        memory.track[_track_index(memory, i)].stamp_s += by_s


@compiled(inline=False)
def _predict_and_update(
    memory: DetectorMemory, params: DetectorParams, step: float, position: Array, attitude: Array
) -> None:
    """Predict over `step` [s], compare with the sample and correct."""
    ax, ay = free_acceleration(memory.last.attitude, attitude)
    push = (ax, ay, 0.0)
    turn = rotation_vector(attitude, memory.last.attitude)
    rate_noise = params.rate_noise * max(1.0, RATE_STEP / step)
    half = 0.5 * step * step
    statistic = 0.0
    for i in range(3):
        # position and velocity of an axis: x <- F x, P <- F P F' + Q, then K = P H' / S
        size = params.acceleration_z if i == 2 else params.acceleration_xy
        q = size * size
        x = memory.position[i] + step * memory.velocity[i] + half * push[i]
        v = memory.velocity[i] + step * push[i]
        P = memory.covariance[i]
        P_xx, P_xv, P_vv = P[0], P[1], P[2]
        P_xx += 2.0 * step * P_xv + step * step * P_vv + q * half * half
        P_xv += step * P_vv + q * half * step
        P_vv += q * step * step
        y = position[i] - x
        S = P_xx + params.position_noise * params.position_noise
        K_x, K_v = P_xx / S, P_xv / S
        memory.position[i] = x + K_x * y
        memory.velocity[i] = v + K_v * y
        P[0] = P_xx - K_x * P_xx
        P[1] = P_xv - K_x * P_xv
        P[2] = P_vv - K_v * P_xv
        memory.position_residual[i] = y
        statistic += y * y / S

        # body rate of an axis: a random walk
        jerk = (params.yaw_acceleration if i == 2 else params.tilt_acceleration) * step
        P_w = memory.rate_variance[i] + jerk * jerk
        y = turn[i] / step - memory.rates[i]
        S = P_w + rate_noise * rate_noise
        K = P_w / S
        memory.rates[i] += K * y
        memory.rate_variance[i] = P_w - K * P_w
        memory.rate_residual[i] = y
        statistic += y * y / S
    memory.samples += 1
    memory.statistic = statistic if memory.samples > WARM_UP_SAMPLES else 0.0


@compiled(inline=False)
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
    # a free flight tilts by less than 57 deg; the limit also avoids a division by 0 upside down
    upright = max(level - tilted, 0.3 * level, 0.1 * (level + tilted))
    ax = GRAVITY * 2.0 * (mx * mz + mw * my) / upright
    return ax, GRAVITY * 2.0 * (my * mz - mw * mx) / upright


@compiled(inline=False)
def _evaluate_triggers(
    memory: DetectorMemory, params: DetectorParams, stamp_s: float, position: Array
) -> bool:
    """Apply the triggers to the present sample; fill in an event and return True if one fires."""
    if memory.innovation and memory.statistic > params.threshold:
        _fill_event(memory, params, stamp_s, position, 2)
        return True
    if memory.region:
        inside = _in_region(memory, params, position)
        entered = inside and not memory.inside
        memory.inside = inside
        if entered:
            _fill_event(memory, params, stamp_s, position, 1)
            return True
    return False


@compiled(inline=False)
def _in_region(memory: DetectorMemory, params: DetectorParams, position: Array) -> bool:
    dx, dy, dz = _direction(memory)
    x, y, z = (
        position[0] - params.region_x,
        position[1] - params.region_y,
        position[2] - params.region_z,
    )
    along = x * dx + y * dy + z * dz
    x, y, z = x - along * dx, y - along * dy, z - along * dz
    across = x * x + y * y + z * z
    return bool(
        abs(along) < params.region_depth and across < params.region_radius * params.region_radius
    )


@compiled(inline=False)
def _direction(memory: DetectorMemory) -> tuple[float, float, float]:
    """Unit vector of the flight over the last half second before now, or zero."""
    if memory.track_length > 0:
        first, last = memory.track[_track_index(memory, 0)], memory.track[_track_index(memory, -1)]
        here, there = last.position, first.position
        x, y, z = here[0] - there[0], here[1] - there[1], here[2] - there[2]
        length = math.sqrt(x * x + y * y + z * z)
        if length >= _SLOW:
            return x / length, y / length, z / length
    return 0.0, 0.0, 0.0


@compiled(inline=False)
def _fill_event(
    memory: DetectorMemory, params: DetectorParams, stamp_s: float, position: Array, trigger: int
) -> None:
    memory.count += 1
    memory.trigger = trigger
    memory.contact_s = stamp_s
    memory.x_c = position
    if trigger == 2 and memory.track_length > 0:
        first = memory.track[_track_index(memory, 0)]
        before = memory.track[_track_index(memory, -1)]
        memory.contact_s = 0.5 * (before.stamp_s + stamp_s)
        lasted = max(before.stamp_s - first.stamp_s, 1e-3)
        for i in range(3):
            velocity = (before.position[i] - first.position[i]) / lasted
            memory.x_c[i] = before.position[i] + velocity * (memory.contact_s - before.stamp_s)
    x, y, z = _direction(memory)
    if x == 0.0 and y == 0.0 and z == 0.0:
        # struck at rest: the flight is taken as opposite to the push
        push = memory.position_residual
        x, y, z = -push[0], -push[1], -push[2]
        size = math.sqrt(x * x + y * y + z * z)
        if size > 0.0:
            x, y, z = x / size, y / size, z / size
        else:
            x, y, z = 1.0, 0.0, 0.0
    memory.direction = (x, y, z)
    excess = 0.5 * (memory.statistic - params.threshold)
    memory.confidence = 1.0 / (1.0 + math.exp(-min(max(excess, -30.0), 30.0)))
