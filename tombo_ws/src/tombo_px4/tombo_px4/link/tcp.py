"""TCP, both ways: a server with a few clients, and a client that keeps trying."""

from __future__ import annotations

import contextlib
import errno
import select
import socket
from typing import Any

from tombo_px4.link.transport import (
    CHUNK,
    ROOM,
    Clock,
    Counters,
    Packet,
    RetryTimer,
    SendBuffer,
    Transport,
    Url,
    is_loopback,
    refused,
)

MAX_CLIENTS = 4
_CONNECT_NS = 5_000_000_000


class Connection:
    """A connected socket, watched by an epoll."""

    def __init__(self, sock: socket.socket, peer: Any, watch: select.epoll, room: int) -> None:
        self.socket = sock
        self.peer = peer
        self.spoke = False
        self._watch = watch
        with contextlib.suppress(OSError):
            sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.out = SendBuffer(watch, sock.fileno(), sock.send, room)

    def read(self) -> bytes | None:
        """Return some bytes; b"": it has ended; None: nothing more for now."""
        try:
            return self.socket.recv(CHUNK)
        except BlockingIOError:
            return None
        except OSError:
            return b""

    def close(self) -> None:
        """Close the socket."""
        with contextlib.suppress(OSError, ValueError):
            self._watch.unregister(self.socket.fileno())
        self.socket.close()


