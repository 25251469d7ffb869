"""What leaves for PX4: axes, masks, stamps and what is left unknown."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.messages import PositionSetpoint
from tombo_px4.link import message_encoder
from tombo_px4.link.message_encoder import MessageTarget

TO = MessageTarget(1, 1)
STAMP = 1_763_700_000_123_456_789
NOSE_NORTH = np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])  # yaw 90 deg from east


def sent(message):
    """The message as the other side reads it."""
    out, back = mav.MAVLink(None, 245, 191), mav.MAVLink(None)
    return back.parse_buffer(message.pack(out))[0]


@pytest.mark.parametrize("kind", ["odometry", "vision", "mocap"])
def test_a_pose_goes_north_east_down_with_its_own_stamp(kind):
    place = np.array([1.0, 2.0, 3.0])  # east, north, up
    m = sent(message_encoder.pose_message(kind, STAMP, place, NOSE_NORTH, None))
    assert (m.x, m.y, m.z) == pytest.approx((2.0, 1.0, -3.0))
    assert getattr(m, "usec" if kind == "vision" else "time_usec") == STAMP // 1000
    covariance = m.pose_covariance if kind == "odometry" else m.covariance
    assert math.isnan(covariance[0])
    if kind == "vision":
        assert (m.roll, m.pitch, m.yaw) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    else:
        assert m.q == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)


def test_odometry_is_of_the_kind_that_is_fused():
    m = sent(message_encoder.pose_message("odometry", STAMP, np.zeros(3), NOSE_NORTH, None))
    assert m.frame_id == mav.MAV_FRAME_LOCAL_NED
    assert m.child_frame_id == mav.MAV_FRAME_BODY_FRD
    assert m.estimator_type == mav.MAV_ESTIMATOR_TYPE_VISION
    unknown = (m.vx, m.vy, m.vz, m.rollspeed, m.pitchspeed, m.yawspeed, m.velocity_covariance[0])
    assert all(math.isnan(v) for v in unknown)
    assert m.quality > 0


@given(st.floats(-3.1, 3.1), st.floats(-1.4, 1.4), st.floats(-3.1, 3.1))
def test_vision_angles_are_those_of_the_quaternion(yaw, pitch, roll):
    cy, sy, cp, sp = math.cos(yaw / 2), math.sin(yaw / 2), math.cos(pitch / 2), math.sin(pitch / 2)
    cr, sr = math.cos(roll / 2), math.sin(roll / 2)
    q = np.array(
        [
            sr * cp * cy - cr * sp * sy,
            cr * sp * cy + sr * cp * sy,
            cr * cp * sy - sr * sp * cy,
            cr * cp * cy + sr * sp * sy,
        ]
    )
    m = message_encoder.pose_message("vision", STAMP, np.zeros(3), q, None)
    assert m.roll == pytest.approx(roll, abs=1e-9)
    assert m.pitch == pytest.approx(-pitch, abs=1e-9)
    assert math.remainder(m.yaw - (math.pi / 2 - yaw), 2 * math.pi) == pytest.approx(0, abs=1e-9)


def test_a_position_set_point_carries_all_but_the_rate_of_yaw():
    place, speed, push = np.array([1.0, 2, 3]), np.array([4.0, 5, 6]), np.array([7.0, 8, 9])
    m = sent(
        message_encoder.position_target(PositionSetpoint(0, place, speed, push, 0.3, 2), TO, STAMP)
    )
    assert m.type_mask == 0b100000000000
    assert m.coordinate_frame == mav.MAV_FRAME_LOCAL_NED
    assert (m.x, m.y, m.z, m.vx, m.vy, m.vz) == pytest.approx((2, 1, -3, 5, 4, -6))
    assert (m.afx, m.afy, m.afz) == pytest.approx((8, 7, -9))
    assert m.yaw == pytest.approx(math.pi / 2 - 0.3)
    assert (m.target_system, m.target_component) == (1, 1)


def test_attitude_and_rates_have_the_masks_px4_takes():
    m = sent(message_encoder.rotation_target(NOSE_NORTH, 0.6, TO, STAMP))
    assert (m.type_mask, m.thrust) == (0b00000111, pytest.approx(0.6))
    assert m.q == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)
    m = sent(message_encoder.rotation_target(np.array([0.1, 0.2, 0.3]), 0.6, TO, STAMP))
    assert m.type_mask == 0b10000000
    rates = (m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate)
    assert rates == pytest.approx((0.1, -0.2, -0.3))


def test_thrust_is_measured_in_weights():
    weight = 1.3 * 9.80665
    assert message_encoder.throttle_of(weight, 1.3, 0.47) == pytest.approx(0.47)
    assert message_encoder.throttle_of(10 * weight, 1.3, 0.47) == 1.0
    assert message_encoder.throttle_of(-1.0, 1.3, 0.47) == 0.0
