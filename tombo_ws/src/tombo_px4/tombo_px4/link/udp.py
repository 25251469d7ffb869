"""UDP: datagrams with the kernel's arrival stamps, and a queue for each partner."""

from __future__ import annotations

import contextlib
import select
import socket
import struct
from collections import deque
from functools import partial
from typing import Any

from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link.transport import (
    Address,
    Clock,
    Counters,
    Packet,
    Transport,
    Url,
    is_loopback,
    refused,
)

MAX_DATAGRAM = 2048
"""Longest datagram that is taken whole; MAVLink's fit into a packet of the network."""

MAX_PARTNERS = 4
"""Partners that have a queue of their own; a fifth takes the place of the most silent."""

_SO_TIMESTAMPNS = 35
_SO_RXQ_OVFL = 40
_TRUNCATED = int(socket.MSG_TRUNC)
_STAMP = struct.Struct("@qq")
_COUNT = struct.Struct("@I")
_ROOM = socket.CMSG_SPACE(_STAMP.size) + socket.CMSG_SPACE(_COUNT.size)
_BUFFER = 1 << 20
_QUEUED = 4096
"""More datagrams than a buffer holds."""


class _Queue:
    """A socket whose datagrams come with their stamps, and with the count of those lost."""

    def __init__(
        self, family: socket.AddressFamily, clock: Clock, counters: Counters, foreign: bool
    ) -> None:
        self.socket = socket.socket(family, socket.SOCK_DGRAM)
        self._clock = clock
        self._counters = counters
        self._foreign = foreign
        self._overflowed = 0
        self.socket.setblocking(False)
        for option, value in (
            (_SO_TIMESTAMPNS, 1),
            (_SO_RXQ_OVFL, 1),
            (socket.SO_RCVBUF, _BUFFER),
        ):
            with contextlib.suppress(OSError):
                self.socket.setsockopt(socket.SOL_SOCKET, option, value)

    def read(self) -> Packet | None:
        """Return the next datagram; None: nothing more for now."""
        try:
            data, ancillary, flags, sender = self.socket.recvmsg(MAX_DATAGRAM, _ROOM)
        except BlockingIOError:
            return None
        except OSError:  # told by the network that nobody listens there: the next read goes on
            return Packet(b"", 0, None)
        arrival = 0
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS and len(value) == _STAMP.size:
                seconds, rest = _STAMP.unpack(value)
                arrival = seconds * SECOND_NS + rest
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


class UdpOut(Transport):
    """A UDP socket connected to one address; the kernel drops datagrams of others."""

    def __init__(self, url: Url, clock: Clock, counters: Counters, allow_remote: bool) -> None:
        self._queue = _Queue(url.family, clock, counters, allow_remote)
        self._socket = self._queue.socket
        try:
            if url.local:
                anywhere = "::" if url.family == socket.AF_INET6 else "0.0.0.0"
                self._socket.bind((url.host if is_loopback(url.host) else anywhere, url.local))
            self._socket.connect(url.address)
        except OSError as error:
            self.close()
            accepted = "a host this machine can reach and a free local port"
            raise refused(url, "send there", error, accepted) from error
        self.peer: Any = url.address
        self.address: Address | None = self._socket.getsockname()[:2]

    def fileno(self) -> int:
        """Return what select() can wait on."""
        return self._socket.fileno()

    def read(self) -> Packet | None:
        """Return the next datagram; None: nothing more for now."""
        return self._queue.read()

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""
        try:
            self._socket.send(data)
        except OSError:
            return "send_failed"
        return ""

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()


class UdpIn(Transport):
    """A UDP listener. It answers the last accepted sender.

    Each such partner gets a socket of its own on the same port, connected to it: the kernel sorts
    the partner's datagrams into that one's queue, and a flood from elsewhere, which fills the
    listener's, costs the partner neither a message nor time.
    """

    def __init__(
        self, url: Url, clock: Clock, counters: Counters, allow_remote: bool, peer: Address | None
    ) -> None:
        self._make = partial(_Queue, url.family, clock, counters, allow_remote)
        self._listener = self._make()
        self._partners: dict[Any, _Queue] = {}
        self._turns: deque[_Queue] = deque()
        self._new: _Queue | None = None
        self._backlog = 0
        self._quiet = False
        self._peer: Any = peer
        self._watch = select.epoll()
        try:
            self._listener.socket.bind(url.address)
        except OSError as error:
            self.close()
            raise refused(url, "listen there", error, "a free port of this machine") from error
        self._name = self._listener.socket.getsockname()
        self.address: Address | None = self._name[:2]
        self._watch.register(self._listener.socket.fileno(), select.EPOLLIN)

    @property
    def peer(self) -> Any:
        """Peer to answer; None: not known yet."""
        return self._peer

    @peer.setter
    def peer(self, peer: Any) -> None:
        self._peer = peer
        if peer in self._partners:
            self._partners[peer] = self._partners.pop(peer)  # the last one sent last
        elif self._new is None:
            with contextlib.suppress(OSError):
                self._add_partner(peer)

    @property
    def connected(self) -> bool:
        """The peer is known."""
        return self._peer is not None

    def fileno(self) -> int:
        """Return what select() can wait on."""
        return self._watch.fileno()

    def read(self) -> Packet | None:
        """Return the next datagram, of the partners first; None: nothing more for now."""
        if not self._quiet:
            for _ in range(len(self._turns)):
                packet = self._turns[0].read()
                self._turns.rotate(-1)
                if packet is not None:
                    return packet
            self._quiet = True
        packet = self._listener.read()
        if self._new is not None:
            # What the new one had sent before it got its queue is read before what is in that.
            self._backlog -= 1
            if packet is None or self._backlog <= 0:
                self._turns.append(self._new)
                self._new = None
                self._quiet = False
                return packet or self.read()
        return packet

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""
        peer = peer or self._peer
        if peer is None:
            return "no_peer"
        try:
            self._listener.socket.sendto(data, peer)
        except (OSError, TypeError, ValueError):
            return "send_failed"
        return ""

    def maintain(self) -> None:
        """Begin with the partners again."""
        self._quiet = False

    def close(self) -> None:
        """Close every socket."""
        for queue in (self._listener, *self._partners.values()):
            queue.socket.close()
        self._watch.close()

    def _add_partner(self, peer: Any) -> None:
        """Open a queue for a partner.

        Raises:
            OSError: the kernel refuses.
        """
        queue = self._make()
        queues = (self._listener, *self._partners.values(), queue)
        sockets = [entry.socket for entry in queues]
        try:
            # Only now may another socket have this port: busy means busy to everybody else.
            for sock in sockets:
                sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            try:
                queue.socket.bind(self._name)
                queue.socket.connect(peer)
            finally:
                for sock in sockets:
                    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 0)
            self._watch.register(queue.socket.fileno(), select.EPOLLIN)
        except OSError:
            queue.socket.close()
            raise
        if len(self._partners) >= MAX_PARTNERS:
            silent = self._partners.pop(next(iter(self._partners)))
            self._turns.remove(silent)
            silent.socket.close()
        self._partners[peer] = self._new = queue
        self._backlog = _QUEUED
