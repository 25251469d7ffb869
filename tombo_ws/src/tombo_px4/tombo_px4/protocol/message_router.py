"""Routes received messages to their handlers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.frames import GeoOrigin
from tombo_px4.link.decoded_messages import Result, Severity
from tombo_px4.link.mavlink_link import Received
from tombo_px4.protocol.commands import CommandReply, CommandServer, command_of
from tombo_px4.protocol.input_decoder import decode_setpoint, decode_vision
from tombo_px4.protocol.mavlink_channel import MavlinkChannel
from tombo_px4.protocol.parameter_protocol import ParameterServer
from tombo_px4.protocol.statustext import StatusTextSender
from tombo_px4.protocol.telemetry import Telemetry

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle

_EVERYBODY = 0
_METADATA = (395, 396, 397)
"""COMPONENT_INFORMATION, _BASIC, COMPONENT_METADATA: not there at all."""
_NO_PROGRESS = 255


class RoutedMessage(NamedTuple):
    """A message, and where and when it came."""

    port: MavlinkChannel
    received: Received
    arrival_us: int
    """Since boot."""


class MessageRouter:
    """Routes messages; each is answered, refused or counted, and none raises an exception."""

    def __init__(
        self,
        vehicle: Px4Vehicle,
        origin: GeoOrigin,
        telemetry: Telemetry,
        parameters: ParameterServer,
        statustext: StatusTextSender,
        channels: Sequence[MavlinkChannel],
    ) -> None:
        self._vehicle = vehicle
        self._origin = origin
        self._telemetry = telemetry
        self._parameters = parameters
        self._commands = CommandServer(vehicle, origin)
        self._statustext = statustext
        self._channels = channels
        self.system = int(vehicle.parameters.get("MAV_SYS_ID"))
        self.component = int(vehicle.parameters.get("MAV_COMP_ID"))
        self.heard_systems: dict[tuple[int, int], int] = {}
        """System and component of all senders, and when the last message came [us since boot]."""
        # By type: what answers, and whether a message for another vehicle is left to it.
        self._handlers: dict[str, tuple[Callable[[RoutedMessage], None], bool]] = {
            "HEARTBEAT": (self._heartbeat, False),
            "COMMAND_LONG": (self._command, False),
            "COMMAND_INT": (self._command, False),
            "PARAM_REQUEST_LIST": (lambda routed: routed.port.begin_list(parameters), True),
            "PARAM_REQUEST_READ": (self._parameter_read, True),
            "PARAM_SET": (self._parameter_set, True),
            "VISION_POSITION_ESTIMATE": (self._vision, False),
            "ODOMETRY": (self._vision, False),
            "ATT_POS_MOCAP": (self._vision, False),
            "SET_POSITION_TARGET_LOCAL_NED": (self._target, False),
            "SET_ATTITUDE_TARGET": (self._target, False),
            "MISSION_REQUEST_LIST": (self._mission_count, True),
        }

    def take(self, routed: RoutedMessage) -> None:
        """Take a message."""
        received = routed.received
        sender = (received.system, received.component)
        self.heard_systems[sender] = routed.arrival_us
        kind = received.message.get_type()
        handler, only_ours = self._handlers.get(kind, (None, False))
        if handler is None:
            self._statustext.note(f"{kind} is not used")
        elif not only_ours or self._for_us(received.message):
            handler(routed)

    def _for_us(self, message: Any, or_all: bool = False) -> bool:
        """Return whether it is for this vehicle: its system, and its component or all of them."""
        systems = (self.system, _EVERYBODY) if or_all else (self.system,)
        component = getattr(message, "target_component", _EVERYBODY)
        if message.target_system in systems and component in (_EVERYBODY, self.component):
            return True
        self._statustext.note("addressed to another")
        return False

    def _heartbeat(self, routed: RoutedMessage) -> None:
        if routed.received.message.type == mavlink.MAV_TYPE_GCS:
            routed.port.hear_station(self._vehicle.boot_us)

    # --- commands

    def _command(self, routed: RoutedMessage) -> None:
        port, received = routed.port, routed.received
        message = received.message
        command = command_of(message)
        if not self._for_us(message):
            return
        answer = self._commands.execute(command, port.streams)
        self._telemetry.reset()
        result = self._send_requested(routed, answer)
        for severity, text in self._vehicle.take_status_texts():
            self._statustext.say(severity, text, self._vehicle.boot_us)
        for acknowledged in [Result.ACCEPTED, result] if answer.passed_on else [result]:
            sender = (received.system, received.component)
            content = (command.number, int(acknowledged), _NO_PROGRESS, 0)
            ack = port.mav.command_ack_encode(*content, *sender)
            port.link.send(ack, received.peer)
        if command.number == mavlink.MAV_CMD_RUN_PREARM_CHECKS:
            problems = self._vehicle.health.problems
            self._statustext.report_checks(problems, self._vehicle.boot_us, asked=True)
        if answer.text:
            severity = Severity.INFO if result == Result.ACCEPTED else Severity.WARNING
            self._statustext.say(severity, answer.text, self._vehicle.boot_us)
        if result == Result.UNSUPPORTED:
            self._statustext.note(f"command {command.number} is not supported")

    def _send_requested(self, routed: RoutedMessage, answer: CommandReply) -> Result:
        """Send what was asked for; return the result, denied where there is no such message."""
        port, peer = routed.port, routed.received.peer
        if answer.message is not None:
            message = self._telemetry.message(answer.message, port.mav)
            if message is None:
                return Result.UNSUPPORTED if answer.message in _METADATA else Result.DENIED
            port.link.send(message, peer)
        return answer.result

    def _mission_count(self, routed: RoutedMessage) -> None:
        """Say that there is no mission, fence or rally point, as a ground station asks."""
        port, received = routed.port, routed.received
        kind = received.message.mission_type
        count = port.mav.mission_count_encode(received.system, received.component, 0, kind)
        port.link.send(count, received.peer)

    # --- parameters

    def _parameter_read(self, routed: RoutedMessage) -> None:
        value = self._parameters.answer_read(routed.port.mav, routed.received.message)
        if value is not None:
            routed.port.link.send(value, routed.received.peer)

    def _parameter_set(self, routed: RoutedMessage) -> None:
        port, received = routed.port, routed.received
        value, ignored = self._parameters.answer_set(port.mav, received.message)
        if ignored:
            self._statustext.note(f"PARAM_SET not answered: {ignored}")
        if value is not None:
            port.link.send(value, received.peer)
            for other in self._channels:  # everybody's copy has to stay right
                if other is not port:
                    other.link.send(value)

    # --- poses and set points

    def _vision(self, routed: RoutedMessage) -> None:
        message = routed.received.message
        kind = message.get_type()
        pose = decode_vision(message)
        if isinstance(pose, str):
            self._statustext.note(f"{kind} {pose}")
            return
        stamp_us = min(routed.arrival_us, self._vehicle.boot_us)
        stamped = pose.stamp_us != 0 and routed.port.timesync.converged
        if stamped:
            stamp_us = routed.port.timesync.to_local_time(pose.stamp_us * 1000) // 1000
        refusal = self._vehicle.vision(stamp_us, pose.position, pose.attitude)
        if refusal == "out_of_order" and not stamped:  # two came at once: no fault of theirs
            self._statustext.note(f"{kind} before the clocks agreed")
        elif refusal:
            self._statustext.note(f"{kind} refused: {refusal.replace('_', ' ')}")

    def _target(self, routed: RoutedMessage) -> None:
        message = routed.received.message
        kind = message.get_type()
        if not self._for_us(message, or_all=True):
            return
        vehicle = self._vehicle
        target = decode_setpoint(message)
        if isinstance(target, str):
            self._statustext.note(f"{kind} {target}")
            return
        refusal = vehicle.target(target)
        if refusal:
            self._statustext.note(f"{kind} {refusal}")
