"""The simulated motion capture as PX4's on-board link gets it: ODOMETRY over UDP.

For a real PX4 without the ROS bridge.
"""

from __future__ import annotations

from collections.abc import Sequence

from tombo_px4.hil.flight import odometry
from tombo_px4.link.link_params import ONBOARD
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.message_encoder import heartbeat, timesync
from tombo_px4.link.timesync import TimeSync
from tombo_sim.simulator import PoseSample

_HEARTBEAT_US = 1_000_000


class MocapFeed:
    """Sends poses, and answers TIMESYNC with the clock of their stamps: PX4's own, by lockstep."""

    def __init__(self, link: Link) -> None:
        self._link = link
        self._timesync = TimeSync()
        self._beat_us = -_HEARTBEAT_US
        self.sent = 0
        self.answered = 0
        """TIMESYNC requests."""

    def advance(self, poses: Sequence[PoseSample], time_us: int) -> None:
        """Send poses that have arrived, and answer what has come; `time_us` is PX4's clock."""
        for received in self._link.receive():
            message = received.message
            if message.get_type() != "TIMESYNC":
                continue
            now_ns = 1000 * time_us
            times = self._timesync.answer(message.tc1, message.ts1, now_ns, now_ns)
            if times is not None:
                self.answered += self._link.send(timesync(times), received.peer)
        if not 0 <= time_us - self._beat_us < _HEARTBEAT_US:  # below 0: a new flight
            self._beat_us = time_us
            self._link.send(heartbeat(ONBOARD))
        for pose in poses:
            self.sent += self._link.send(odometry(pose))

    def close(self) -> None:
        """Close the link."""
        self._link.close()
