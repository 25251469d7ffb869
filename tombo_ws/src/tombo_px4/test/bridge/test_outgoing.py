"""What leaves for PX4: axes, masks, stamps and unknown fields."""

import math

import numpy as np
import pytest
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.messages import PositionSetpoint
from tombo_px4.link import messages
from tombo_px4.link.messages import MessageTarget

TO = MessageTarget(1, 1)
STAMP = 1_763_700_000_123_456_789
NOSE_NORTH = np.array([0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)])  # yaw 90 deg from east


def sent(message):
    """The message as the other side reads it."""
    out, back = mav.MAVLink(None, 245, 191), mav.MAVLink(None)
    return back.parse_buffer(message.pack(out))[0]


def test_a_pose_goes_north_east_down_with_its_own_stamp_as_the_odometry_that_is_fused():
    place = np.array([1.0, 2.0, 3.0])  # east, north, up
    m = sent(messages.pose_message(STAMP, place, NOSE_NORTH))
    assert (m.x, m.y, m.z) == pytest.approx((2.0, 1.0, -3.0))
    assert m.q == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)
    assert m.time_usec == STAMP // 1000
    assert m.frame_id == mav.MAV_FRAME_LOCAL_NED
    assert m.child_frame_id == mav.MAV_FRAME_BODY_FRD
    assert m.estimator_type == mav.MAV_ESTIMATOR_TYPE_VISION
    covariances = (m.pose_covariance[0], m.velocity_covariance[0])
    unknown = (m.vx, m.vy, m.vz, m.rollspeed, m.pitchspeed, m.yawspeed, *covariances)
    assert all(math.isnan(v) for v in unknown)
    assert m.quality > 0


def test_a_position_set_point_carries_all_but_the_rate_of_yaw():
    place, speed, push = np.array([1.0, 2, 3]), np.array([4.0, 5, 6]), np.array([7.0, 8, 9])
    m = sent(messages.position_target(PositionSetpoint(0, place, speed, push, 0.3, 2), TO, STAMP))
    assert m.type_mask == 0b100000000000
    assert m.coordinate_frame == mav.MAV_FRAME_LOCAL_NED
    assert (m.x, m.y, m.z, m.vx, m.vy, m.vz) == pytest.approx((2, 1, -3, 5, 4, -6))
    assert (m.afx, m.afy, m.afz) == pytest.approx((8, 7, -9))
    assert m.yaw == pytest.approx(math.pi / 2 - 0.3)
    assert (m.target_system, m.target_component) == (1, 1)


def test_an_attitude_has_the_mask_that_px4_takes():
    m = sent(messages.attitude_target(NOSE_NORTH, 0.6, TO, STAMP))
    assert (m.type_mask, m.thrust) == (0b00000111, pytest.approx(0.6))
    assert m.q == pytest.approx([1.0, 0.0, 0.0, 0.0], abs=1e-6)
