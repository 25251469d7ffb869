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

_POSITION, _VELOCITY, _ACCELERATION = 0, 3, 6
"""First bit of each in the type mask of a position target: 1 means ignore."""
_NO_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_NO_THRUST = mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
_NO_ATTITUDE = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE


def decode_setpoint(message: Any) -> OffboardSetpoint | str:
    """Return the set point of a message, its values unchecked, or why it is refused.

    Args:
        message: SET_POSITION_TARGET_LOCAL_NED or SET_ATTITUDE_TARGET.
    """
    if message.get_type() == "SET_ATTITUDE_TARGET":
        return _attitude(message)
    frame, mask = message.coordinate_frame, message.type_mask
    if frame != mavlink.MAV_FRAME_LOCAL_NED:
        return f"coordinate frame {frame} unsupported"
    return OffboardSetpoint(
        position=enu_from_ned(_masked((message.x, message.y, message.z), mask, _POSITION)),
        velocity=enu_from_ned(_masked((message.vx, message.vy, message.vz), mask, _VELOCITY)),
        acceleration=enu_from_ned(
            _masked((message.afx, message.afy, message.afz), mask, _ACCELERATION)
        ),
        yaw=ros_yaw(math.nan if mask & _NO_YAW else finite_or_nan(message.yaw)),
    )


def _masked(values: Sequence[float], mask: int, bit: int) -> Array:
    """Return three axes, NaN where the mask says ignore."""
    ignored = mask >> bit
    return np.array([math.nan if ignored & 1 << i else float(v) for i, v in enumerate(values)])


def _attitude(message: Any) -> OffboardSetpoint:
    mask = message.type_mask
    turning = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    return OffboardSetpoint(
        attitude=None if mask & _NO_ATTITUDE else _rotation(message.q),
        rates=flu_from_frd(_masked(turning, mask, 0)),
        thrust=None if mask & _NO_THRUST else float(message.thrust),
    )


NOT_FUSED = "is not fused: PX4 takes the estimator type VISION"
_WORLD_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
_BODY_FRAMES = (
    mavlink.MAV_FRAME_BODY_FRD,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_LOCAL_NED,
)
"""Only the velocity is given in the child frame, and it is not used."""


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
    kind = message.get_type()
    if kind == "ODOMETRY":
        refusal = _refuse_odometry(message)
        stamp_us, attitude = message.time_usec, message.q
    elif kind == "VISION_POSITION_ESTIMATE":
        refusal, stamp_us = "", message.usec
        angles = (message.roll, message.pitch, message.yaw)
        attitude = quaternion_of_angles(*map(finite_or_nan, angles))
    else:
        return NOT_FUSED
    position = enu_from_ned((message.x, message.y, message.z))
    return refusal or VisionPose(stamp_us, position, _rotation(attitude))


def _refuse_odometry(message: Any) -> str:
    """Return why PX4 does not fuse an ODOMETRY; "" if it does."""
    if message.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_MOCAP:
        return f"with the type MOCAP {NOT_FUSED}"
    if message.frame_id not in _WORLD_FRAMES:
        return f"frame {message.frame_id} unsupported, LOCAL_NED and LOCAL_FRD are"
    if message.child_frame_id not in _BODY_FRAMES:
        return f"child frame {message.child_frame_id} unsupported, BODY_FRD is"
    return ""


def _rotation(wxyz: Sequence[float]) -> Array:
    """Return an attitude (4) xyzw, map from base_link; NaN for one that is not finite."""
    if not all(math.isfinite(q) for q in wxyz):
        return np.full(4, math.nan)
    return ros_quaternion(wxyz)
