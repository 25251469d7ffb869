"""Pose and velocity from gyro, accelerometer and a late mocap pose.

A fixed-gain observer: the IMU carries the state forward every millisecond, a mocap sample corrects
it at the time it was captured, known from its stamp, so latency costs no phase.
"""

from __future__ import annotations

import math

from tombo_control.autopilot import HISTORY_TICKS, A, E
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled, compiled_call
from tombo_dynamics.rotation import relative_rotation, rotate_by_vector
from tombo_dynamics.vehicle import GRAVITY

_TICK = 1e-3


@compiled
def store_history(a: Array, tick: int) -> None:
    """Store the present estimate in the history, as the state at `tick`."""
    past = A.history + 8 * (tick % HISTORY_TICKS)
    for i in range(3):
        a[past + i] = a[A.position + i]
    for i in range(4):
        a[past + 3 + i] = a[A.attitude + i]
    a[past + 7] = tick


@compiled
def update_body_rates(a: Array, imu: Array, i: int) -> None:
    """Set the body rates that the cascade flies on: gyro `imu[i:i+3]` minus its bias [rad/s].

    A reading that is not finite is left out; the last rate stands.
    """
    for k in range(3):
        if math.isfinite(imu[i + k]):
            a[A.rates + k] = imu[i + k] - a[A.gyro_bias + k]


