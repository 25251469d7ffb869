"""Errors of motion capture: the frame, the time, the noise, the gaps."""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import (
    relative_rotation,
    rotate_by_angles,
    rotate_by_vector,
    rotation_matrix,
    to_map,
)
from tombo_dynamics.vectors import add, add_scaled, scale


@effect(
    "mocap_marker_offset",
    Stage.MOCAP,
    [
        Param("x", "m", 0.0, (-0.2, 0.2), "tracked point ahead of the centre of mass", 0.02),
        Param("y", "m", 0.0, (-0.2, 0.2), "tracked point left of the centre of mass", 0.02),
        Param("z", "m", 0.0, (-0.2, 0.2), "tracked point above the centre of mass", 0.02),
    ],
    signature="the track swings with the attitude: acceleration that follows the angular one, and "
    "a circle when the vehicle turns in place",
    separates_from={
        "imu_lever_arm": "turn in place: the track of an offset point draws a circle",
        "cog_offset": "rate steps: a centre of gravity off the axis shows as a moment",
    },
)
def mocap_marker_offset(plant: Plant, noise: Array, x: float, y: float, z: float) -> None:
    """Track the point (x, y, z) of base_link: its position is p + R (x, y, z)."""
    turn = np.zeros((3, 3))
    rotation_matrix(plant.mocap.attitude, turn)
    plant.mocap.position = add(plant.mocap.position, to_map(turn, (x, y, z)))


@effect(
    "mocap_body_misalignment",
    Stage.MOCAP,
    [
        Param("yaw", "rad", 0.0, (-3.2, 3.2), "rigid body turned about base_link z", 0.1),
        Param("roll", "rad", 0.0, (-0.5, 0.5), "rigid body turned about base_link x", 0.02),
        Param("pitch", "rad", 0.0, (-0.5, 0.5), "rigid body turned about base_link y", 0.02),
    ],
    signature="thrust, drag and rates point elsewhere than the attitude says, by a rotation that "
    "is fixed in the body; the track is right",
    separates_from={
        "mocap_misalignment": "turn by 90 to 180 deg in hover: the lean of a body misalignment "
        "turns with the vehicle, that of a tilted world does not",
        "steady_wind": "turn by 90 to 180 deg in hover: only the body's lean turns with it",
        "imu_bias": "mocap alone: its own acceleration against its own attitude",
        "imu_misalignment": "roll and pitch steps with the rotors' commands or speeds: gyro and "
        "their moments agree on the axis; mocap alone: its own acceleration against its attitude",
    },
)
def mocap_body_misalignment(
    plant: Plant, noise: Array, yaw: float, roll: float, pitch: float
) -> None:
    """Turn the attitude about its own axes by Rz(yaw) Ry(pitch) Rx(roll), on the right.

    The rigid body was defined in the mocap software while the vehicle did not stand along its
    axes. Position is untouched.
    """
    rotate_by_angles(plant.mocap.attitude, yaw, pitch, roll)


@effect(
    "mocap_misalignment",
    Stage.MOCAP,
    [
        Param("yaw", "rad", 0.0, (-3.2, 3.2), "mocap frame turned about map z", 0.1),
        Param("roll", "rad", 0.0, (-0.5, 0.5), "mocap frame tilted about map x", 0.02),
        Param("pitch", "rad", 0.0, (-0.5, 0.5), "mocap frame tilted about map y", 0.02),
    ],
    signature="roll and pitch: gravity leans by a fixed angle in map, at any heading and speed; "
    "yaw: nothing, unless wind or an obstacle of known place says where north is",
    separates_from={
        "steady_wind": "the pose at rest on a level floor leans with the frame, not with the wind",
        "mocap_body_misalignment": "turn by 90 to 180 deg in hover: the lean of a tilted world "
        "stays in map, that of a body misalignment turns with the vehicle",
    },
)
def mocap_misalignment(plant: Plant, noise: Array, yaw: float, roll: float, pitch: float) -> None:
    """Turn position and attitude by Rz(yaw) Ry(pitch) Rx(roll) about the map's origin.

    The whole world is turned, so only things fixed in it show the error: gravity shows roll and
    pitch. The dynamics do not depend on yaw; a wind of known direction or an obstacle of known
    place shows it.
    """
    turn = np.zeros(4)
    turn[3] = 1.0
    rotate_by_angles(turn, yaw, pitch, roll)
    matrix = np.zeros((3, 3))
    rotation_matrix(turn, matrix)
    plant.mocap.position = to_map(matrix, plant.mocap.position)
    # turn * q, written as conj(conj(turn)) * q
    turn[0], turn[1], turn[2] = -turn[0], -turn[1], -turn[2]
    plant.mocap.attitude = relative_rotation(plant.mocap.attitude, turn)


