"""UDP: datagrams with the kernel's arrival stamps."""

from __future__ import annotations

import contextlib
import socket
import struct
from typing import Any

from tombo_control.px4.address import Address, Url, is_loopback
from tombo_control.px4.transport import Clock, Counters, Packet, refused

MAX_DATAGRAM = 2048
"""Longest datagram that is taken whole; MAVLink's fit into a packet of the network."""

_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40
_TRUNCATED = int(socket.MSG_TRUNC)
_STAMP = struct.Struct("@qq")
_COUNT = struct.Struct("@I")
_ROOM = socket.CMSG_SPACE(_STAMP.size) + socket.CMSG_SPACE(_COUNT.size)
_BUFFER = 1 << 20


class Udp:
    """A UDP socket, listening or sending to one address."""

    stream = False

    def __init__(
        self,
        url: Url,
        clock: Clock,
        counters: Counters,
        allow_remote: bool,
        peer: Address | None,
    ) -> None:
        self._clock = clock
        self._counters = counters
        self._foreign = allow_remote
        self._listens = url.kind == "udpin"
        self._overflowed = 0
        self.peer: Any = peer
        self._socket = socket.socket(url.family, socket.SOCK_DGRAM)
        try:
            self._open(url)
        except (OSError, OverflowError) as error:
            self._socket.close()
            if self._listens:
                raise refused(url, "listen there", error, "a free port of this machine") from error
            accepted = "a host this machine can reach and a free local port"
            raise refused(url, "send there", error, accepted) from error

    def _open(self, url: Url) -> None:
        sock = self._socket
        sock.setblocking(False)
        for option in (_SO_TIMESTAMPNS, _SO_RXQ_OVFL):
            with contextlib.suppress(OSError):
                sock.setsockopt(socket.SOL_SOCKET, option, 1)
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _BUFFER)
        if self._listens:
            sock.bind(url.address)
        else:
            if url.local:
                anywhere = "::" if url.family == socket.AF_INET6 else "0.0.0.0"
                sock.bind((url.host if is_loopback(url.host) else anywhere, url.local))
            # The kernel itself then keeps everybody else out.
            sock.connect(url.address)
            self.peer = url.address
        name = sock.getsockname()
        self.address: Address | None = (name[0], name[1])

    @property
    def connected(self) -> bool:
        """The peer is known."""
        return self.peer is not None

    def fileno(self) -> int:
        """Return what select() can wait on."""
        return self._socket.fileno()

    def read(self) -> Packet | None:
        """Return the next datagram; None: nothing more for now."""
        try:
            data, ancillary, flags, sender = self._socket.recvmsg(MAX_DATAGRAM, _ROOM)
        except BlockingIOError:
            return None
        except OSError:  # told by the network that nobody listens there: the next read goes on
            return Packet(b"", 0, None)
        arrival = 0
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS and len(value) == _STAMP.size:
                seconds, rest = _STAMP.unpack(value)
                arrival = seconds * 1_000_000_000 + rest
            elif kind == _SO_RXQ_OVFL and len(value) == _COUNT.size:
                (total,) = _COUNT.unpack(value)
                self._counters["dropped"] += (total - self._overflowed) & 0xFFFFFFFF
                self._overflowed = total
        if not self._foreign and not is_loopback(sender[0]):
            self._counters["foreign_address"] += 1
            return Packet(b"", 0, None)
        if flags & _TRUNCATED:
            self._counters["oversized"] += 1
            return Packet(b"", 0, None)
        return Packet(data, arrival or self._clock(), sender)

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""
        peer = peer or self.peer
        if peer is None:
            return "no_peer"
        try:
            if self._listens:
                self._socket.sendto(data, peer)
            else:
                self._socket.send(data)
        except (OSError, TypeError, ValueError):
            return "send_failed"
        return ""

    def tend(self) -> None:
        """Do nothing: there is no connection."""

    def due_ns(self) -> int | None:
        """Return that nothing is ever due."""
        return None

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()
