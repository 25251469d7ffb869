"""Errors of gyro and accelerometer."""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotate_by_angles, rotation_matrix, to_body
from tombo_dynamics.vectors import add, add_scaled, clamp, dot, multiply, subtract, vector
from tombo_dynamics.vehicle import SPIN

_THIRD = 2.0 * math.pi / 3.0


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
    wx, wy, wz = vector(plant.state.rates)
    ax, ay, az = vector(plant.slope.rates)
    along = dot(plant.state.rates, (x, y, z))
    square = dot(plant.state.rates, plant.state.rates)
    plant.accel[0] += ay * z - az * y + wx * along - square * x
    plant.accel[1] += az * x - ax * z + wy * along - square * y
    plant.accel[2] += ax * y - ay * x + wz * along - square * z


@effect(
    "imu_misalignment",
    Stage.IMU,
    [
        Param("roll", "rad", 0.0, (-0.5, 0.5), "IMU turned about base_link x", 0.03),
        Param("pitch", "rad", 0.0, (-0.5, 0.5), "IMU turned about base_link y", 0.03),
        Param("yaw", "rad", 0.0, (-0.5, 0.5), "IMU turned about base_link z", 0.1),
    ],
    signature="gyro and specific force point elsewhere than thrust, the rotors' moments and mocap "
    "say, by a rotation that is fixed in the body",
    separates_from={
        "mocap_body_misalignment": "roll and pitch steps with the rotors' commands or speeds: an "
        "IMU askew turns about other axes than their moments; mocap alone: it knows no IMU",
        "imu_bias": "full and low thrust, and turns: the error grows with force and rate",
        "accel_scale": "roll and pitch steps: a turned gyro shows the rate of one axis on another",
    },
)
def imu_misalignment(plant: Plant, noise: Array, roll: float, pitch: float, yaw: float) -> None:
    """Read in the axes of an IMU that is turned by D = Rz(yaw) Ry(pitch) Rx(roll): D^T v.

    The IMU is glued askew to the frame; scales and offsets are those of its own axes.
    """
    askew = np.zeros(4)
    askew[3] = 1.0
    rotate_by_angles(askew, yaw, pitch, roll)
    turn = np.zeros((3, 3))
    rotation_matrix(askew, turn)
    plant.gyro = to_body(turn, plant.gyro)
    plant.accel = to_body(turn, plant.accel)


class VibrationState(Record):
    """Where the rotors have turned to."""

    angle = field("rad", "of each rotor at the start of the tick, from body x", 4)


@effect(
    "imu_vibration",
    Stage.IMU,
    [
        Param("displacement", "m", 0.0, (0.0, 1e-3), "amplitude on each axis, a rotor", 9e-6),
        Param("angle", "rad", 0.0, (0.0, 0.05), "amplitude about each axis, a rotor", 5e-4),
    ],
    signature="vibration of accelerometer and gyro at the speeds of all rotors, growing with "
    "speed, and no more motion than before",
    separates_from={
        "propeller_unbalance": "mocap of some kHz: an unbalance moves the whole vehicle",
        "imu_noise": "the spectrum: lines that move with the rotors' speeds",
    },
    state=VibrationState,
    vibration=True,
)
def imu_vibration(
    plant: Plant, noise: Array, state: VibrationState, displacement: float, angle: float
) -> None:
    """Shake the IMU on its mount with each rotor: by x cos wt and by an angle phi cos wt.

    Of that it reads x w^2 and phi w, the mean over the tick, on each axis a third of a turn later.
    The frame between hub and IMU bends: it turns the IMU by more than the whole vehicle turns
    (`propeller_unbalance`). Above its resonances x and phi do not depend on the speed.
    """
    if displacement <= 0.0 and angle <= 0.0:
        return
    for i in range(4):
        speed = plant.rotor_speed[i]
        half = 0.5 * SPIN[i] * speed * plant.tick_length
        mean = math.sin(half) / half if abs(half) > 1e-6 else 1.0
        for axis in range(3):
            phase = state.angle[i] + half + axis * _THIRD
            plant.accel[axis] += displacement * speed * speed * mean * math.cos(phase)
            plant.gyro[axis] += angle * speed * mean * math.sin(phase)
        state.angle[i] = (state.angle[i] + 2.0 * half) % (2.0 * math.pi)


@effect(
    "accel_range",
    Stage.IMU,
    [Param("limit", "m/s^2", 1e4, (5.0, 1e4), "largest reading of an axis", 19.6)],
    signature="specific force stays at a round number of g in a hard contact",
    contact=True,
    healthy_spread=0.0,
)
def accel_range(plant: Plant, noise: Array, limit: float) -> None:
    """Clip each axis of the accelerometer: parts have ranges of 2 to 32 g."""
    plant.accel = clamp(plant.accel, limit)


class LowPassState(Record):
    """Memory of the low-pass."""

    gyro = field("rad/s", "filtered", 3)
    accel = field("m/s^2", "filtered", 3)
    running = field("1", "there was a sample before", kind=bool)


@effect(
    "imu_low_pass",
    Stage.IMU,
    [
        Param("gyro", "s", 0.0, (0.0, 0.05), "time constant: 1 / (2 pi bandwidth)", 0.7e-3),
        Param("accel", "s", 0.0, (0.0, 0.05), "time constant: 1 / (2 pi bandwidth)", 0.6e-3),
    ],
    signature="strikes and vibration reach gyro and accelerometer weaker and later",
    separates_from={"imu_vibration": "the spectrum: a low-pass takes from noise above its band"},
    state=LowPassState,
    vibration=True,
)
def imu_low_pass(
    plant: Plant, noise: Array, state: LowPassState, gyro: float, accel: float
) -> None:
    """Band-limit the readings by a low-pass of first order."""
    if gyro <= 0.0 and accel <= 0.0:
        return
    if not state.running:
        state.gyro = plant.gyro
        state.accel = plant.accel
        state.running = True
    rate = 1.0 - math.exp(-plant.tick_length / gyro) if gyro > 0.0 else 1.0
    force = 1.0 - math.exp(-plant.tick_length / accel) if accel > 0.0 else 1.0
    state.gyro = add_scaled(state.gyro, rate, subtract(plant.gyro, state.gyro))
    state.accel = add_scaled(state.accel, force, subtract(plant.accel, state.accel))
    plant.gyro = state.gyro
    plant.accel = state.accel


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
    plant.accel = multiply(plant.accel, (1.0 + x, 1.0 + y, 1.0 + z))


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
        "imu_misalignment": "full and low thrust, and turns: an offset is the same in all",
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
    plant.gyro = add(plant.gyro, (gyro_x, gyro_y, gyro_z))
    plant.accel = add(plant.accel, (accel_x, accel_y, accel_z))


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
    plant.gyro = add_scaled(plant.gyro, gyro, noise[3:6])
    plant.accel = add_scaled(plant.accel, accel, noise[6:9])
