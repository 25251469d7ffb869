"""One link of the endpoint and its state."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.timesync import TimeSync
from tombo_px4.protocol.parameter_protocol import ParameterList
from tombo_px4.protocol.streams import StreamTable

_TIMESYNC_NS = 100_000_000


_SILENCE_US = 5_000_000
"""A partner that has been silent for so long has gone."""


_STATION_US = 2_500_000
"""A ground station that has been silent for so long has gone."""


class MavlinkChannel:
    """A link, its streams, the list of parameters under way, the partner and its clock.

    The partner, which gets the streams, is the first sender, until it is silent for 5 s: another
    client can't take the telemetry of the one that flies. PX4 keeps its partner for ever.
    """

    def __init__(
        self,
        link: Link,
        stream_set: str,
        offered: Mapping[int, str],
        boot_us: int,
        home: tuple[str, int] | None = None,
    ) -> None:
        """Begin with the streams of a set.

        Args:
            link: over which all goes.
            stream_set: `onboard` or `ground`.
            offered: number and name of every message that can be sent.
            boot_us: time now.
            home: where to send while there is no partner; None: as the link does.
        """
        self.link = link
        self._home = home
        self._partner: Any = home
        self._has_partner = False
        self._heard_us = 0
        self._station_us = -_STATION_US
        self.mav = link.mav
        self.streams = StreamTable(stream_set, offered, boot_us)
        self.list = ParameterList()
        self.timesync = TimeSync()
        self.requests_timesync = stream_set == "onboard"
        self._next_request_ns = 0

    def heard(self, peer: Any, boot_us: int) -> None:
        """Record the sender of a message."""
        if not self._has_partner:
            self._partner, self._has_partner = peer, True
        if peer == self._partner:
            self._heard_us = boot_us

    def hear_station(self, boot_us: int) -> None:
        """Record the heartbeat of a ground station."""
        self._station_us = boot_us

    def hears_station(self, boot_us: int) -> bool:
        """Return whether a ground station is there: without one PX4 sends no texts."""
        return boot_us - self._station_us < _STATION_US

    def maintain(self, boot_us: int) -> None:
        """Drop a partner that has gone."""
        if self._has_partner and boot_us - self._heard_us > _SILENCE_US:
            self._partner, self._has_partner = self._home, False

    def send(self, message: Any) -> None:
        """Send to the partner."""
        self.link.send(message, self._partner)

    def request_timesync(self, boot_ns: int) -> None:
        """Send a TIMESYNC request if it is time."""
        if not self.requests_timesync or boot_ns < self._next_request_ns:
            return
        self._next_request_ns = boot_ns + _TIMESYNC_NS
        self.send(self.mav.timesync_encode(*self.timesync.request(boot_ns)))

    def time(self, message: Any, peer: Any, arrival_ns: int, boot_ns: int) -> None:
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
            self.link.send(self.mav.timesync_encode(*answer), peer)

    def next_ns(self) -> int:
        """Return when something is due next [ns since boot]."""
        due = [self.streams.next_us * 1000]
        if self.requests_timesync:
            due.append(self._next_request_ns)
        if self.list.due_us is not None:
            due.append(self.list.due_us * 1000)
        return min(due)
