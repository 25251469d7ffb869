"""One link of the endpoint and its state: which messages are due when, and the other's clock."""

from __future__ import annotations

from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.timesync import TimeSync
from tombo_px4.protocol.telemetry import STREAMS

_SHORTEST_US = 4_000
"""As fast as PX4 publishes its state: 250 Hz."""
_STAGGER_US = 1_000
_TIMESYNC_NS = 100_000_000
_STATION_US = 2_500_000
"""A ground station that has been silent for so long has gone."""


class MavlinkChannel:
    """A link. Time is the vehicle's, since boot."""

    def __init__(self, link: Link, stream_set: str, boot_us: int) -> None:
        """Begin with the streams of a set.

        Args:
            link: over which all goes.
            stream_set: `onboard` or `ground`.
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
        """Return the messages that are due now; what was missed is not made up for."""
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
            message: as it came.
            peer: where it came from.
            arrival_ns: when it came, since boot.
            boot_ns: now.
        """
        if message.tc1 != 0:
            self.timesync.reply(message.tc1, message.ts1, arrival_ns)
            return
        answer = self.timesync.answer(message.tc1, message.ts1, arrival_ns, boot_ns)
        if answer is not None:
            self.link.send(mavlink.MAVLink_timesync_message(*answer), peer)
