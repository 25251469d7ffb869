"""Our poses, set points and commands as MAVLink messages, in PX4's frames."""

from __future__ import annotations

import math
import struct
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import PositionSetpoint
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.frames import frd_from_flu, ned_from_enu, px4_quaternion, px4_yaw
from tombo_px4.link.decoded_messages import FORCE_ARMING
from tombo_px4.modes import Mode

POSITION_MASK = mav.POSITION_TARGET_TYPEMASK_YAW_RATE_IGNORE
"""Position, velocity, acceleration and yaw count; the rate of yaw doesn't."""
ATTITUDE_MASK = (
    mav.ATTITUDE_TARGET_TYPEMASK_BODY_ROLL_RATE_IGNORE
    | mav.ATTITUDE_TARGET_TYPEMASK_BODY_PITCH_RATE_IGNORE
    | mav.ATTITUDE_TARGET_TYPEMASK_BODY_YAW_RATE_IGNORE
)
RATES_MASK = mav.ATTITUDE_TARGET_TYPEMASK_ATTITUDE_IGNORE
_TRACKED = 100
"""ODOMETRY.quality of a valid pose, in percent."""
_CUSTOM_MODE = mav.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
_NAN = math.nan
_MICRO, _MILLI = 1_000, 1_000_000


class MessageTarget(NamedTuple):
    """System and component that the messages are for."""

    system: int
    component: int


def pose_message(stamp_ns: int, position: Array, attitude: Array) -> Any:
    """Return a pose of the motion capture as the ODOMETRY that PX4 fuses.

    Args:
        stamp_ns: capture, of the clock that answers TIMESYNC.
        position: (3) of base_link in map [m].
        attitude: (4) xyzw, map from base_link.
    """
    q = px4_quaternion(attitude / np.linalg.norm(attitude))  # else PX4 drops it, silently
    return mav.MAVLink_odometry_message(
        stamp_ns // _MICRO,
        mav.MAV_FRAME_LOCAL_NED,
        mav.MAV_FRAME_BODY_FRD,
        *ned_from_enu(position).tolist(),
        q.tolist(),
        *(6 * [_NAN]),
        unknown(21),
        unknown(21),
        0,
        mav.MAV_ESTIMATOR_TYPE_VISION,
        _TRACKED,
    )


def unknown(count: int) -> list[float]:
    """Return a covariance of which nothing is known: NaN in front (MAVLink common)."""
    return [_NAN] + (count - 1) * [0.0]


def position_target(setpoint: PositionSetpoint, to: MessageTarget, now_ns: int) -> Any:
    """Return a set point of position, velocity and acceleration fed forward, and yaw."""
    return mav.MAVLink_set_position_target_local_ned_message(
        _milliseconds(now_ns),
        *to,
        mav.MAV_FRAME_LOCAL_NED,
        POSITION_MASK,
        *ned_from_enu(setpoint.position).tolist(),
        *ned_from_enu(setpoint.velocity).tolist(),
        *ned_from_enu(setpoint.acceleration).tolist(),
        px4_yaw(setpoint.yaw),
        0.0,
    )


def rotation_target(wanted: Array, throttle: float, to: MessageTarget, now_ns: int) -> Any:
    """Return a set point of throttle 0..1 and attitude, or body rates.

    Args:
        wanted: (4) xyzw, map from base_link, or (3) [rad/s], base_link.
        throttle: share of the highest thrust.
        to: who follows it.
        now_ns: the present.
    """
    mask, q, rates = RATES_MASK, [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    if wanted.shape == (4,):
        mask, q = ATTITUDE_MASK, px4_quaternion(wanted).tolist()
    else:
        rates = frd_from_flu(wanted).tolist()
    return mav.MAVLink_set_attitude_target_message(
        _milliseconds(now_ns), *to, mask, q, *rates, throttle
    )


def throttle_of(thrust: float, mass: float, hover_thrust: float) -> float:
    """Return the throttle 0..1 for a thrust [N]: `hover_thrust` carries the weight of `mass`."""
    return min(max(thrust / (mass * GRAVITY) * hover_thrust, 0.0), 1.0)


def heartbeat() -> Any:
    """Return our HEARTBEAT, that of a ground station: PX4 sends its texts to those alone."""
    content = (mav.MAV_TYPE_GCS, mav.MAV_AUTOPILOT_INVALID, 0, 0, mav.MAV_STATE_ACTIVE, 3)
    return mav.MAVLink_heartbeat_message(*content)


def timesync(times: tuple[int, int]) -> Any:
    """Return TIMESYNC with (tc1, ts1)."""
    return mav.MAVLink_timesync_message(*times)


def command(to: MessageTarget, number: int, *values: float) -> Any:
    """Return COMMAND_LONG with up to seven values, the rest 0."""
    padded = [*values, *((7 - len(values)) * [0.0])]
    return mav.MAVLink_command_long_message(*to, number, 0, *padded)


def set_mode(to: MessageTarget, mode: Mode) -> Any:
    """Ask for a mode. Acknowledged twice; only HEARTBEAT confirms it."""
    values = (float(_CUSTOM_MODE), float(mode.main), float(mode.sub))
    return command(to, mav.MAV_CMD_DO_SET_MODE, *values)


def arm(to: MessageTarget, armed: bool, force: bool = False) -> Any:
    """Ask to arm or disarm; by force only where asked for: that disarms in the air, too."""
    return command(
        to, mav.MAV_CMD_COMPONENT_ARM_DISARM, float(armed), FORCE_ARMING if force else 0.0
    )


def message_interval(to: MessageTarget, number: int, rate_hz: float) -> Any:
    """Ask for a message at a rate."""
    values = (float(number), round(1e6 / rate_hz))
    return command(to, mav.MAV_CMD_SET_MESSAGE_INTERVAL, *values)


def request_message(to: MessageTarget, number: int) -> Any:
    """Ask for a message once."""
    return command(to, mav.MAV_CMD_REQUEST_MESSAGE, float(number))


def run_checks(to: MessageTarget) -> Any:
    """Ask for all failed checks of arming, as texts."""
    return command(to, mav.MAV_CMD_RUN_PREARM_CHECKS)


def read_parameter(to: MessageTarget, name: str) -> Any:
    """Ask for a parameter by name."""
    return mav.MAVLink_param_request_read_message(*to, name.encode(), -1)


def float_of_int(value: int) -> float:
    """Return the float that has the bytes of an int32: PX4 takes whole numbers by their bytes."""
    number: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return number


def _milliseconds(now_ns: int) -> int:
    """Return our time in the 32 bits of time_boot_ms; PX4 does not read it."""
    return now_ns // _MILLI % 2**32
