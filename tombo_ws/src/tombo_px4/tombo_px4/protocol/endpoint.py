"""The simulated vehicle on its MAVLink links: receives, flies, sends telemetry.

Time comes in: `boot_ns` since the vehicle's start, `wall_ns` of the clock that the links stamp
arrivals with.
"""

from __future__ import annotations

import math
import select
from collections import Counter
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from pymavlink.dialects.v20 import common as mavlink

from tombo_dynamics.time_base import TICK_NS
from tombo_px4.frames import GeoOrigin
from tombo_px4.link.mavlink_link import Link, Received
from tombo_px4.link.timesync import TimeSync, answer_request
from tombo_px4.modes import Result, Severity
from tombo_px4.protocol.requests import (
    CommandServer,
    ParameterServer,
    ReceivedCommand,
    command_of,
    decode_setpoint,
    decode_vision,
    whole,
)
from tombo_px4.protocol.telemetry import STREAMS, VehicleView

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle

_MOST_TICKS = 25
"""Ticks that one call flies; the caller comes back for the rest."""
_MOST_MESSAGES = 100
"""Messages of a link that one call takes; the rest waits its turn."""
_METADATA = (395, 396, 397)
"""Numbers of COMPONENT_INFORMATION, _BASIC and COMPONENT_METADATA, which PX4 does not support."""
_SWITCH_ON_US = 1750
"""Pulse above which the kill switch is on: PX4's RC_KILLSWITCH_TH 0.75 of 1000 to 2000 us."""
_ALL_IDS = 0
"""Target that addresses all systems or components."""
_NO_PROGRESS = 255
"""Progress in COMMAND_ACK that says: not known."""
PIECE = 50
"""Bytes of text that a STATUSTEXT message carries."""
_MOST_PIECES = 6
"""Messages that a text is split into at most; the rest of it is cut off."""
_SHORTEST_US = 4_000
"""Shortest interval of a message, as fast as PX4 publishes its state: 250 Hz."""
_STAGGER_US = 1_000
"""Time between the first messages of two streams, so that not all are due at once."""
_TIMESYNC_NS = 100_000_000
"""Period of TIMESYNC requests."""
_STATION_US = 2_500_000
"""Time of silence after which a ground station has gone."""


class MavlinkChannel:
    """A link with its streams of telemetry. Times are the vehicle's, since boot."""

    def __init__(self, link: Link, stream_set: str, boot_us: int) -> None:
        """Begin with the streams of a set.

        Args:
            link: sends and receives.
            stream_set: `onboard`, for a companion computer, or `ground`, for a ground station.
            boot_us: time now.
        """
        self.link = link
        self.onboard = stream_set == "onboard"
        self.timesync = TimeSync()
        rates = {n: s.onboard_hz if self.onboard else s.ground_hz for n, s in STREAMS.items()}
        self._default = {number: round(1e6 / rate) for number, rate in rates.items() if rate}
        self._interval = dict(self._default)
        self._due = {number: boot_us + i * _STAGGER_US for i, number in enumerate(self._interval)}
        self._next_request_ns = 0
        self._station_us = -_STATION_US

    def take_due(self, boot_us: int) -> list[int]:
        """Return the messages that are due now; missed messages are not repeated."""
        numbers = [number for number, due in self._due.items() if due <= boot_us]
        for number in numbers:
            due, interval = self._due[number], self._interval[number]
            self._due[number] = (due if due + interval > boot_us else boot_us) + interval
        return numbers

    def set_interval(self, number: int, interval_us: float, boot_us: int) -> bool:
        """Change how often a message is sent.

        Args:
            number: of the message.
            interval_us: time between two; 0: the default of the link, below 0: never.
            boot_us: time now.

        Returns:
            False: there is no such message, or it is HEARTBEAT, which nobody may change.
        """
        if number not in STREAMS or number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return False
        wanted = self._default.get(number, 0) if interval_us == 0.0 else 0
        if interval_us > 0.0:
            wanted = round(min(max(interval_us, _SHORTEST_US), 1e12))
        if wanted:
            self._interval[number] = wanted
            self._due[number] = min(self._due.get(number, boot_us), boot_us + wanted)
        else:
            self._due.pop(number, None)
        return True

    def hear_station(self, boot_us: int) -> None:
        """Record the heartbeat of a ground station."""
        self._station_us = boot_us

    def hears_station(self, boot_us: int) -> bool:
        """Return whether a ground station is there: without one PX4 sends no texts."""
        return boot_us - self._station_us < _STATION_US

    def request_timesync(self, boot_ns: int) -> None:
        """Send a TIMESYNC request if it is time."""
        if self.onboard and boot_ns >= self._next_request_ns:
            self._next_request_ns = boot_ns + _TIMESYNC_NS
            self.link.send(mavlink.MAVLink_timesync_message(*self.timesync.request(boot_ns)))

    def take_timesync(self, message: Any, peer: Any, arrival_ns: int, boot_ns: int) -> None:
        """Take a TIMESYNC; answer it if it is a request.

        Args:
            message: TIMESYNC.
            peer: address of the sender.
            arrival_ns: its arrival, since boot.
            boot_ns: time now.
        """
        if message.tc1 != 0:
            self.timesync.reply(message.tc1, message.ts1, arrival_ns)
            return
        answer = answer_request(message.ts1, arrival_ns, boot_ns)
        self.link.send(mavlink.MAVLink_timesync_message(*answer), peer)


