"""The simulated vehicle on its MAVLink links: receives, flies, sends telemetry.

Time comes in: `boot_ns` since the vehicle's start, `wall_ns` of the clock that the links stamp
arrivals with.
"""

from __future__ import annotations

import select
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

from tombo_dynamics.time_base import SECOND_NS, TICK_NS
from tombo_px4.frames import GeoOrigin
from tombo_px4.link.mavlink_link import Link
from tombo_px4.protocol.mavlink_channel import MavlinkChannel
from tombo_px4.protocol.message_router import MessageRouter, RoutedMessage
from tombo_px4.protocol.parameter_protocol import ParameterServer
from tombo_px4.protocol.statustext import StatusTextSender
from tombo_px4.protocol.telemetry import Telemetry

if TYPE_CHECKING:
    from tombo_px4.autopilot.vehicle import Px4Vehicle

_MOST_TICKS = 25
"""Ticks that one call flies; the caller comes back for the rest."""
_CHECKED_US = 2_000_000
"""The checks of arming are reported at most so often, and only where they have changed."""
_MOST_MESSAGES = 100
"""Messages of a link that one call takes; the rest waits its turn."""


class Endpoint:
    """Serves all links of one vehicle."""

    def __init__(self, vehicle: Px4Vehicle, links: Sequence[tuple[Link, str]]) -> None:
        """Serve links, each with the set of streams it carries by default.

        Args:
            vehicle: at its present tick.
            links: with `onboard` or `ground`.
        """
        self.vehicle = vehicle
        self.origin = origin = GeoOrigin()
        self.telemetry = Telemetry(vehicle, origin)
        offered, now = self.telemetry.offered, vehicle.boot_us
        self.channels = [MavlinkChannel(link, streams, offered, now) for link, streams in links]
        self.statustext = StatusTextSender(self.channels)
        parameters = ParameterServer(vehicle.parameters)
        self.message_router = MessageRouter(
            vehicle, origin, self.telemetry, parameters, self.statustext, self.channels
        )
        self._last_state: tuple[Any, ...] = ()
        self._checked_us = 0
        self._boot_ns = 0

    def advance(self, boot_ns: int, wall_ns: int) -> None:
        """Handle received messages, fly up to now, send what is due.

        The work of one call is bounded: a flood, or a vehicle that lags behind, takes several.

        Args:
            boot_ns: time now, since the vehicle's start.
            wall_ns: time now, of the links' arrival stamps.
        """
        self._boot_ns = boot_ns
        received = self._receive(boot_ns, wall_ns)
        for port in self.channels:
            port.request_timesync(boot_ns)
        self._fly(boot_ns)
        for routed in received:
            self.message_router.take(routed)
        self._report_changes()
        for port in self.channels:
            port.send_list(self.vehicle.boot_us)

    @property
    def behind_ns(self) -> int:
        """How far the vehicle is behind the time of the last call."""
        return self._boot_ns - self.vehicle.tick * TICK_NS

    def next_ns(self) -> int:
        """Return when something is due next [ns since boot], if nothing comes."""
        return min(port.next_ns() for port in self.channels)

    def say(self, severity: int, text: str) -> None:
        """Send a text on all links that does not come from the vehicle."""
        self.statustext.say(severity, text, self.vehicle.boot_us)

    def _receive(self, boot_ns: int, wall_ns: int) -> list[RoutedMessage]:
        """Return what has come; TIMESYNC is answered before anything else is done."""
        messages = []
        for port in self.channels:
            for received in port.link.receive(_MOST_MESSAGES):
                arrival_ns = received.arrival_ns + boot_ns - wall_ns
                if received.message.get_type() == "TIMESYNC":
                    port.time(received.message, received.peer, arrival_ns, boot_ns)
                else:
                    messages.append(RoutedMessage(port, received, arrival_ns // 1000))
        return messages

    def _fly(self, boot_ns: int) -> None:
        """Fly up to now, sending at each tick what is due there."""
        vehicle = self.vehicle
        for _ in range(_MOST_TICKS):
            self._send_due()
            if (vehicle.tick + 1) * TICK_NS > boot_ns:
                break
            vehicle.step()

    def _send_due(self) -> None:
        """Send what is due at this tick."""
        for port in self.channels:
            for number in port.streams.take_due(self.vehicle.boot_us):
                message = self.telemetry.message(number, port.mav)
                if message is not None:
                    port.link.send(message)

    def _report_changes(self) -> None:
        """Send the vehicle's texts. A new mode waits for the next HEARTBEAT, as in PX4."""
        vehicle = self.vehicle
        for severity, text in vehicle.take_status_texts():
            self.statustext.say(severity, text, vehicle.boot_us)
        if not vehicle.armed and vehicle.boot_us - self._checked_us >= _CHECKED_US:
            self._checked_us = vehicle.boot_us
            self.statustext.report_checks(vehicle.health.problems, vehicle.boot_us)
        state = (vehicle.armed, vehicle.mode, vehicle.failsafe, vehicle.landed)
        if state != self._last_state:
            self._last_state = state
            self.telemetry.reset()


Clock = Callable[[], int]
_SLIP_NS = 200_000_000
_LONGEST_NS = 4_000_000
"""Longest time between two calls, so that commands meet a recent state."""
_LOAD_NS = SECOND_NS


class BootClock:
    """Time since the vehicle's start; it is delayed when the machine is too slow."""

    def __init__(self, now_ns: int) -> None:
        self._began_ns = now_ns
        self.slipped_ns = 0
        """Total delay compared with a machine that is fast enough [ns]."""

    def boot_ns(self, now_ns: int) -> int:
        """Return the time since boot of a time of the monotonic clock."""
        return now_ns - self._began_ns

    def slip(self, behind_ns: int) -> bool:
        """Delay the clock if the vehicle is too far behind; return whether it was delayed."""
        if behind_ns <= _SLIP_NS:
            return False
        self._began_ns += behind_ns
        self.slipped_ns += behind_ns
        return True


def serve(
    endpoint: Endpoint,
    monotonic_ns: Clock,
    wall_ns: Clock,
    stop: Callable[[], bool],
    redraw: Callable[[int, BootClock], None] | None = None,
) -> BootClock:
    """Serve in real time until `stop` says so.

    Args:
        endpoint: at the vehicle's tick 0.
        monotonic_ns: paces the vehicle: a clock that never jumps.
        wall_ns: CLOCK_REALTIME, which stamps arrivals.
        stop: asked a few hundred times a second.
        redraw: called after each round with the time since boot [ns], to show how it goes.

    Returns:
        the clock, with how much it has slipped.
    """
    clock = BootClock(monotonic_ns() - endpoint.vehicle.tick * TICK_NS)
    poll = select.poll()
    watched: dict[int, int] = {}
    busy_ns, since_ns = 0, monotonic_ns()
    while not stop():
        began_ns = monotonic_ns()
        endpoint.advance(clock.boot_ns(began_ns), wall_ns())
        if clock.slip(endpoint.behind_ns):
            endpoint.say(4, "the machine is too slow: simulated time stands still meanwhile")
        if redraw is not None:
            redraw(clock.boot_ns(began_ns), clock)
        watched = _watch(poll, endpoint, watched)
        now_ns = monotonic_ns()
        busy_ns += now_ns - began_ns
        if now_ns - since_ns >= _LOAD_NS:
            endpoint.telemetry.load = busy_ns / (now_ns - since_ns)
            busy_ns, since_ns = 0, now_ns
        boot_ns = clock.boot_ns(now_ns)
        until_ns = min(endpoint.next_ns(), boot_ns + _LONGEST_NS)
        if endpoint.behind_ns < _LONGEST_NS and until_ns > boot_ns:
            poll.poll(-(-(until_ns - boot_ns) // 1_000_000))
    return clock


def _watch(poll: select.poll, endpoint: Endpoint, watched: dict[int, int]) -> dict[int, int]:
    """Watch the files that the links have now: those of TCP come and go."""
    now = {port.link.fileno(): 1 for port in endpoint.channels}
    if now.keys() != watched.keys():
        for number in watched.keys() - now.keys():
            poll.unregister(number)
        for number in now.keys() - watched.keys():
            poll.register(number, select.POLLIN)
    return now