@compiled
def to_map(a: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Turn a body vector into map by the estimated attitude."""
    qx, qy, qz, qw = a[A.attitude], a[A.attitude + 1], a[A.attitude + 2], a[A.attitude + 3]
    tx = 2.0 * (qy * z - qz * y)
    ty = 2.0 * (qz * x - qx * z)
    tz = 2.0 * (qx * y - qy * x)
    return (
        x + qw * tx + qy * tz - qz * ty,
        y + qw * ty + qz * tx - qx * tz,
        z + qw * tz + qx * ty - qy * tx,
    )


@compiled
def to_body(a: Array, x: float, y: float, z: float) -> tuple[float, float, float]:
    """Turn a map vector into the body frame by the estimated attitude."""
    qx, qy, qz, qw = a[A.attitude], a[A.attitude + 1], a[A.attitude + 2], a[A.attitude + 3]
    tx = 2.0 * (qy * z - qz * y)
    ty = 2.0 * (qz * x - qx * z)
    tz = 2.0 * (qx * y - qy * x)
    return (
        x - qw * tx + qy * tz - qz * ty,
        y - qw * ty + qz * tx - qx * tz,
        z - qw * tz + qx * ty - qy * tx,
    )


@compiled
def predict(a: Array, imu: Array, i: int, airborne: bool) -> None:
    """Carry the estimate over one tick of 1 ms with the body rates and the specific force.

    With a force that is not finite the velocity is taken as constant over the tick.

    Args:
        a: the autopilot's memory; `A.rates` is up to date.
        imu: array that holds the specific force [m/s^2], body frame.
        i: where it begins in `imu`.
        airborne: False holds the velocity at zero, as on the ground.
    """
    if airborne:
        ax, ay, az = to_map(
            a,
            imu[i] - a[A.accel_bias],
            imu[i + 1] - a[A.accel_bias + 1],
            imu[i + 2] - a[A.accel_bias + 2],
        )
        az -= GRAVITY
        if not math.isfinite(ax + ay + az):
            ax = ay = az = 0.0
        half = 0.5 * _TICK * _TICK
        a[A.position] += _TICK * a[A.velocity] + half * ax
        a[A.position + 1] += _TICK * a[A.velocity + 1] + half * ay
        a[A.position + 2] += _TICK * a[A.velocity + 2] + half * az
        a[A.velocity] += _TICK * ax
        a[A.velocity + 1] += _TICK * ay
        a[A.velocity + 2] += _TICK * az
    else:
        for k in range(3):
            a[A.velocity + k] = 0.0
    rotate_by_vector(
        a[A.attitude : A.attitude + 4],
        a[A.rates] * _TICK,
        a[A.rates + 1] * _TICK,
        a[A.rates + 2] * _TICK,
    )


@compiled
def observer_gains(bandwidth: float, period: float) -> tuple[float, float, float]:
    """Return gains on position, velocity and acceleration for three equal discrete poles.

    The critically damped alpha-beta-gamma filter: all poles at exp(-bandwidth * period)
    (Bar-Shalom, Estimation with Applications to Tracking and Navigation, 6.5).
    """
    pole = math.exp(-bandwidth * period)
    gap = 1.0 - pole
    return 1.0 - pole**3, 1.5 * gap * gap * (1.0 + pole) / period, gap**3 / (period * period)


@compiled_call
def correct(
    a: Array, pose: Array, j: int, captured: int, now: int, period: float, airborne: bool
) -> bool:
    """Correct the estimate by a pose that was captured at tick `captured` and is known at `now`.

    The present estimate must be in the history already (`store_history`).

    Args:
        a: the autopilot's memory.
        pose: array that holds position in map [m] and quaternion xyzw.
        j: where they begin in `pose`.
        captured: tick of capture.
        now: tick of arrival.
        period: time since the last sample [s]; at most 0.2 s is used.
        airborne: False keeps accelerometer bias and velocity untouched.

    Returns:
        False if the sample is from the future, from before the start, older than the history, or
        not finite.
    """
    slot = A.history + 8 * (captured % HISTORY_TICKS)
    if captured < 0 or captured > now or a[slot + 7] != captured:
        return False
    for k in range(7):
        if not math.isfinite(pose[j + k]):
            return False
    step = min(max(period, _TICK), 0.2)
    gain_p, gain_v, gain_b = observer_gains(a[E.position_bandwidth], step)
    if not airborne:
        gain_v = 0.0
        gain_b = 0.0
    pole = math.exp(-a[E.attitude_bandwidth] * step)
    gain_q = 1.0 - pole * pole
    gain_g = (1.0 - pole) ** 2 / step

    ex = pose[j] - a[slot]
    ey = pose[j + 1] - a[slot + 1]
    ez = pose[j + 2] - a[slot + 2]
    bx, by, bz = to_body(a, ex, ey, ez)
    tx, ty, tz, tw = relative_rotation(pose[j + 3 : j + 7], a[slot + 3 : slot + 7])
    sine = math.sqrt(tx * tx + ty * ty + tz * tz)
    scale = 2.0 * math.atan2(sine, tw) / sine if sine > 1e-12 else 2.0
    rx, ry, rz = scale * tx, scale * ty, scale * tz

    a[A.velocity] += gain_v * ex
    a[A.velocity + 1] += gain_v * ey
    a[A.velocity + 2] += gain_v * ez
    limit = a[E.accel_bias_max]
    a[A.accel_bias] = min(max(a[A.accel_bias] - gain_b * bx, -limit), limit)
    a[A.accel_bias + 1] = min(max(a[A.accel_bias + 1] - gain_b * by, -limit), limit)
    a[A.accel_bias + 2] = min(max(a[A.accel_bias + 2] - gain_b * bz, -limit), limit)
    cap = a[E.gyro_bias_max]
    a[A.gyro_bias] = min(max(a[A.gyro_bias] - gain_g * rx, -cap), cap)
    a[A.gyro_bias + 1] = min(max(a[A.gyro_bias + 1] - gain_g * ry, -cap), cap)
    a[A.gyro_bias + 2] = min(max(a[A.gyro_bias + 2] - gain_g * rz, -cap), cap)
    # later samples are held against the history, so it has to know of this correction
    for tick in range(captured, now + 1):
        past = A.history + 8 * (tick % HISTORY_TICKS)
        share = gain_p + gain_v * (tick - captured) * _TICK
        a[past] += share * ex
        a[past + 1] += share * ey
        a[past + 2] += share * ez
        rotate_by_vector(a[past + 3 : past + 7], gain_q * rx, gain_q * ry, gain_q * rz)
    present = A.history + 8 * (now % HISTORY_TICKS)
    for k in range(3):
        a[A.position + k] = a[present + k]
    for k in range(4):
        a[A.attitude + k] = a[present + 3 + k]
    return True


@compiled
def process_imu(a: Array, imu: Array, tick: int, steps: int, airborne: bool) -> None:
    """Take the IMU sample of `tick` and carry the estimate on to `tick + steps`.

    More than one step bridges lost samples: the last one is taken to hold.

    Args:
        a: the autopilot's memory, at `tick`.
        imu: (6) gyro [rad/s] and specific force [m/s^2], body frame.
        tick: tick of the sample.
        steps: ticks to the next sample.
        airborne: as in `predict`.
    """
    update_body_rates(a, imu, 0)
    for k in range(steps):
        predict(a, imu, 3, airborne)
        store_history(a, tick + k + 1)
