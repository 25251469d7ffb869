"""Decodes set points of OFFBOARD with their type masks, and external poses, as PX4 does.

What the values may be is up to the vehicle.

PX4 1.17 sends poses of a motion capture (ATT_POS_MOCAP, ODOMETRY with the type MOCAP) to a topic
that its estimator does not read. The same here: they are refused by that name.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.arrays import Array
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint, finite_or_nan
from tombo_px4.frames import (
    enu_from_ned,
    flu_from_frd,
    quaternion_of_angles,
    ros_quaternion,
    ros_yaw,
)

_NO_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_NO_THRUST = mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
_NO_ATTITUDE = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
NOT_FUSED = "is not fused: PX4 takes the estimator type VISION"
_WORLD_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
_BODY_FRAMES = (
    mavlink.MAV_FRAME_BODY_FRD,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_LOCAL_NED,
)
"""Only the velocity is given in the child frame, and it is not used."""


def decode_setpoint(message: Any) -> OffboardSetpoint | str:
    """Return the set point of a message, its values unchecked, or why it is refused.

    Args:
        message: SET_POSITION_TARGET_LOCAL_NED or SET_ATTITUDE_TARGET.
    """
    m, mask = message, message.type_mask
    if m.get_type() == "SET_ATTITUDE_TARGET":
        rates = _masked((m.body_roll_rate, m.body_pitch_rate, m.body_yaw_rate), mask)
        return OffboardSetpoint(
            attitude=None if mask & _NO_ATTITUDE else _rotation(m.q),
            rates=flu_from_frd(rates),
            thrust=math.nan if mask & _NO_THRUST else float(m.thrust),
        )
    if m.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
        return f"coordinate frame {m.coordinate_frame} unsupported"
    return OffboardSetpoint(
        enu_from_ned(_masked((m.x, m.y, m.z), mask)),
        enu_from_ned(_masked((m.vx, m.vy, m.vz), mask >> 3)),
        enu_from_ned(_masked((m.afx, m.afy, m.afz), mask >> 6)),
        ros_yaw(math.nan if mask & _NO_YAW else finite_or_nan(m.yaw)),
    )


def _masked(values: Sequence[float], mask: int) -> Array:
    """Return three axes, NaN where a bit of the mask says ignore."""
    return np.array([math.nan if mask & 1 << i else float(v) for i, v in enumerate(values)])


class VisionPose(NamedTuple):
    """A pose from outside."""

    stamp_us: int
    """As it came: in the sender's clock; 0: none was given."""
    position: Array
    """(3) of base_link in map [m]."""
    attitude: Array
    """(4) xyzw, map from base_link, as long as it came."""


def decode_vision(message: Any) -> VisionPose | str:
    """Return the pose of a message, its values unchecked, or why it is refused."""
    m, kind = message, message.get_type()
    if kind == "ODOMETRY":
        if m.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_MOCAP:
            return f"with the type MOCAP {NOT_FUSED}"
        if m.frame_id not in _WORLD_FRAMES:
            return f"frame {m.frame_id} unsupported, LOCAL_NED and LOCAL_FRD are"
        if m.child_frame_id not in _BODY_FRAMES:
            return f"child frame {m.child_frame_id} unsupported, BODY_FRD is"
        stamp_us, attitude = m.time_usec, m.q
    elif kind == "VISION_POSITION_ESTIMATE":
        stamp_us = m.usec
        attitude = quaternion_of_angles(*map(finite_or_nan, (m.roll, m.pitch, m.yaw)))
    else:
        return NOT_FUSED
    return VisionPose(stamp_us, enu_from_ned((m.x, m.y, m.z)), _rotation(attitude))


def _rotation(wxyz: Sequence[float]) -> Array:
    """Return an attitude (4) xyzw, map from base_link; NaN for one that is not finite."""
    if not all(math.isfinite(q) for q in wxyz):
        return np.full(4, math.nan)
    return ros_quaternion(wxyz)
