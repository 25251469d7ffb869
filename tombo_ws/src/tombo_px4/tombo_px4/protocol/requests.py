"""What clients ask for: commands (COMMAND_LONG, COMMAND_INT) and parameters, as PX4 serves them.

Whole parameters travel as the bytes of a float.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from tombo_px4 import modes
from tombo_px4.frames import GeoOrigin, ros_yaw
from tombo_px4.link.decoded_messages import FORCE_ARMING, Result
from tombo_px4.modes import Mode

if TYPE_CHECKING:
    from tombo_px4.autopilot.parameters import ParameterTable
    from tombo_px4.autopilot.vehicle import Px4Vehicle

_GLOBAL_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_NO_PLACE = 0x7FFFFFFF
_MAIN_MODES = {mode.main for mode in modes.MODE_NAMES}
_LARGEST_ID = 0xFFFFFF


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
            mavlink.MAV_CMD_NAV_LAND: self._land,
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: self._return,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
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

    def _land(self, command: ReceivedCommand) -> Result:
        return self._vehicle.set_mode(modes.AUTO_LAND, "Landing at current position")

    def _return(self, command: ReceivedCommand) -> Result:
        return self._vehicle.set_mode(modes.AUTO_RTL, "Returning to launch")

    def _take_off(self, command: ReceivedCommand) -> Result:
        if command.frame not in _GLOBAL_FRAMES:
            return Result.UNSUPPORTED_FRAME
        height = command.params[6] - self._origin.altitude_m - float(self._vehicle.home[2])
        return self._vehicle.takeoff(height)

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


class ParameterServer:
    """Answers for one table, in the order of the names, as PX4 does."""

    def __init__(self, table: ParameterTable) -> None:
        self._table = table
        self._names = sorted(table.names)

    def value(self, name: str) -> Any | None:
        """Return PARAM_VALUE of a parameter; None: there is no such one, and PX4 is silent."""
        if name not in self._names:
            return None
        kind, value = self._table.type_of(name), self._table.stored(name)
        if kind == "int32":
            value = struct.unpack("<f", struct.pack("<i", int(value)))[0]
        index, count = self._names.index(name), len(self._names)
        content = (name.encode(), value, _TYPES[kind], count, index)
        return mavlink.MAVLink_param_value_message(*content)

    def answer_read(self, message: Any) -> Any | None:
        """Return PARAM_VALUE for PARAM_REQUEST_READ, by name or by index."""
        index = message.param_index
        if index < 0:
            return self.value(message.param_id)
        return self.value(self._names[index]) if index < len(self._names) else None

    def answer_set(self, message: Any) -> tuple[Any, str]:
        """Carry out PARAM_SET, as PX4 does: out of bounds is taken, too.

        Returns:
            PARAM_VALUE that stands now, for everybody, and ""; None where PX4 is silent, and why.
        """
        name, value = message.param_id, message.param_value
        if name not in self._names:
            return None, f"{name} is unknown"
        kind = self._table.type_of(name)
        if message.param_type != _TYPES[kind]:
            return None, f"{name} is {kind}"
        if kind == "int32":
            value = struct.unpack("<i", struct.pack("<f", value))[0]
        self._table.store(name, value)
        return self.value(name), ""

    def values(self) -> list[Any]:
        """Return PARAM_VALUE of all parameters."""
        return [self.value(name) for name in self._names]
