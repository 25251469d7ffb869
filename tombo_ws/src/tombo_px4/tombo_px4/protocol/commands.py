"""Commands that come in (COMMAND_LONG, COMMAND_INT) and PX4's answers to them."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.arrays import Array
from tombo_px4 import modes
from tombo_px4.frames import GeoOrigin, ros_yaw
from tombo_px4.link.decoded_messages import FORCE_ARMING, Result
from tombo_px4.modes import Mode

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle
    from tombo_px4.protocol.mavlink_channel import StreamTable


_GLOBAL_FRAMES = (mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT)
_NO_PLACE = 0x7FFFFFFF
_MAIN_MODES = {mode.main for mode in modes.MODE_NAMES}
_CHANGE_MODE = mavlink.MAV_DO_REPOSITION_FLAGS_CHANGE_MODE
_LARGEST_ID = 0xFFFFFF


class ReceivedCommand(NamedTuple):
    """A command, whichever of the two messages carried it."""

    number: int
    params: tuple[float, ...]
    """Seven; 5 and 6 are degrees where they are a place."""
    frame: int = mavlink.MAV_FRAME_GLOBAL


class CommandReply(NamedTuple):
    """Answer to a command."""

    result: Result
    """Of the last COMMAND_ACK."""
    passed_on: bool = False
    """An ACCEPTED comes before: the MAVLink module says that it has passed the command on."""
    message: int | None = None
    """Number of a message that was asked for."""
    text: str = ""
    """STATUSTEXT sent as a warning."""


Answer = Result | CommandReply
"""Of a handler; a result alone needs no more."""


def command_of(message: Any) -> ReceivedCommand:
    """Return the command in a COMMAND_LONG or COMMAND_INT."""
    first = (message.param1, message.param2, message.param3, message.param4)
    if message.get_type() == "COMMAND_LONG":
        return ReceivedCommand(
            message.command, (*first, message.param5, message.param6, message.param7)
        )
    x, y = (math.nan if v == _NO_PLACE else 1e-7 * v for v in (message.x, message.y))
    return ReceivedCommand(message.command, (*first, x, y, message.z), message.frame)


def whole(value: float) -> int | None:
    """Return a parameter as a whole number; None if it is not finite or out of range."""
    if not math.isfinite(value) or abs(value) > _LARGEST_ID:
        return None
    return round(value)


class CommandServer:
    """Carries out the commands of all links."""

    def __init__(self, vehicle: Px4Vehicle, origin: GeoOrigin) -> None:
        self._vehicle = vehicle
        self._origin = origin
        self._table: dict[int, Callable[[ReceivedCommand], Answer]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            mavlink.MAV_CMD_NAV_LAND: lambda c: vehicle.land(),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda c: vehicle.return_home(),
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: self._check,
            mavlink.MAV_CMD_REQUEST_MESSAGE: self._request_message,
        }

    def execute(self, command: ReceivedCommand, streams: StreamTable) -> CommandReply:
        """Carry out a command that came over a link with these streams."""
        if any(math.isinf(p) for p in command.params):
            return CommandReply(Result.DENIED, text="command refused: a parameter is infinite")
        if command.number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            return CommandReply(self._set_interval(command, streams))
        handler = self._table.get(command.number)
        answer = Result.UNSUPPORTED if handler is None else handler(command)
        return CommandReply(answer) if isinstance(answer, Result) else answer

    def _arm(self, command: ReceivedCommand) -> Answer:
        wanted, force = whole(command.params[0]), whole(command.params[1]) == FORCE_ARMING
        if wanted not in (0, 1) or wanted != command.params[0]:
            return Result.UNSUPPORTED
        act = self._vehicle.arm if wanted else self._vehicle.disarm
        return act(force)

    def _set_mode(self, command: ReceivedCommand) -> Answer:
        base, main, sub = (whole(p) for p in command.params[:3])
        result = Result.ACCEPTED  # as PX4 says, too, where it changes nothing
        custom = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        if base is not None and base & custom and main in _MAIN_MODES:
            sub = sub if sub is not None and 0 <= sub < 256 else 0
            result = self._vehicle.set_mode(Mode(main, sub if main == modes.AUTO_HOLD.main else 0))
        return CommandReply(result, passed_on=True)

    def _take_off(self, command: ReceivedCommand) -> Answer:
        if command.frame not in _GLOBAL_FRAMES:
            return Result.UNSUPPORTED_FRAME
        height = command.params[6] - self._origin.altitude_m - float(self._vehicle.home[2])
        yaw = command.params[3]
        return self._vehicle.takeoff(height, ros_yaw(math.radians(yaw)))

    def _reposition(self, command: ReceivedCommand) -> Answer:
        if command.frame not in _GLOBAL_FRAMES:
            return Result.UNSUPPORTED_FRAME
        place = self._place(command)
        flags, yaw = whole(command.params[1]) or 0, command.params[3]
        if place is None:
            return Result.DENIED
        if not flags & _CHANGE_MODE and self._vehicle.mode != modes.AUTO_HOLD:
            return Result.TEMPORARILY_REJECTED
        return self._vehicle.reposition(place, ros_yaw(yaw))  # rad, as PX4 reads it

    def _place(self, command: ReceivedCommand) -> Array | None:
        """Return (3) in map of parameters 5 to 7, NaN where there is none; None: nowhere."""
        latitude, longitude, altitude = command.params[4:]
        height = altitude - self._origin.altitude_m
        if math.isnan(latitude) or math.isnan(longitude):
            return np.array([math.nan, math.nan, height])
        if abs(latitude) > 90.0 or abs(longitude) > 180.0:
            return None
        place = self._origin.local_of(latitude, longitude, self._origin.altitude_m)
        return np.array([place[0], place[1], height])

    def _check(self, command: ReceivedCommand) -> Answer:
        if self._vehicle.armed:
            return Result.TEMPORARILY_REJECTED
        return CommandReply(Result.ACCEPTED, text="; ".join(self._vehicle.health.problems))

    def _set_interval(self, command: ReceivedCommand, streams: StreamTable) -> Result:
        number, interval = whole(command.params[0]), command.params[1]
        done = (
            number is not None
            and math.isfinite(interval)
            and streams.set_interval(number, interval, self._vehicle.boot_us)
        )
        return Result.ACCEPTED if done else Result.FAILED

    def _request_message(self, command: ReceivedCommand) -> Answer:
        number = whole(command.params[0])
        if number is None:
            return Result.DENIED
        return CommandReply(Result.ACCEPTED, message=number)
