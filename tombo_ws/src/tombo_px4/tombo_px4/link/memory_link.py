"""A MAVLink link between two ends in one process: no socket, no clock."""

from __future__ import annotations

from collections import deque
from typing import Any

from pymavlink.dialects.v20 import common

from tombo_dynamics.time_base import EPOCH_NS
from tombo_px4.link.mavlink_link import Received


class MemoryLink:
    """One end of a link within the process; as much of `mavlink_link.Link` as is used here."""

    def __init__(self, system: int, component: int) -> None:
        self.mav = common.MAVLink(None, srcSystem=system, srcComponent=component)
        self.now_ns = EPOCH_NS
        """Time that arrivals are stamped with; the owner sets it."""
        self._parser = common.MAVLink(None)
        self._other: MemoryLink | None = None
        self._came: deque[Received] = deque()

    @classmethod
    def pair(cls, here: tuple[int, int], there: tuple[int, int]) -> tuple[MemoryLink, MemoryLink]:
        """Return both ends of a link between two systems and components."""
        ends = cls(*here), cls(*there)
        ends[0]._other, ends[1]._other = ends[1], ends[0]
        return ends

    def send(self, message: Any, to: Any = None) -> bool:
        """Send a message; it is there at once."""
        assert self._other is not None
        self._other.arrive(bytes(message.pack(self.mav)), self.mav)
        self.mav.seq = (self.mav.seq + 1) % 256
        return True

    def arrive(self, data: bytes, sender: Any) -> None:
        """Take the bytes of one message."""
        for message in self._parser.parse_buffer(bytearray(data)) or ():
            ids = (sender.srcSystem, sender.srcComponent)
            self._came.append(Received(message, self.now_ns, *ids, None))

    def receive(self, limit: int = 200) -> list[Received]:
        """Return the messages that have come."""
        return [self._came.popleft() for _ in range(min(limit, len(self._came)))]

    def close(self) -> None:
        """Forget what has come."""
        self._came.clear()
