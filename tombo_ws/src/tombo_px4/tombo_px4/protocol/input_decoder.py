"""Decodes set points of OFFBOARD with their type masks, and external poses, as PX4 does.

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
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.frames import (
    GeoOrigin,
    enu_from_ned,
    flu_from_frd,
    px4_yaw_rate,
    quaternion_of_angles,
    ros_quaternion,
    ros_yaw,
)

_POSITION, _VELOCITY, _ACCELERATION = 0, 3, 6
"""First bit of each in the type mask of a position target: 1 means ignore."""
_FORCE = mavlink.POSITION_TARGET_TYPEMASK_FORCE_SET
_NO_YAW = mavlink.POSITION_TARGET_TYPEMASK_YAW_IGNORE
_NO_YAW_RATE = mavlink.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
_NO_THRUST = mavlink.ATTITUDE_TARGET_TYPEMASK_THROTTLE_IGNORE
_NO_ATTITUDE = mavlink.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_FARTHEST_M = 1e5
_FASTEST = 1e3
"""Bound of velocities [m/s], accelerations [m/s^2], yaw [rad] and rates [rad/s];
larger values are errors."""
_GLOBAL_FRAMES = {
    mavlink.MAV_FRAME_GLOBAL: False,
    mavlink.MAV_FRAME_GLOBAL_INT: False,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT: True,
    mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT: True,
}
"""Whether the altitude of a frame counts from home."""


def decode_setpoint(
    message: Any, origin: GeoOrigin, home: Array, stamp_us: int
) -> OffboardSetpoint | str:
    """Return the set point of a message, or why it is refused.

    Args:
        message: SET_POSITION_TARGET_LOCAL_NED, SET_POSITION_TARGET_GLOBAL_INT or
            SET_ATTITUDE_TARGET.
        origin: where map is on the globe.
        home: (3) home position in map [m].
        stamp_us: arrival, since boot.
    """
    kind = message.get_type()
    if kind == "SET_ATTITUDE_TARGET":
        return _attitude(message, stamp_us)
    body = False
    if kind == "SET_POSITION_TARGET_LOCAL_NED":
        body = message.coordinate_frame == mavlink.MAV_FRAME_BODY_NED
        if not body and message.coordinate_frame != mavlink.MAV_FRAME_LOCAL_NED:
            return f"coordinate frame {message.coordinate_frame} unsupported"
        place = _masked((message.x, message.y, message.z), message.type_mask, _POSITION)
        position = None if place is None else enu_from_ned(place)
    else:
        relative = _GLOBAL_FRAMES.get(message.coordinate_frame)
        if relative is None:
            return f"coordinate frame {message.coordinate_frame} unsupported"
        position = _global(message, origin, float(home[2]) if relative else None)
    velocity = _masked((message.vx, message.vy, message.vz), message.type_mask, _VELOCITY)
    push = _masked((message.afx, message.afy, message.afz), message.type_mask, _ACCELERATION)
    if push is not None and message.type_mask & _FORCE:
        return "force not supported"
    if position is None and velocity is None and push is None:
        return "invalid: nothing is commanded"
    yaw = math.nan if message.type_mask & _NO_YAW else message.yaw
    yaw_rate = math.nan if message.type_mask & _NO_YAW_RATE else message.yaw_rate
    wrong = _out_of_range(position, velocity, push, (yaw, yaw_rate))
    if wrong:
        return wrong
    if body and velocity is None and push is None:
        return "invalid: position in a body frame"
    turned = flu_from_frd if body else enu_from_ned
    return OffboardSetpoint(
        position=None if body else position,
        velocity=None if velocity is None else turned(velocity),
        acceleration=None if push is None else turned(push),
        yaw=math.nan if math.isnan(yaw) else ros_yaw(yaw),
        yaw_rate=px4_yaw_rate(yaw_rate),
        stamp_us=stamp_us,
        frame="body" if body else "map",
    )


def _masked(values: Sequence[float], mask: int, bit: int) -> Array | None:
    """Return three axes, NaN where the mask says ignore; None: there is nothing left."""
    ignored = mask >> bit
    axes = np.array([math.nan if ignored & 1 << i else float(v) for i, v in enumerate(values)])
    return None if np.isnan(axes).all() else axes


def _global(message: Any, origin: GeoOrigin, home_height: float | None) -> Array | None:
    asked = _masked((0.0, 0.0, message.alt), message.type_mask, _POSITION)
    if asked is None:
        return None
    latitude, longitude = 1e-7 * message.lat_int, 1e-7 * message.lon_int
    north, east, _ = (math.isfinite(v) for v in asked)
    place = origin.local_of(latitude, longitude, origin.altitude_m)
    height = message.alt - origin.altitude_m if home_height is None else message.alt + home_height
    return np.array(
        [
            place[0] if east else math.nan,
            place[1] if north else math.nan,
            height if math.isfinite(asked[2]) else math.nan,
        ]
    )


def _out_of_range(
    position: Array | None,
    velocity: Array | None,
    acceleration: Array | None,
    yaw: Sequence[float],
) -> str:
    """Return the name of a value out of range; NaN means not commanded and is accepted."""
    for name, values, bound in (
        ("position", position, _FARTHEST_M),
        ("velocity", velocity, _FASTEST),
        ("acceleration", acceleration, _FASTEST),
        ("yaw", yaw, _FASTEST),
    ):
        if values is not None and any(abs(v) > bound for v in values):
            return f"{name} is out of range"
    return ""


def _attitude(message: Any, stamp_us: int) -> OffboardSetpoint | str:
    mask = message.type_mask
    turning = (message.body_roll_rate, message.body_pitch_rate, message.body_yaw_rate)
    rates = _masked(turning, mask, 0)
    if rates is not None and any(abs(r) > _FASTEST for r in rates):
        return "rates are out of range"
    attitude = None
    if not mask & _NO_ATTITUDE:
        if not all(math.isfinite(q) for q in message.q):
            return "attitude is not finite"
        length = math.sqrt(sum(q * q for q in message.q))
        if not 0.9 < length < 1.1:
            return "attitude is no unit quaternion"
        attitude = ros_quaternion(np.array(message.q) / length)
    elif rates is None:
        return "invalid: nothing is commanded"
    if mask & _NO_THRUST:
        return "invalid: no thrust"
    if not math.isfinite(message.thrust) or not -1.0 <= message.thrust <= 1.0:
        return "thrust is out of range"
    return OffboardSetpoint(
        attitude=attitude,
        rates=None if rates is None else flu_from_frd(rates),
        thrust=float(message.thrust),
        stamp_us=stamp_us,
    )


NOT_FUSED = "is not fused: PX4 takes the estimator type VISION"
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
