"""PX4's frames: physics that must be the same whichever way it is written."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tombo_dynamics.rotation import rotate_vector
from tombo_dynamics.vehicle import ARM_X, ARM_Y, SPIN
from tombo_px4.frames import (
    PX4_ROTORS,
    GeoOrigin,
    frd_from_flu,
    ned_from_enu,
    px4_quaternion,
    px4_yaw,
    ros_pose_covariance,
    ros_quaternion,
    ros_yaw,
)

EAST, NORTH, UP = np.eye(3)
FORWARD, LEFT, TOP = np.eye(3)

vectors = arrays(np.float64, 3, elements=st.floats(-1e3, 1e3))
rotations = (
    arrays(np.float64, 4, elements=st.floats(-1.0, 1.0))
    .filter(lambda q: np.linalg.norm(q) > 0.1)
    .map(lambda q: q / np.linalg.norm(q))
)
angles = st.floats(-math.pi, math.pi)


def matrix(q_wxyz: np.ndarray) -> np.ndarray:
    """NED from FRD, written out as in PX4's matrix library."""
    w, x, y, z = q_wxyz
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (w * y + x * z)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (w * x + y * z), w * w - x * x - y * y + z * z],
        ]
    )


@pytest.mark.slow
@given(rotations, vectors)
def test_a_body_vector_points_to_the_same_place_on_both_sides(attitude, body):
    ours = rotate_vector(attitude, body)
    theirs = matrix(px4_quaternion(attitude)) @ frd_from_flu(body)
    assert np.allclose(theirs, ned_from_enu(ours), atol=1e-9 * (1.0 + np.abs(body).max()))


@pytest.mark.slow
@given(rotations)
def test_an_attitude_comes_back_as_the_same_rotation(attitude):
    back = ros_quaternion(px4_quaternion(attitude))
    assert abs(abs(float(back @ attitude)) - 1.0) < 1e-12
    assert back[3] >= 0.0
    assert px4_quaternion(attitude)[0] >= 0.0


@given(angles)
def test_yaw_is_the_heading_of_the_attitude(yaw):
    attitude = np.array([0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)])
    r = matrix(px4_quaternion(attitude))
    heading = math.atan2(r[1, 0], r[0, 0])
    assert math.remainder(heading - px4_yaw(yaw), 2 * math.pi) == pytest.approx(0.0, abs=1e-9)
    assert math.remainder(ros_yaw(px4_yaw(yaw)) - yaw, 2 * math.pi) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.slow
@given(arrays(np.float64, (6, 6), elements=st.floats(-2.0, 2.0)), vectors, vectors)
def test_a_covariance_says_the_same_of_every_direction(root, along, about):
    full = root @ root.T
    covariance = ros_pose_covariance(full[np.triu_indices(6)])
    ours = np.concatenate([along, about])
    theirs = np.concatenate([ned_from_enu(along), ned_from_enu(about)])
    scale = 1.0 + float(ours @ ours)
    assert theirs @ full @ theirs == pytest.approx(ours @ covariance @ ours, abs=1e-9 * scale)


def test_rotors_sit_and_turn_as_px4_numbers_them():
    """PX4's quad-x: 1 front right, 2 rear left (counter-clockwise); 3 front left, 4 rear right."""
    front = [ARM_X[i] > 0 for i in PX4_ROTORS]
    left = [ARM_Y[i] > 0 for i in PX4_ROTORS]
    counter_clockwise = [SPIN[i] > 0 for i in PX4_ROTORS]
    assert front == [True, False, True, False]
    assert left == [False, True, True, False]
    assert counter_clockwise == [True, True, False, False]


@given(vectors, st.floats(-60.0, 60.0), st.floats(-180.0, 180.0))
def test_a_place_on_the_globe_comes_back(position, latitude, longitude):
    origin = GeoOrigin(latitude, longitude, 488.0)
    assert np.allclose(origin.local_of(*origin.global_of(position)), position, atol=1e-5)
