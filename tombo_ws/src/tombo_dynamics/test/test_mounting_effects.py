"""Sensors that sit or point elsewhere than is believed: lever arms, frames, scales, stamps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from one_vehicle import QUIET, Vehicle, as_rotation, measured_pose, random_attitude
from scipy.spatial.transform import Rotation

from tombo_dynamics.effects.compose import apply_imu
from tombo_dynamics.vehicle import GRAVITY

TURN = {"yaw": 0.4, "roll": -0.1, "pitch": 0.2}
SEEDS = st.integers(0, 1000)


def read_imu(v):
    """Return the reading in the tick that has begun."""
    v.plant.gyro, v.plant.accel = v.rates, v.plant.force / v.mass
    apply_imu(v.plant, QUIET, v.theta)
    return v.imu


# --- the accelerometer ----------------------------------------------------------------------

ARM = {"x": 0.1, "y": -0.05, "z": 0.07}


def test_imu_off_centre_measures_the_acceleration_of_its_place():
    """The second difference of the path of that place, less gravity, in body axes."""
    v = Vehicle(
        {"imu_lever_arm": ARM}, rates=(2.0, -3.0, 1.0), velocity=(1.0, 0.0, 0.0), speed=450.0
    )
    places, readings, turns = [], [], []
    for _ in range(40):
        v.plant.rotor_command = (500.0, 450.0, 380.0, 460.0)
        v.begin()
        places.append(v.position + v.rotation.apply(list(ARM.values())))
        turns.append(v.rotation)
        readings.append(read_imu(v)[3:])
        v.finish()
    path = np.array(places)
    acceleration = (path[2:] - 2.0 * path[1:-1] + path[:-2]) / v.tick**2
    felt = [
        turn.inv().apply(a + np.array([0.0, 0.0, GRAVITY]))
        for turn, a in zip(turns[1:-1], acceleration, strict=True)
    ]
    assert np.array(readings[1:-1]) == pytest.approx(np.array(felt), abs=2e-2)
    assert np.abs(readings[1] - v.plant.force / v.mass).max() > 0.5


def test_scale_multiplies_the_force_and_not_the_bias():
    effects = {
        "accel_scale": {"x": 0.1, "y": -0.2, "z": 0.05},
        "imu_bias": {"gyro_x": 0.01, "accel_x": 1.0, "accel_y": 2.0, "accel_z": 3.0},
    }
    v = Vehicle(effects)
    v.imu = [0.0, 0.2, 0.3, 10.0, 20.0, 30.0]
    apply_imu(v.plant, QUIET, v.theta)
    assert v.imu == pytest.approx([0.01, 0.2, 0.3, 12.0, 18.0, 34.5])


@given(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.5, 0.5))
def test_misaligned_imu_reads_the_same_vectors_in_its_axes(roll, pitch, yaw):
    v = Vehicle({"imu_misalignment": {"roll": roll, "pitch": pitch, "yaw": yaw}})
    rates, force = [0.4, -1.2, 2.0], [1.0, -3.0, 12.0]
    v.imu = [*rates, *force]
    apply_imu(v.plant, QUIET, v.theta)
    axes = as_rotation(yaw, roll, pitch).as_matrix()  # columns: the IMU's axes in base_link
    assert v.imu == pytest.approx([*(axes.T @ rates), *(axes.T @ force)], abs=1e-12)


# --- the rigid body of the motion capture ---------------------------------------------------


@given(SEEDS)
def test_the_marker_offset_turns_with_the_true_attitude_and_the_world(seed):
    rng = np.random.default_rng(seed)
    position, attitude = rng.normal(0.0, 3.0, 3), random_attitude(rng)
    seen = measured_pose(
        {
            "mocap_marker_offset": ARM,
            "mocap_body_misalignment": TURN,
            "mocap_misalignment": {"yaw": 1.0, "pitch": -0.1},
        },
        position,
        attitude,
    )
    world = as_rotation(1.0, 0.0, -0.1)
    point = position + Rotation.from_quat(attitude).apply(list(ARM.values()))
    assert seen.position == pytest.approx(world.apply(point), abs=1e-12)
    whole = world * Rotation.from_quat(attitude) * as_rotation(**TURN)
    assert (Rotation.from_quat(seen.attitude).inv() * whole).magnitude() < 1e-7


# --- the stamp ------------------------------------------------------------------------------


@pytest.mark.parametrize("offset", [-0.1, 0.02])
def test_a_wrong_stamp_changes_neither_pose_nor_arrival(offset):
    late = {"mocap_latency": {"delay": 0.03}}
    right = measured_pose(late, (1.0, 2.0, 3.0))
    wrong = measured_pose(late | {"mocap_stamp_error": {"offset": offset}}, (1.0, 2.0, 3.0))
    assert wrong.stamp_error - right.stamp_error == pytest.approx(offset)
    wrong.stamp_error = right.stamp_error
    assert wrong == right
