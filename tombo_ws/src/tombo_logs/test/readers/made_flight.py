"""Flights that are made from a formula: position, attitude, gyro and accelerometer agree.

The force on a multirotor is along body z. The second derivative of the track gives the attitude,
and its slope the rates.
"""

from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Flight, Series
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_dynamics.vehicle import ARM_X, ARM_Y, GRAVITY, SPIN
from tombo_logs.readers.log_reader import read_logs

STAND = 1.5
"""s on the ground before take-off and after landing."""
CLIMB = 2.0
"""s of take-off, and of landing."""
HEIGHT = 1.0


BAGS = Path(__file__).parents[5] / "tests" / "bags"


def recorded(name):
    """The log of a flight that was simulated and recorded."""
    (log,) = read_logs([BAGS / f"{name}.mcap"])
    return log


def smooth_step(x):
    x = np.clip(x, 0.0, 1.0)
    return x**3 * (10.0 - 15.0 * x + 6.0 * x * x)


def track(t, end, width=1.0):
    """(N, 3) m: up, a Lissajous figure, down."""
    up = smooth_step((t - STAND) / CLIMB) - smooth_step((t - end + STAND + CLIMB) / CLIMB)
    begin = STAND + CLIMB
    ease = smooth_step((t - begin) / 2.0) - smooth_step((t - end + begin + 2.0) / 2.0)
    x = width * np.sin(1.7 * (t - begin)) * ease
    y = 0.8 * width * np.sin(2.3 * (t - begin) + 0.4) * ease
    z = 0.05 + HEIGHT * up + 0.15 * width * np.sin(1.1 * (t - begin)) * ease
    return np.column_stack([x, y, z])


def made_flight(
    duration=20.0, mocap_hz=100.0, imu_hz=200.0, late=0.0, seed=0, noise=1.0, width=1.0
):
    """A log with every channel; `late` [s] is added to the stamps of the motion capture."""
    rng = np.random.default_rng(seed)
    fine = np.arange(0.0, duration, 0.002)
    spline = CubicSpline(fine, track(fine, duration, width))
    push = spline(fine, 2) + np.array([0.0, 0.0, GRAVITY])
    up = push / np.linalg.norm(push, axis=1, keepdims=True)
    yaw = 0.5 * np.sin(0.9 * fine)
    ahead = np.column_stack([np.cos(yaw), np.sin(yaw), np.zeros_like(yaw)])
    left = np.cross(up, ahead)
    left /= np.linalg.norm(left, axis=1, keepdims=True)
    turn = Rotation.from_matrix(np.stack([np.cross(left, up), left, up], axis=2))
    rates = np.zeros((fine.size, 3))
    rates[1:-1] = (turn[:-2].inv() * turn[2:]).as_rotvec() / 0.004
    force = turn.inv().apply(push)

    def at(t, values):
        return np.column_stack([np.interp(t, fine, column) for column in values.T])

    def white(count, width, deviation):
        return noise * deviation * rng.standard_normal((count, width))

    pose_t = np.arange(0.0, duration - 0.01, 1.0 / mocap_hz)
    shake = Rotation.from_rotvec(white(pose_t.size, 3, 1e-3))
    quaternion = (
        Rotation.from_quat(at(pose_t, unwrap_quaternions(turn.as_quat()))) * shake
    ).as_quat()
    position = spline(pose_t) + white(pose_t.size, 3, 2e-4)
    imu_t = np.arange(0.0, duration - 0.01, 1.0 / imu_hz)
    gyro = at(imu_t, rates) + white(imu_t.size, 3, 0.01)
    accel = at(imu_t, force) + white(imu_t.size, 3, 0.1)
    drive = drives(np.gradient(rates, fine, axis=0), force[:, 2])
    on = ((fine > STAND - 0.3) & (fine < duration - STAND + 0.3))[:, None]
    speed = 400.0 * np.sqrt(np.maximum(drive, 0.05)) * on
    commands = at(imu_t, speed)
    volts = (12.4 - 0.02 * pose_t[::10])[:, None]
    series = {
        "position": Series(pose_t + late, position),
        "attitude": Series(pose_t + late, unwrap_quaternions(quaternion)),
        "gyro": Series(imu_t, gyro),
        "accel": Series(imu_t, accel),
        "rotor_speed": Series(imu_t, commands + white(imu_t.size, 4, 1.0)),
        "rotor_command": Series(imu_t, commands),
        "voltage": Series(pose_t[::10], volts),
    }
    return Flight.measured("made", "made", series)


def drives(turning, force):
    """(N, 4) square of each rotor's speed over that in hover, for a rather nimble vehicle."""
    arms = np.array([ARM_Y, -ARM_X, -SPIN]) * np.array([[0.01], [0.01], [0.03]])
    return force[:, None] / GRAVITY + turning @ arms


def with_series(log, **changed):
    """The log with some channels replaced; None takes one out."""
    series = {**log.series, **changed}
    return log.with_series({k: s for k, s in series.items() if s is not None})


def with_values(log, channel, change):
    """The log with a channel's values changed by a function."""
    series = log.series[channel]
    return with_series(
        log, **{channel: Series(series.t, change(series.values.copy()), series.arrival)}
    )


def poses_only(log):
    return log.with_series({k: log.series[k] for k in ("position", "attitude")})


def wrote(log, *texts):
    """Findings that have all the texts in their message."""
    return [f for f in log.findings if all(text in f.message for text in texts)]
