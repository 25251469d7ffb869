"""Errors of gyro and accelerometer."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant


@effect(
    "imu_lever_arm",
    Stage.IMU,
    [
        Param("x", "m", 0.0, (-0.3, 0.3), "accelerometer ahead of the centre of mass", 0.03),
        Param("y", "m", 0.0, (-0.3, 0.3), "accelerometer left of the centre of mass", 0.03),
        Param("z", "m", 0.0, (-0.3, 0.3), "accelerometer above the centre of mass", 0.03),
    ],
    signature="specific force follows the angular acceleration and the square of the rates",
    separates_from={
        "mocap_marker_offset": "mocap alone: its track knows nothing of the accelerometer",
        "flapping_moment": "rate steps in hover: a lever arm needs rotation, flapping speed",
    },
)
def imu_lever_arm(plant: Plant, noise: Array, x: float, y: float, z: float) -> None:
    """Read the force at r = (x, y, z) from the centre of mass: add w' x r + w x (w x r).

    Rates and angular acceleration are those at the start of the tick (rigid-body kinematics).
    """
    rates = plant.state.rates
    wx, wy, wz = rates[0], rates[1], rates[2]
    turning = plant.slope.rates
    ax, ay, az = turning[0], turning[1], turning[2]
    along = wx * x + wy * y + wz * z
    square = wx * wx + wy * wy + wz * wz
    plant.accel[0] += ay * z - az * y + wx * along - square * x
    plant.accel[1] += az * x - ax * z + wy * along - square * y
    plant.accel[2] += ax * y - ay * x + wz * along - square * z


@effect(
    "accel_scale",
    Stage.IMU,
    [
        Param("x", "1", 0.0, (-0.2, 0.2), "reading over truth, minus 1", 0.15),
        Param("y", "1", 0.0, (-0.2, 0.2), "reading over truth, minus 1", 0.15),
        Param("z", "1", 0.0, (-0.2, 0.2), "reading over truth, minus 1", 0.03),
    ],
    signature="specific force off by a factor on each axis, while mocap's acceleration is right",
    separates_from={
        "mass_error": "mocap's acceleration, or the reading at rest on the floor",
        "thrust_coefficient_error": "mocap's acceleration, or the reading at rest on the floor",
        "imu_bias": "full and low thrust: a scale grows with the reading",
    },
)
def accel_scale(plant: Plant, noise: Array, x: float, y: float, z: float) -> None:
    """Scale the accelerometer's readings by 1 + x, 1 + y, 1 + z."""
    plant.accel[0] *= 1.0 + x
    plant.accel[1] *= 1.0 + y
    plant.accel[2] *= 1.0 + z


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
    separates_from={
        "steady_wind": "turn by 90 to 180 deg in hover",
        "mocap_body_misalignment": "mocap alone: its own acceleration against its own attitude",
        "accel_scale": "full and low thrust: a scale grows with the reading",
    },
)
def imu_bias(
    plant: Plant,
    noise: Array,
    gyro_x: float,
    gyro_y: float,
    gyro_z: float,
    accel_x: float,
    accel_y: float,
    accel_z: float,
) -> None:
    """Add constant offsets to the readings."""
    plant.gyro[0] += gyro_x
    plant.gyro[1] += gyro_y
    plant.gyro[2] += gyro_z
    plant.accel[0] += accel_x
    plant.accel[1] += accel_y
    plant.accel[2] += accel_z


@effect(
    "imu_noise",
    Stage.IMU,
    [
        Param("gyro", "rad/s", 0.0, (0.0, 1.0), "standard deviation of a 1 kHz sample", 0.01),
        Param("accel", "m/s^2", 0.0, (0.0, 20.0), "standard deviation of a 1 kHz sample", 0.3),
    ],
    signature="white noise on gyro and accelerometer",
    stochastic=True,
)
def imu_noise(plant: Plant, noise: Array, gyro: float, accel: float) -> None:
    """Add white noise to the readings."""
    for i in range(3):
        plant.gyro[i] += gyro * noise[3 + i]
        plant.accel[i] += accel * noise[6 + i]
