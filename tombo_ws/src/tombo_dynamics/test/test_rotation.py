"""Quaternions against the algebra that they must obey, and against SciPy's rotations."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tombo_dynamics.rotation import (
    quaternion_multiply,
    relative_rotation,
    rotate_by_vector,
    rotation_matrix,
    tilt,
    yaw_pitch_roll,
)

component = st.floats(-1.0, 1.0, allow_subnormal=False)
number = st.floats(-4.0, 4.0, allow_subnormal=False)
vectors = st.tuples(number, number, number).map(np.array)


@st.composite
def quaternions(draw):
    q = np.array([draw(component) for _ in range(4)])
    assume(np.linalg.norm(q) > 0.1)
    return q / np.linalg.norm(q)


def matrix(q):
    out = np.zeros((3, 3))
    rotation_matrix(q, out)
    return out


def rotate(q, v):
    q = q.copy()
    rotate_by_vector(q, v)
    return q


@given(quaternions(), quaternions())
def test_product_of_quaternions_is_product_of_matrices(a, b):
    assert matrix(quaternion_multiply(a, b)) == pytest.approx(matrix(a) @ matrix(b), abs=1e-14)


@given(quaternions())
def test_matrix_is_a_proper_rotation_and_scipys(q):
    r = matrix(q)
    assert r @ r.T == pytest.approx(np.eye(3), abs=1e-14)
    assert np.linalg.det(r) == pytest.approx(1.0, abs=1e-14)
    assert r == pytest.approx(Rotation.from_quat(q).as_matrix(), abs=1e-14)
    assert r == pytest.approx(matrix(-q), abs=0.0)


@given(quaternions(), vectors, st.floats(-9.0, 0.0))
def test_rotation_by_a_vector_is_the_exponential_in_the_body_frame(q, v, exponent):
    v = v * 10.0**exponent
    after = Rotation.from_quat(rotate(q, v))
    expected = Rotation.from_quat(q) * Rotation.from_rotvec(v)
    assert (expected.inv() * after).magnitude() < 1e-14 + 1e-14 * np.linalg.norm(v)
    assert np.linalg.norm(rotate(q, v)) == pytest.approx(1.0, abs=1e-15)


@pytest.mark.parametrize("angle", [0.0099, 0.00999999, 0.01, 0.0100001, 0.0101])
def test_series_and_closed_form_agree_where_they_meet(angle):
    q = rotate(np.array([0.0, 0.0, 0.0, 1.0]), (0.0, angle, 0.0))
    assert 2.0 * math.asin(q[1]) == pytest.approx(angle, abs=1e-15)


@given(quaternions(), quaternions())
def test_relative_rotation_leads_to_the_reference_the_short_way(q, reference):
    step = np.array(relative_rotation(reference, q))
    assert matrix(quaternion_multiply(q, step)) == pytest.approx(matrix(reference), abs=1e-14)
    assert step[3] >= 0.0
    assert np.array(relative_rotation(-reference, q)) == pytest.approx(step, abs=1e-14)


@given(
    st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1),
)  # fmt: skip
def test_angles_build_the_quaternion_they_were_read_from(yaw, pitch, roll):
    q = Rotation.from_euler("ZYX", [yaw, pitch, roll]).as_quat()
    assert yaw_pitch_roll(q) == pytest.approx([yaw, pitch, roll], abs=1e-7)
    upright = math.cos(pitch) * math.cos(roll)
    assert math.cos(tilt(q)) == pytest.approx(upright, abs=1e-12)
