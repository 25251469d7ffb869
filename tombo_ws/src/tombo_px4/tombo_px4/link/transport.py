"""Transport of bytes: the common interface of UDP, TCP and serial ports; none blocks."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.address import Address, Url

Clock = Callable[[], int]
"""Time now, CLOCK_REALTIME [ns]."""

Counters = dict[str, int]

CHUNK = 4096
"""Most bytes of a stream that are read at once."""

_ROOM = 1 << 18


class Packet(NamedTuple):
    """Received bytes: a datagram, or a piece of a stream (empty: the stream ended)."""

    data: bytes
    arrival_ns: int
    peer: Any


class Transport(Protocol):
    """An open transport."""

    stream: bool
    """It carries a stream, not datagrams."""

    address: Address | None
    """Where it listens or sends from."""

    peer: Any
    """Peer to answer; None: not known yet."""

    @property
    def connected(self) -> bool:
        """There is a peer to send to."""
        ...

    def fileno(self) -> int:
        """Return what select() can wait on, the same one until it is closed."""
        ...

    def read(self) -> Packet | None:
        """Return what came next; None: nothing more for now."""
        ...

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""
        ...

    def maintain(self) -> None:
        """Do what is due: connect again."""
        ...

    def due_ns(self) -> int | None:
        """Return the time until `maintain` has something to do; None: it never has."""
        ...

    def close(self) -> None:
        """Close all sockets or files."""
        ...


class RetryTimer:
    """Timer for repeated attempts, by a clock that may be set back."""

    def __init__(self, clock: Clock, period_ns: int = SECOND_NS // 2) -> None:
        self._clock = clock
        self._period_ns = period_ns
        self._last_ns: int | None = None

    def now(self) -> None:
        """Note that it is being tried now."""
        self._last_ns = self._clock()

    def due_ns(self) -> int:
        """Return the time until the next try, 0 if it is due."""
        if self._last_ns is None:
            return 0
        waited = self._clock() - self._last_ns
        return max(0, self._period_ns - waited) if waited >= 0 else 0


class SendBuffer:
    """Buffer for sending: a frame is sent whole or not at all."""

    def __init__(self) -> None:
        self._waiting = bytearray()

    def __bool__(self) -> bool:
        return bool(self._waiting)

    def push(self, data: bytes, write: Callable[[bytes], int]) -> bool:
        """Write a frame behind what waits; False: there is no room for it.

        Raises:
            OSError: the connection is broken.
        """
        if len(self._waiting) + len(data) > _ROOM:
            self.flush(write)
            if len(self._waiting) + len(data) > _ROOM:
                return False
        self._waiting += data
        self.flush(write)
        return True

    def flush(self, write: Callable[[bytes], int]) -> None:
        """Write what waits, as far as there is room.

        Raises:
            OSError: the connection is broken.
        """
        while self._waiting:
            try:
                written = write(bytes(self._waiting[:65536]))
            except (BlockingIOError, InterruptedError):
                return
            del self._waiting[:written]


def refused(url: Url, doing: str, error: Exception, accepted: str) -> InputError:
    """Build the error for a transport that can't be opened."""
    number = getattr(error, "errno", None)
    why = os.strerror(number).lower() if isinstance(number, int) and number > 0 else str(error)
    return InputError(f"link '{url.text}': can't {doing} ({why}); accepted: {accepted}")
