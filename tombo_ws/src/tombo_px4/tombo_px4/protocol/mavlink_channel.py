"""One link of the endpoint and its state: clock, and which messages are due when."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from pymavlink.dialects.v20 import common as mavlink

from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.timesync import TimeSync
from tombo_px4.protocol.parameter_protocol import ParameterServer

_DEFAULT_HZ: dict[str, dict[str, float]] = {
    # As measured on the on-board link of PX4 1.17 (SITL).
    "onboard": {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 100.0,
        "ATTITUDE_QUATERNION": 50.0,
        "HIGHRES_IMU": 50.0,
        "LOCAL_POSITION_NED": 30.0,
        "ODOMETRY": 30.0,
        "GLOBAL_POSITION_INT": 50.0,
        "ATTITUDE_TARGET": 10.0,
        "VFR_HUD": 10.0,
        "SYS_STATUS": 5.0,
        "EXTENDED_SYS_STATE": 5.0,
        "GPS_RAW_INT": 5.0,
        "ESTIMATOR_STATUS": 1.0,
        "HOME_POSITION": 0.4,
        "BATTERY_STATUS": 0.4,
    },
    "ground": {
        "HEARTBEAT": 1.0,
        "ATTITUDE": 20.0,
        "ATTITUDE_QUATERNION": 10.0,
        "LOCAL_POSITION_NED": 10.0,
        "GLOBAL_POSITION_INT": 5.0,
        "VFR_HUD": 4.0,
        "ATTITUDE_TARGET": 2.0,
        "SYS_STATUS": 1.0,
        "EXTENDED_SYS_STATE": 1.0,
        "GPS_RAW_INT": 1.0,
        "ESTIMATOR_STATUS": 0.5,
        "HOME_POSITION": 0.5,
        "BATTERY_STATUS": 0.5,
    },
}
_SHORTEST_US = 4_000
"""As fast as PX4 publishes its state: 250 Hz."""
_NEVER = 2**63
_STAGGER_US = 1_000


class StreamTable:
    """When each message of a link is due. Time is the vehicle's, in us since boot."""

    def __init__(self, stream_set: str, offered: Mapping[int, str], boot_us: int) -> None:
        """Begin with the default rates.

        Args:
            stream_set: `onboard` or `ground`.
            offered: number and name of every message that can be sent.
            boot_us: time now.
        """
        numbers = {name: number for number, name in offered.items()}
        self._offered = offered
        self._default = {
            numbers[name]: round(1e6 / rate) for name, rate in _DEFAULT_HZ[stream_set].items()
        }
        self._interval = dict(self._default)
        self._due = {number: boot_us + i * _STAGGER_US for i, number in enumerate(self._interval)}
        self.next_us = min(self._due.values())
        """When the next message is due."""

    def take_due(self, boot_us: int) -> list[int]:
        """Return the messages that are due now; each is due again after its interval."""
        if boot_us < self.next_us:
            return []
        numbers = []
        for number, due in self._due.items():
            if due <= boot_us:
                interval = self._interval[number]
                # what was missed is not made up for
                self._due[number] = (due if due + interval > boot_us else boot_us) + interval
                numbers.append(number)
        self._find_next()
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
        if number not in self._offered or number == mavlink.MAVLINK_MSG_ID_HEARTBEAT:
            return False
        if abs(interval_us) < 1e-5:
            wanted = self._default.get(number, 0)
        elif interval_us < 0.0:
            wanted = 0
        else:
            wanted = round(min(max(interval_us, _SHORTEST_US), 1e12))
        if wanted:
            self._interval[number] = wanted
            self._due[number] = min(self._due.get(number, boot_us), boot_us + wanted)
        else:
            self._interval.pop(number, None)
            self._due.pop(number, None)
        self._find_next()
        return True

    def _find_next(self) -> None:
        self.next_us = min(self._due.values(), default=_NEVER)


_TIMESYNC_NS = 100_000_000
_LIST_US = 5_000
"""Between two batches of parameters."""
_STATION_US = 2_500_000
"""A ground station that has been silent for so long has gone."""


class MavlinkChannel:
    """A link, its streams, the list of parameters under way, and the clock of the other side."""

    def __init__(
        self, link: Link, stream_set: str, offered: Mapping[int, str], boot_us: int
    ) -> None:
        """Begin with the streams of a set.

        Args:
            link: over which all goes.
            stream_set: `onboard` or `ground`.
            offered: number and name of every message that can be sent.
            boot_us: time now.
        """
        self.link = link
        self._station_us = -_STATION_US
        self.mav = link.mav
        self.streams = StreamTable(stream_set, offered, boot_us)
        self._list: Iterator[list[Any]] | None = None
        """Batches of the parameters that are being sent; None: nobody asked."""
        self._list_us = 0
        self.timesync = TimeSync()
        self.requests_timesync = stream_set == "onboard"
        self._next_request_ns = 0

    def hear_station(self, boot_us: int) -> None:
        """Record the heartbeat of a ground station."""
        self._station_us = boot_us

    def hears_station(self, boot_us: int) -> bool:
        """Return whether a ground station is there: without one PX4 sends no texts."""
        return boot_us - self._station_us < _STATION_US

    def begin_list(self, parameters: ParameterServer) -> None:
        """Send all parameters; asked again meanwhile, begin again."""
        self._list = parameters.batches(self.mav)

    def send_list(self, boot_us: int) -> None:
        """Send the next batch of the parameters if it is due."""
        if self._list is None or boot_us < self._list_us:
            return
        self._list_us = boot_us + _LIST_US
        batch = next(self._list, None)
        if batch is None:
            self._list = None
        for message in batch or ():
            self.link.send(message)

    def request_timesync(self, boot_ns: int) -> None:
        """Send a TIMESYNC request if it is time."""
        if not self.requests_timesync or boot_ns < self._next_request_ns:
            return
        self._next_request_ns = boot_ns + _TIMESYNC_NS
        self.link.send(self.mav.timesync_encode(*self.timesync.request(boot_ns)))

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
        if self._list is not None:
            due.append(self._list_us * 1000)
        return min(due)
