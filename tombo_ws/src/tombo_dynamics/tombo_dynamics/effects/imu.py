"""Errors of gyro and accelerometer."""

from __future__ import annotations

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P


@effect(
    "imu_bias",
    Stage.IMU,
    [
        Param("gyro_x", "rad/s", 0.0, (-0.5, 0.5), "gyro offset", 0.03),
        Param("gyro_y", "rad/s", 0.0, (-0.5, 0.5), "gyro offset", 0.0),
        Param("gyro_z", "rad/s", 0.0, (-0.5, 0.5), "gyro offset", 0.0),
        Param("accel_x", "m/s^2", 0.0, (-3.0, 3.0), "accelerometer offset", 0.3),
        Param("accel_y", "m/s^2", 0.0, (-3.0, 3.0), "accelerometer offset", 0.0),
        Param("accel_z", "m/s^2", 0.0, (-3.0, 3.0), "accelerometer offset", 0.0),
    ],
    signature="constant specific force and rate in the body frame, at any heading and thrust",
    separates_from={"steady_wind": "turn by 90 to 180 deg in hover"},
)
def imu_bias(
    m: Array,
    noise: Array,
    gyro_x: float,
    gyro_y: float,
    gyro_z: float,
    accel_x: float,
    accel_y: float,
    accel_z: float,
) -> None:
    """Add constant offsets to the readings."""
    m[P.imu] += gyro_x
    m[P.imu + 1] += gyro_y
    m[P.imu + 2] += gyro_z
    m[P.imu + 3] += accel_x
    m[P.imu + 4] += accel_y
    m[P.imu + 5] += accel_z


@effect(
    "imu_noise",
    Stage.IMU,
    [
        Param("gyro", "rad/s", 0.0, (0.0, 1.0), "standard deviation of a 1 kHz sample", 0.01),
        Param("accel", "m/s^2", 0.0, (0.0, 20.0), "standard deviation of a 1 kHz sample", 0.3),
    ],
    signature="white noise on gyro and accelerometer",
)
def imu_noise(m: Array, noise: Array, gyro: float, accel: float) -> None:
    """Add white noise to the readings."""
    for i in range(3):
        m[P.imu + i] += gyro * noise[3 + i]
        m[P.imu + 3 + i] += accel * noise[6 + i]