class _Streams(Transport):
    """Some connections behind one descriptor that select() can wait on."""

    stream = True
    room = ROOM
    """Most bytes that wait for one of them."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._watch = select.epoll()
        self._connections: dict[int, Connection] = {}
        self._ready: list[tuple[int, int]] = []
        self._ended: list[Any] = []
        self._peer: Any = None

    @property
    def peer(self) -> Any:
        """Whom to answer: the last accepted sender, else who is there."""
        return self._peer

    @peer.setter
    def peer(self, peer: Any) -> None:
        if peer != self._peer or not self._connection(peer):
            self._peer = peer
        connection = self._connection(peer)
        if connection:
            connection.spoke = True

    @property
    def connected(self) -> bool:
        """There is a connection."""
        return bool(self._connections)

    def fileno(self) -> int:
        """Return what select() can wait on."""
        return self._watch.fileno()

    def read(self) -> Packet | None:
        """Return the next piece of one of the streams, in turn; None: nothing more for now."""
        if self._ended:
            return Packet(b"", 0, self._ended.pop())
        if not self._ready:
            # connections last, so that they come first: one that has ended makes room
            self._ready = sorted(self._watch.poll(0), key=lambda r: r[0] in self._connections)
        while self._ready:
            number, events = self._ready.pop()
            connection = self._connections.get(number)
            if connection is None:
                self._event(number, events)
                continue
            if events & select.EPOLLOUT:
                connection.out.flush()
            data = b"" if connection.out.broken else connection.read()
            if data:
                return Packet(data, self._clock(), connection.peer)
            if data is not None:
                self._drop(number)
                return Packet(b"", 0, self._ended.pop())
        return None

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""
        connection = self._connection(peer if peer is not None else self._peer)
        if connection is None and peer is None:
            connection = next(iter(self._connections.values()), None)
        if connection is None:
            return "no_peer"
        return "" if connection.out.push(data) else "send_failed"

    def close(self) -> None:
        """Close every socket."""
        for number in list(self._connections):
            self._drop(number)
        self._watch.close()

    def _event(self, number: int, events: int) -> None:
        """Something happened to a socket that is no connection."""

    def _connection(self, peer: Any) -> Connection | None:
        return next((c for c in self._connections.values() if c.peer == peer), None)

    def _add(self, sock: socket.socket, peer: Any) -> None:
        sock.setblocking(False)
        self._connections[sock.fileno()] = Connection(sock, peer, self._watch, self.room)

    def _drop(self, number: int) -> None:
        connection = self._connections.pop(number)
        connection.close()
        self._ended.append(connection.peer)
        if self._peer == connection.peer:
            self._peer = None


class TcpIn(_Streams):
    """A TCP server. It hears a few clients, and answers the last accepted sender."""

    def __init__(self, url: Url, clock: Clock, counters: Counters, allow_remote: bool) -> None:
        super().__init__(clock)
        self._counters = counters
        self._foreign = allow_remote
        self._listener = socket.socket(url.family, socket.SOCK_STREAM)
        try:
            # A server that comes back finds its port although old connections still linger.
            self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            self._listener.setblocking(False)
            self._listener.bind(url.address)
            self._listener.listen(MAX_CLIENTS)
        except OSError as error:
            self.close()
            raise refused(url, "listen there", error, "a free port of this machine") from error
        self.address = self._listener.getsockname()[:2]
        self._watch.register(self._listener.fileno(), select.EPOLLIN)

    def close(self) -> None:
        """Close every socket."""
        self._listener.close()
        super().close()

    def _event(self, number: int, events: int) -> None:
        if number != self._listener.fileno():
            return
        try:
            sock, peer = self._listener.accept()
        except OSError:
            return
        if not self._foreign and not is_loopback(peer[0]):
            self._counters["foreign_address"] += 1
            sock.close()
        elif self._refuses(peer):
            sock.close()
        else:
            self._add(sock, peer)

    def _refuses(self, peer: Any) -> bool:
        """Return whether a client is turned away: a silent one makes room for it."""
        if len(self._connections) < MAX_CLIENTS:
            return False
        silent = [n for n, c in self._connections.items() if not c.spoke]
        if not silent:
            self._counters["dropped"] += 1
            return True
        self._drop(silent[0])
        return False


class TcpOut(_Streams):
    """A TCP client. It connects in the background, and again when the connection is lost."""

    def __init__(self, url: Url, clock: Clock) -> None:
        super().__init__(clock)
        self._url = url
        self._retry = RetryTimer(clock)
        self._patience = RetryTimer(clock, _CONNECT_NS)
        self._trying: socket.socket | None = None
        try:
            self._begin()
        except OSError as error:
            self.close()
            raise refused(url, "connect", error, "a host this machine can reach") from error

    def maintain(self) -> None:
        """Connect if there is no connection."""
        if self._trying is not None:
            if self._patience.due_ns() == 0:
                self._abandon()
        elif not self._connections and self._retry.due_ns() == 0:
            with contextlib.suppress(OSError):
                self._begin()

    def due_ns(self) -> int | None:
        """Return the time until the next try."""
        if self._connections:
            return None
        return (self._retry if self._trying is None else self._patience).due_ns()

    def close(self) -> None:
        """Close the socket."""
        self._abandon()
        super().close()

    def _begin(self) -> None:
        self._retry.now()
        self._patience.now()
        sock = socket.socket(self._url.family, socket.SOCK_STREAM)
        sock.setblocking(False)
        result = sock.connect_ex(self._url.address)
        if result in (0, errno.EINPROGRESS):
            self._trying = sock
            self._watch.register(sock.fileno(), select.EPOLLOUT)
            return
        sock.close()
        if result != errno.ECONNREFUSED:
            raise OSError(result, "connect")

    def _event(self, number: int, events: int) -> None:
        sock = self._trying
        if sock is None or number != sock.fileno():
            return
        if sock.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR) != 0 or _is_itself(sock):
            self._abandon()
            return
        self._trying = None
        self._watch.unregister(number)
        self._retry.now()
        self._add(sock, self._url.address)
        self._peer = self._url.address

    def _abandon(self) -> None:
        if self._trying is not None:
            with contextlib.suppress(OSError, ValueError):
                self._watch.unregister(self._trying.fileno())
            self._trying.close()
            self._trying = None

    def _drop(self, number: int) -> None:
        super()._drop(number)
        self._retry.now()


def _is_itself(sock: socket.socket) -> bool:
    """Whether a socket got connected to itself.

    TCP allows that, and a client that keeps trying a port without a server gets there one day.
    """
    try:
        return bool(sock.getsockname() == sock.getpeername())
    except OSError:
        return True