@effect(
    "mocap_noise",
    Stage.MOCAP,
    [
        Param("position", "m", 0.0, (0.0, 0.2), "standard deviation of each axis", 0.002),
        Param("attitude", "rad", 0.0, (0.0, 0.2), "standard deviation of each axis", 0.005),
    ],
    signature="white noise on the pose",
    stochastic=True,
)
def mocap_noise(plant: Plant, noise: Array, position: float, attitude: float) -> None:
    """Add white noise to position and attitude."""
    plant.mocap.position = add_scaled(plant.mocap.position, position, noise)
    rotate_by_vector(plant.mocap.attitude, scale(attitude, noise[3:6]))


@effect(
    "mocap_latency",
    Stage.MOCAP,
    [
        Param("delay", "s", 0.0, (0.0, 0.2), "from capture to arrival", 0.03),
        Param("jitter", "s", 0.0, (0.0, 0.05), "standard deviation of the delay", 0.002),
    ],
    signature="pose trails the IMU; the stamp, being the capture time, stays right",
)
def mocap_latency(plant: Plant, noise: Array, delay: float, jitter: float) -> None:
    """Let the sample arrive later than it was captured; its stamp stays the capture time."""
    plant.mocap.latency += max(0.0, delay + jitter * noise[6])


@effect(
    "mocap_stamp_error",
    Stage.MOCAP,
    [Param("offset", "s", 0.0, (-0.1, 0.2), "stamp later than the capture", 0.02)],
    signature="pose and IMU are shifted in time against each other, the pose trailing",
    separates_from={
        "command_delay": "gyro against command: a wrong stamp leaves it alone",
        "motor_lag": "gyro against command: a wrong stamp leaves it alone",
        "mocap_marker_offset": "straight accelerations: an offset needs rotation",
    },
)
def mocap_stamp_error(plant: Plant, noise: Array, offset: float) -> None:
    """Let the stamp say a time later than the capture, as when it is taken at arrival.

    Whoever trusts the stamp takes the pose for a newer one. A stamp ahead of the clock is refused.
    """
    plant.mocap.stamp_error += offset


class DropoutState(Record):
    """What dropouts remember."""

    rest = field("s", "of the present gap")


@effect(
    "mocap_dropouts",
    Stage.MOCAP,
    [
        Param("probability", "1", 0.0, (0.0, 1.0), "chance of a sample to begin a gap", 0.01),
        Param("duration", "s", 0.0, (0.0, 5.0), "mean length of a gap", 0.1),
    ],
    signature="missing samples, singly or in gaps",
    state=DropoutState,
    stochastic=True,
    healthy_spread=0.0,
)
def mocap_dropouts(
    plant: Plant, noise: Array, state: DropoutState, probability: float, duration: float
) -> None:
    """Drop samples in gaps whose lengths are exponentially distributed."""
    state.rest = max(state.rest - plant.mocap.interval, 0.0)
    if state.rest <= 0.0 and 0.5 * math.erfc(noise[7] / math.sqrt(2.0)) < probability:
        chance = max(0.5 * math.erfc(noise[8] / math.sqrt(2.0)), 1e-9)
        state.rest = 1e-9 - duration * math.log(chance)
    if state.rest > 0.0:
        plant.mocap.dropped = True
