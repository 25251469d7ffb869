"""Transport of bytes: the common interface of UDP, TCP and serial ports; none blocks."""

from __future__ import annotations

import contextlib
import os
import select
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, NamedTuple

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


class Transport(ABC):
    """An open transport."""

    stream = False
    """It carries a stream, not datagrams."""

    address: Address | None = None
    """Where it listens or sends from."""

    peer: Any
    """Peer to answer; None: not known yet."""

    @property
    def connected(self) -> bool:
        """There is a peer to send to."""
        return True

    @abstractmethod
    def fileno(self) -> int:
        """Return what select() can wait on, the same one until it is closed."""

    @abstractmethod
    def read(self) -> Packet | None:
        """Return what came next; None: nothing more for now."""

    @abstractmethod
    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""

    def maintain(self) -> None:
        """Do what is due: connect again; by default nothing."""
        return

    def due_ns(self) -> int | None:
        """Return the time until `maintain` has something to do; None: it has nothing."""
        return None

    @abstractmethod
    def close(self) -> None:
        """Close all sockets or files."""


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
    """Buffer for sending on a watched file: a frame is sent whole or not at all."""

    def __init__(self, watch: select.epoll, number: int, write: Callable[[bytes], int]) -> None:
        """Watch the file for what comes, and for room while something waits.

        Args:
            watch: where it is registered; unregistering it is up to the caller.
            number: of the file.
            write: writes to it as far as there is room.
        """
        self._watch = watch
        self._number = number
        self._write = write
        self._waiting = bytearray()
        self._full = False
        watch.register(number, select.EPOLLIN)

    def push(self, data: bytes) -> bool:
        """Write a frame behind what waits; False: there is no room for it.

        Raises:
            OSError: the connection is broken.
        """
        if len(self._waiting) + len(data) > _ROOM:
            self.flush()
            if len(self._waiting) + len(data) > _ROOM:
                return False
        self._waiting += data
        self.flush()
        return True

    def flush(self) -> None:
        """Write what waits, as far as there is room.

        Raises:
            OSError: the connection is broken.
        """
        with contextlib.suppress(BlockingIOError, InterruptedError):
            while self._waiting:
                del self._waiting[: self._write(bytes(self._waiting[:65536]))]
        if bool(self._waiting) != self._full:
            self._full = not self._full
            room = select.EPOLLOUT if self._full else 0
            self._watch.modify(self._number, select.EPOLLIN | room)


def refused(url: Url, doing: str, error: Exception, accepted: str) -> InputError:
    """Build the error for a transport that can't be opened."""
    number = getattr(error, "errno", None)
    why = os.strerror(number).lower() if isinstance(number, int) and number > 0 else str(error)
    return InputError(f"link '{url.text}': can't {doing} ({why}); accepted: {accepted}")
