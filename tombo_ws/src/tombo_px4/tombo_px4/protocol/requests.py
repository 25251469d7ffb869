"""What clients ask for: commands, parameters, set points and external poses, as PX4 takes them.

Whole parameters travel as the bytes of a float. PX4 1.17 sends poses of a motion capture
(ATT_POS_MOCAP, ODOMETRY with the type MOCAP) to a topic that its estimator does not read. The
same here: they are refused by that name.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.arrays import Array
from tombo_px4 import modes
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint, finite_or_nan
from tombo_px4.frames import (
    PX4_ROTORS,
    GeoOrigin,
    enu_from_ned,
    quaternion_of_angles,
    ros_quaternion,
    ros_yaw,
)
from tombo_px4.modes import FORCE_ARMING, Mode, Result

if TYPE_CHECKING:
    from tombo_px4.autopilot.parameters import ParameterTable
    from tombo_px4.autopilot.vehicle import Px4Vehicle

_GLOBAL_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_NO_PLACE = 0x7FFFFFFF
"""Latitude or longitude of COMMAND_INT that says: not given."""
_MAIN_MODES = {mode.main for mode in modes.MODE_NAMES}
_LARGEST_ID = 0xFFFFFF
"""Largest number that is accepted as whole: a float holds all up to it exactly."""
_LONGEST_TEST_S = 3.0
"""PX4 turns a motor no longer."""


class ReceivedCommand(NamedTuple):
    """A command, whichever of the two messages carried it."""

    number: int
    params: tuple[float, ...]
    """Seven; 5 and 6 are degrees where they are a place."""
    frame: int = mavlink.MAV_FRAME_GLOBAL


def command_of(message: Any) -> ReceivedCommand:
    """Return the command in a COMMAND_LONG or COMMAND_INT."""
    first = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_LONG":
        last = (message.param5, message.param6, message.param7)
        return ReceivedCommand(message.command, (*first, *last))
    x, y = (math.nan if v == _NO_PLACE else 1e-7 * v for v in (message.x, message.y))
    return ReceivedCommand(message.command, (*first, x, y, message.z), message.frame)


def whole(value: float) -> int | None:
    """Return a parameter as a whole number; None if it is not finite or out of range."""
    if not math.isfinite(value) or abs(value) > _LARGEST_ID:
        return None
    return round(value)


class CommandServer:
    """Carries out the commands that move the vehicle, of all links."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        self._vehicle = vehicle
        self._origin = origin
        self._table: dict[int, Callable[[ReceivedCommand], Result]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mavlink.MAV_CMD_NAV_LAND: lambda _: vehicle.set_mode(
                modes.AUTO_LAND, "Landing at current position"
            ),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: vehicle.set_mode(
                modes.AUTO_RTL, "Returning to launch"
            ),
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_ACTUATOR_TEST: self._test_motor,
            mavlink.MAV_CMD_INJECT_FAILURE: self._inject_failure,
        }

    def execute(self, command: ReceivedCommand) -> list[Result]:
        """Carry out a command; return the results that it is acknowledged with, in order."""
        handler = self._table.get(command.number)
        if handler is None:
            return [Result.UNSUPPORTED]
        if any(math.isinf(value) for value in command.params):
            return [Result.DENIED]
        result = handler(command)
        if command.number == mavlink.MAV_CMD_DO_SET_MODE:
            return [Result.ACCEPTED, result]  # the MAVLink module says that it was passed on
        return [result]

    def _arm(self, command: ReceivedCommand) -> Result:
        wanted, force = command.params[0], whole(command.params[1]) == FORCE_ARMING
        if wanted not in (0.0, 1.0):
            return Result.UNSUPPORTED
        return self._vehicle.arm() if wanted else self._vehicle.disarm(force)

    def _set_mode(self, command: ReceivedCommand) -> Result:
        base, main, sub = (whole(value) for value in command.params[:3])
        custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if base is None or not base & custom or main not in _MAIN_MODES:
            return Result.ACCEPTED  # as PX4 says, too, where it changes nothing
        sub = sub if sub is not None and 0 <= sub < 256 else 0
        return self._vehicle.set_mode(Mode(main, sub if main == modes.AUTO_HOLD.main else 0))

    def _take_off(self, command: ReceivedCommand) -> Result:
        if command.frame not in _GLOBAL_FRAMES:
            return Result.UNSUPPORTED_FRAME
        height = command.params[6] - self._origin.altitude_m - float(self._vehicle.home[2])
        return self._vehicle.takeoff(height)

    def _test_motor(self, command: ReceivedCommand) -> Result:
        """Turn a motor: output function 1 to 4, for the seconds of parameter 2, at most 3."""
        motor, seconds = whole(command.params[4]), command.params[1]
        if motor is None or not 1 <= motor <= len(PX4_ROTORS):
            return Result.UNSUPPORTED
        seconds = min(seconds, _LONGEST_TEST_S) if seconds > 0.0 else 0.0
        return self._vehicle.test_motor(PX4_ROTORS[motor - 1], seconds)

    def _inject_failure(self, command: ReceivedCommand) -> Result:
        """Empty the battery; no other failure is simulated."""
        unit, kind = command.params[:2]
        battery = unit == mavlink.FAILURE_UNIT_SYSTEM_BATTERY and kind == mavlink.FAILURE_TYPE_OFF
        return self._vehicle.fail_battery() if battery else Result.UNSUPPORTED

    def _reposition(self, command: ReceivedCommand) -> Result:
        """Go to the place of parameters 5 to 7; NaN: as it is."""
        latitude, longitude, altitude = command.params[4:]
        origin_m = self._origin.altitude_m
        place = np.array([math.nan, math.nan, altitude - origin_m])
        if command.frame not in _GLOBAL_FRAMES:
            return Result.UNSUPPORTED_FRAME
        if abs(latitude) > 90.0 or abs(longitude) > 180.0:
            return Result.DENIED
        if math.isfinite(latitude) and math.isfinite(longitude):
            place[:2] = self._origin.local_of(latitude, longitude, origin_m)[:2]
        flags = whole(command.params[1]) or 0
        changes_mode = flags & mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
        if not changes_mode and self._vehicle.mode != modes.AUTO_HOLD:
            return Result.TEMPORARILY_REJECTED
        return self._vehicle.reposition(place, ros_yaw(command.params[3]))  # rad, as PX4 reads it


