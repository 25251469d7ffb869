"""Decodes external poses: VISION_POSITION_ESTIMATE, ODOMETRY, ATT_POS_MOCAP.

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
from tombo_px4.frames import enu_from_ned, quaternion_of_angles, ros_quaternion

NOT_FUSED = "is not fused: PX4 takes the estimator type VISION"
_FARTHEST_M = 1e5
_WORLD_FRAMES = (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_LOCAL_FRD)
_BODY_FRAMES = (
    mavlink.MAV_FRAME_BODY_FRD,
    mavlink.MAV_FRAME_BODY_NED,
    mavlink.MAV_FRAME_LOCAL_NED,
)
"""Only the velocity is given in the child frame, and it is not used."""
_TYPES = (
    mavlink.MAV_ESTIMATOR_TYPE_UNKNOWN,
    mavlink.MAV_ESTIMATOR_TYPE_NAIVE,
    mavlink.MAV_ESTIMATOR_TYPE_VISION,
    mavlink.MAV_ESTIMATOR_TYPE_VIO,
)


class VisionPose(NamedTuple):
    """A pose from outside."""

    stamp_us: int
    """As it came: in the sender's clock; 0: none was given."""
    position: Array
    """(3) of base_link in map [m]."""
    attitude: Array
    """(4) xyzw, map from base_link, as long as it came."""


def decode_vision(message: Any) -> VisionPose | str:
    """Return the pose of a message, or why it is refused."""
    kind = message.get_type()
    if kind == "ODOMETRY":
        return _odometry(message)
    if kind == "VISION_POSITION_ESTIMATE":
        position = (message.x, message.y, message.z)
        angles = (message.roll, message.pitch, message.yaw)
        q = quaternion_of_angles(*angles) if _finite(angles) else angles
        return _pose(message.usec, position, q)
    return NOT_FUSED


def _odometry(message: Any) -> VisionPose | str:
    if message.estimator_type == mavlink.MAV_ESTIMATOR_TYPE_MOCAP:
        return f"with the type MOCAP {NOT_FUSED}"
    if message.estimator_type not in _TYPES:
        return f"estimator type {message.estimator_type} unsupported"
    if message.frame_id not in _WORLD_FRAMES:
        return f"frame {message.frame_id} unsupported, LOCAL_NED and LOCAL_FRD are"
    if message.child_frame_id not in _BODY_FRAMES:
        return f"child frame {message.child_frame_id} unsupported, BODY_FRD is"
    return _pose(message.time_usec, (message.x, message.y, message.z), message.q)


def _pose(stamp_us: int, position: Sequence[float], attitude: Sequence[float]) -> VisionPose | str:
    if not _finite(attitude):
        return "attitude is not finite"
    if not _finite(position):
        return "position is not finite"
    if max(abs(p) for p in position) > _FARTHEST_M:
        return "position is out of range"
    quaternion = np.array(attitude, dtype=float)
    return VisionPose(stamp_us, enu_from_ned(position), ros_quaternion(quaternion))


def _finite(values: Sequence[float]) -> bool:
    return all(math.isfinite(v) for v in values)