class RoutedMessage(NamedTuple):
    """A message, and where and when it came."""

    channel: MavlinkChannel
    received: Received
    arrival_us: int
    """Since boot."""

    def answer(self, message: Any) -> None:
        """Send a message to the sender."""
        self.channel.link.send(message, self.received.peer)


class Endpoint:
    """Serves all links of one vehicle. Each message is answered, refused or counted."""

    def __init__(
        self,
        vehicle: Px4Vehicle,
        links: Sequence[tuple[Link, str]],
        tell: Callable[[int, str], object] = lambda severity, text: None,
    ) -> None:
        """Serve links, each with the set of streams it carries by default.

        Args:
            vehicle: at its present tick.
            links: with `onboard` or `ground`.
            tell: called with severity and text of all texts.
        """
        self.vehicle = vehicle
        self.origin = GeoOrigin()
        self.channels = [MavlinkChannel(link, streams, vehicle.boot_us) for link, streams in links]
        self.refused: Counter[str] = Counter()
        """How often something was refused, by reason."""
        self._tell = tell
        self._texts = -1
        """Number of the last text. PX4 counts from 0."""
        self._switch_on: bool | None = None
        self._commands = CommandServer(vehicle, self.origin)
        self._parameters = ParameterServer(vehicle.parameters)
        self._ids = tuple(
            int(vehicle.parameters.get(f"MAV_{name}_ID")) for name in ("SYS", "COMP")
        )
        # By type: what answers, and whether a message for another vehicle is left to it.
        self._handlers: dict[str, tuple[Callable[[RoutedMessage], None], bool]] = {
            "HEARTBEAT": (self._heartbeat, False),
            "COMMAND_LONG": (self._command, True),
            "COMMAND_INT": (self._command, True),
            "PARAM_REQUEST_LIST": (self._parameter_read, True),
            "PARAM_REQUEST_READ": (self._parameter_read, True),
            "PARAM_SET": (self._parameter_set, True),
            "VISION_POSITION_ESTIMATE": (self._vision, False),
            "ODOMETRY": (self._vision, False),
            "ATT_POS_MOCAP": (self._vision, False),
            "SET_POSITION_TARGET_LOCAL_NED": (self._target, True),
            "SET_ATTITUDE_TARGET": (self._target, True),
            "RC_CHANNELS_OVERRIDE": (self._remote_control, True),
            "MISSION_REQUEST_LIST": (self._mission_count, True),
        }

    def advance(self, boot_ns: int, wall_ns: int) -> None:
        """Handle received messages, fly up to now, send what is due.

        The work of one call is bounded: a flood, or a vehicle that lags behind, takes several.

        Args:
            boot_ns: time now, since the vehicle's start.
            wall_ns: time now, of the links' arrival stamps.
        """
        received = self._receive(boot_ns, wall_ns)
        for channel in self.channels:
            channel.request_timesync(boot_ns)
        self._fly(boot_ns)
        for routed in received:
            self._take(routed)
        self._say_texts()

    def say(self, severity: int, text: str) -> None:
        """Send a text, in pieces if it is long, where a ground station is heard.

        Other characters than ASCII become `?`.
        """
        self._tell(severity, text)
        self._texts = (self._texts + 1) % 65536
        data = text.encode("ascii", "replace")[: _MOST_PIECES * PIECE]
        # like PX4's, a text that fills its last piece has no other one that would end it
        for i, first in enumerate(range(0, max(len(data), 1), PIECE)):
            content = (severity, data[first : first + PIECE], self._texts, i)
            for channel in self.channels:
                if channel.hears_station(self.vehicle.boot_us):
                    channel.link.send(mavlink.MAVLink_statustext_message(*content))

    def message(self, number: int) -> Any | None:
        """Return a message about the present tick; None: there is none, or no value."""
        if number not in STREAMS:
            return None
        return STREAMS[number].message(VehicleView(self.vehicle, self.origin))

    def _receive(self, boot_ns: int, wall_ns: int) -> list[RoutedMessage]:
        """Return the received messages; TIMESYNC is answered before anything else is done."""
        messages = []
        for channel in self.channels:
            for received in channel.link.receive(_MOST_MESSAGES):
                arrival_ns = received.arrival_ns + boot_ns - wall_ns
                if received.message.get_type() == "TIMESYNC":
                    channel.take_timesync(received.message, received.peer, arrival_ns, boot_ns)
                else:
                    messages.append(RoutedMessage(channel, received, arrival_ns // 1000))
        return messages

    def _fly(self, boot_ns: int) -> None:
        """Fly up to now, sending at each tick what is due there."""
        vehicle = self.vehicle
        for _ in range(_MOST_TICKS):
            for channel in self.channels:
                for message in map(self.message, channel.take_due(vehicle.boot_us)):
                    if message is not None:
                        channel.link.send(message)
            if (vehicle.tick + 1) * TICK_NS > boot_ns:
                break
            vehicle.step()

    def _say_texts(self) -> None:
        """Send the vehicle's texts. A new mode waits for the next HEARTBEAT, as in PX4."""
        for severity, text in self.vehicle.take_status_texts():
            self.say(severity, text)

    # --- what comes in

    def _take(self, routed: RoutedMessage) -> None:
        """Hand a message to what answers its type."""
        message = routed.received.message
        kind = message.get_type()
        handler, only_ours = self._handlers.get(kind, (None, False))
        if handler is None:
            self.refused[f"{kind} is not used"] += 1
        elif only_ours and not self._for_us(message, kind.startswith("SET_")):
            self.refused["addressed to another"] += 1
        else:
            handler(routed)

    def _for_us(self, message: Any, or_all: bool) -> bool:
        """Return whether it is for this vehicle: its system, and its component or all of them."""
        system, component = self._ids
        systems = (system, _ALL_IDS) if or_all else (system,)
        target = getattr(message, "target_component", _ALL_IDS)
        return message.target_system in systems and target in (_ALL_IDS, component)

    def _heartbeat(self, routed: RoutedMessage) -> None:
        if routed.received.message.type == mavlink.MAV_TYPE_GCS:
            routed.channel.hear_station(self.vehicle.boot_us)

    def _command(self, routed: RoutedMessage) -> None:
        """Carry out a command and acknowledge it; texts about it go first, as in PX4."""
        command = command_of(routed.received.message)
        number = command.number
        if number == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            results = [self._set_interval(command, routed.channel)]
        elif number == mavlink.MAV_CMD_REQUEST_MESSAGE:
            results = [self._request_message(command, routed)]
        elif number == mavlink.MAV_CMD_RUN_PREARM_CHECKS:
            results = [self._run_checks()]
        else:
            results = self._commands.execute(command)
        self._say_texts()
        sender = (routed.received.system, routed.received.component)
        for result in results:
            content = (number, int(result), _NO_PROGRESS, 0)
            routed.answer(mavlink.MAVLink_command_ack_message(*content, *sender))
        if results[-1] == Result.UNSUPPORTED:
            self.refused[f"command {number} is not supported"] += 1

    def _set_interval(self, command: ReceivedCommand, channel: MavlinkChannel) -> Result:
        number, interval = whole(command.params[0]), command.params[1]
        done = (
            number is not None
            and math.isfinite(interval)
            and channel.set_interval(number, interval, self.vehicle.boot_us)
        )
        return Result.ACCEPTED if done else Result.FAILED

    def _request_message(self, command: ReceivedCommand, routed: RoutedMessage) -> Result:
        number = whole(command.params[0])
        message = None if number is None else self.message(number)
        if message is None:
            return Result.UNSUPPORTED if number in _METADATA else Result.DENIED
        routed.answer(message)
        return Result.ACCEPTED

    def _run_checks(self) -> Result:
        """Send a text for each preflight check that fails; refused while armed."""
        if self.vehicle.armed:
            return Result.TEMPORARILY_REJECTED
        for problem in self.vehicle.problems:
            self.say(Severity.CRITICAL, f"Preflight Fail: {problem}")
        return Result.ACCEPTED

    def _mission_count(self, routed: RoutedMessage) -> None:
        """Answer a ground station's request: mission, fence and rally points are empty."""
        received = routed.received
        content = (received.system, received.component, 0, received.message.mission_type)
        routed.answer(mavlink.MAVLink_mission_count_message(*content))

    def _parameter_read(self, routed: RoutedMessage) -> None:
        for value in self._parameters.answers(routed.received.message):
            routed.answer(value)

    def _parameter_set(self, routed: RoutedMessage) -> None:
        message = routed.received.message
        ignored = self._parameters.refuse_set(message)
        if ignored:
            self.refused[f"PARAM_SET not answered: {ignored}"] += 1
        for value in self._parameters.value(message.param_id) if not ignored else ():
            routed.answer(value)
            for other in self.channels:  # everybody's copy has to stay right
                if other is not routed.channel:
                    other.link.send(value)

    def _vision(self, routed: RoutedMessage) -> None:
        """Give a pose to the estimator, at its stamp if clocks are in step, else at arrival."""
        message, timesync = routed.received.message, routed.channel.timesync
        pose = decode_vision(message)
        if isinstance(pose, str):
            self.refused[f"{message.get_type()} {pose}"] += 1
            return
        stamp_us = min(routed.arrival_us, self.vehicle.boot_us)
        if pose.stamp_us != 0 and timesync.converged:
            stamp_us = timesync.to_local_time(pose.stamp_us * 1000) // 1000
        refusal = self.vehicle.vision(stamp_us, pose.position, pose.attitude)
        if refusal:
            self.refused[f"{message.get_type()} refused: {refusal.replace('_', ' ')}"] += 1

    def _remote_control(self, routed: RoutedMessage) -> None:
        """Take the kill switch; as in PX4, its first message changes nothing."""
        channel = int(self.vehicle.parameters.get("RC_MAP_KILL_SW"))
        on = channel > 0 and getattr(routed.received.message, f"chan{channel}_raw") > _SWITCH_ON_US
        if self._switch_on is not None and on != self._switch_on:
            self.vehicle.kill(on)
        self._switch_on = on

    def _target(self, routed: RoutedMessage) -> None:
        """Hand a set point to the controller of OFFBOARD."""
        message = routed.received.message
        target = decode_setpoint(message)
        refusal = target if isinstance(target, str) else self.vehicle.target(target)
        if refusal:
            self.refused[f"{message.get_type()} {refusal}"] += 1


Clock = Callable[[], int]
"""Returns the time [ns]."""
_SLIP_NS = 200_000_000
"""A vehicle that is behind by more does not catch up: its time is delayed."""
_PAUSE_S = 0.002
"""Longest time between two calls, so that commands meet a recent state."""


def serve(
    endpoint: Endpoint, monotonic_ns: Clock, wall_ns: Clock, stop: Callable[[], bool]
) -> int:
    """Serve in real time until `stop` says so; on a machine that is too slow, time is delayed.

    Args:
        endpoint: at the vehicle's tick 0.
        monotonic_ns: paces the vehicle: a clock that never jumps.
        wall_ns: CLOCK_REALTIME, which stamps arrivals.
        stop: asked a few hundred times a second.

    Returns:
        the sum of all delays [ns].
    """
    began_ns, slipped_ns = monotonic_ns() - endpoint.vehicle.tick * TICK_NS, 0
    while not stop():
        boot_ns = monotonic_ns() - began_ns
        endpoint.advance(boot_ns, wall_ns())
        behind_ns = boot_ns - endpoint.vehicle.tick * TICK_NS
        if behind_ns > _SLIP_NS:
            began_ns += behind_ns
            slipped_ns += behind_ns
            text = "the machine is too slow: simulated time stands still meanwhile"
            endpoint.say(Severity.WARNING, text)
        if behind_ns < TICK_NS:
            select.select([c.link.fileno() for c in endpoint.channels], (), (), _PAUSE_S)
    return slipped_ns