_TYPES = {"int32": mavlink.MAV_PARAM_TYPE_INT32, "float": mavlink.MAV_PARAM_TYPE_REAL32}
"""Type of a parameter → MAV_PARAM_TYPE."""


class ParameterServer:
    """Answers for one table, in the order of the names, as PX4 does."""

    def __init__(self, table: ParameterTable) -> None:
        self._table = table
        self._names = sorted(table.names)

    def value(self, name: str) -> list[Any]:
        """Return PARAM_VALUE of a parameter; nothing if there is none: PX4 is silent."""
        if name not in self._names:
            return []
        kind, value = self._table.type_of(name), self._table.stored[name]
        if kind == "int32":
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        index, count = self._names.index(name), len(self._names)
        content = (name.encode(), value, _TYPES[kind], count, index)
        return [mavlink.MAVLink_param_value_message(*content)]

    def answers(self, message: Any) -> list[Any]:
        """Return the PARAM_VALUE messages that answer a request.

        PARAM_REQUEST_LIST asks for all, PARAM_REQUEST_READ for one: by index, or by name where the
        index is -1. An unknown one has no answer, as with PX4.
        """
        if message.get_type() == "PARAM_REQUEST_LIST":
            return [value for name in self._names for value in self.value(name)]
        index = message.param_index
        if index >= len(self._names):
            return []
        return self.value(message.param_id if index < 0 else self._names[index])

    def refuse_set(self, message: Any) -> str:
        """Carry out PARAM_SET, as PX4 does: out of bounds is taken, too; "" or why it is not."""
        name, value = message.param_id, message.param_value
        if name not in self._names:
            return f"{name} is unknown"
        kind = self._table.type_of(name)
        if message.param_type != _TYPES[kind]:
            return f"{name} is {kind}"
        if kind == "int32":
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        self._table.store(name, value)
        return ""


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
        if mask & _NO_ATTITUDE:
            return "without attitude: body rates are not simulated"
        thrust = math.nan if mask & _NO_THRUST else float(m.thrust)
        return OffboardSetpoint(attitude=_rotation(m.q), thrust=thrust)
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
