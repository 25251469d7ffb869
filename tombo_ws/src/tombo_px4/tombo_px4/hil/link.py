"""The socket of the simulator link: PX4 is its client, one at a time.

The first client that connects is taken for PX4, which speaks at once. While it has said nothing,
others wait beside it, and the first of them that speaks takes its place.

Polled; only `wait` blocks. No received bytes raise an exception.
"""

from __future__ import annotations

import contextlib
import errno
import math
import select
import socket
from typing import Any, NamedTuple

from tombo_dynamics.errors import InputError
from tombo_px4.link.framing import Frame, FrameCounts, StreamFramer, decode

PX4_PORT = 4560
"""Of PX4 instance 0; instance N asks for this port plus N."""
_CONTROLS, _HEARTBEAT, _COMMAND = 93, 0, 76
_SET_MESSAGE_INTERVAL, _HIL_STATE_QUATERNION = 511, 115
_ARMED, _LOCKSTEP = 0x80, 1
_CHUNK = 65_536
_MOST_WAITING = 4
_UNSENT_LIMIT = 1 << 20
"""Bytes that PX4 may leave unread before the connection counts as dead."""


class ActuatorControls(NamedTuple):
    """A HIL_ACTUATOR_CONTROLS."""

    time_us: int
    controls: tuple[float, ...]
    """Of PX4's motors 1 to 4, unchecked."""
    armed: bool
    lockstep: bool


class HilLink:
    """The server's side of PX4's TCP connection.

    Attributes:
        port: the one listened on.
        heartbeats: how many have come.
        interval_us: what PX4 asked for by SET_MESSAGE_INTERVAL for HIL_STATE_QUATERNION; None: it
            did not, or `take_interval` has returned it.
        connections: how many there have been.
        refused: connections closed because another client speaks.
    """

    def __init__(self, port: int = PX4_PORT, host: str = "127.0.0.1") -> None:
        """Listen. Port 0 takes a free one.

        Raises:
            InputError: the port is taken or not allowed.
        """
        self._listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            self._listener.bind((host, port))
            self._listener.listen(1)
        except (OSError, OverflowError) as error:
            self._listener.close()
            busy = getattr(error, "errno", None) == errno.EADDRINUSE
            why = "is taken by another program" if busy else f"can't be listened on ({error})"
            raise InputError(
                f"port {port} of {host} {why}; accepted: a free port (PX4 instance N asks for "
                f"{PX4_PORT} + N)"
            ) from error
        self._listener.setblocking(False)
        self.port = int(self._listener.getsockname()[1])
        self._peer: socket.socket | None = None
        self._peer_spoke = False
        self._waiting: list[tuple[socket.socket, StreamFramer]] = []
        self._findings = FrameCounts()
        self._framer = StreamFramer(self._findings)
        self._unsent = b""
        self.interval_us: float | None = None
        self.heartbeats = 0
        self.connections = 0
        self.refused = 0
        self._other = 0

    @property
    def connected(self) -> bool:
        """Whether PX4 is there."""
        return self._peer is not None

    @property
    def counters(self) -> dict[str, int]:
        """Counts of received data other than actuator controls."""
        return {
            "heartbeats": self.heartbeats,
            **self._findings.counts(),
            "other_message": self._other,
            "refused_connections": self.refused,
        }

    def wait(self, timeout_s: float) -> None:
        """Sleep until something comes or the time is over."""
        peers = [] if self._peer is None else [self._peer]
        watched = peers + [waiting for waiting, _ in self._waiting]
        if not self._peer_spoke:
            watched.append(self._listener)
        writing = peers if self._unsent else []
        with contextlib.suppress(InterruptedError):
            select.select(watched, writing, [], max(timeout_s, 0.0))

    def receive(self) -> list[ActuatorControls]:
        """Return the received actuator controls; without a client, accept one."""
        self._flush()
        data = self._read()
        self._accept()
        if self._peer is None and self._waiting:
            self._take_peer(*self._waiting.pop(0))
        frames = list(self._framer.feed(data))
        if self._peer is not None and not self._peer_spoke:
            frames = frames or self._first_to_speak()
            if frames:
                self._peer_spoke = True
                self._refuse_waiting()
        answers = []
        for frame in frames:
            if frame.message_id == _CONTROLS:
                message = decode(frame)
                answers.append(
                    ActuatorControls(
                        int(message.time_usec),
                        tuple(message.controls[:4]),
                        bool(message.mode & _ARMED),
                        bool(message.flags & _LOCKSTEP),
                    )
                )
            elif frame.message_id == _HEARTBEAT:
                self.heartbeats += 1
            elif frame.message_id == _COMMAND:
                self._take_command(decode(frame))
            else:
                self._other += 1
        return answers

    def _take_command(self, message: Any) -> None:
        asked = (message.command, message.param1) == (_SET_MESSAGE_INTERVAL, _HIL_STATE_QUATERNION)
        if asked and math.isfinite(message.param2):
            self.interval_us = message.param2
        else:
            self._other += 1

    def take_interval(self) -> float | None:
        """Return once the interval [us] that PX4 requested for HIL_STATE_QUATERNION."""
        interval_us, self.interval_us = self.interval_us, None
        return interval_us

    def _read(self) -> bytes:
        """Return what has come; a connection that has ended is dropped."""
        if self._peer is None:
            return b""
        try:
            data = self._peer.recv(_CHUNK)
        except (BlockingIOError, InterruptedError):
            return b""
        except OSError:
            data = b""
        if not data:
            self.drop()
        return data

    def send(self, data: bytes) -> None:
        """Send to PX4; what the socket does not take now goes with the next call."""
        if self._peer is None:
            return
        self._unsent += data
        self._flush()
        if len(self._unsent) > _UNSENT_LIMIT:
            self.drop()

    def _flush(self) -> None:
        if not self._unsent or self._peer is None:
            return
        try:
            self._unsent = self._unsent[self._peer.send(self._unsent) :]
        except (BlockingIOError, InterruptedError):
            return
        except OSError:
            self.drop()

    def _accept(self) -> None:
        try:
            peer, _ = self._listener.accept()
        except OSError:
            return
        if self._peer is not None and self._peer_ended():
            self.drop()
        if self._peer is not None and (self._peer_spoke or len(self._waiting) >= _MOST_WAITING):
            peer.close()
            self.refused += 1
            return
        peer.setblocking(False)
        peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        framer = StreamFramer(self._findings)
        if self._peer is None:
            self._take_peer(peer, framer)
        else:
            self._waiting.append((peer, framer))

    def _take_peer(self, peer: socket.socket, framer: StreamFramer) -> None:
        self._peer, self._framer = peer, framer
        self._peer_spoke = False
        self._unsent = b""
        self.interval_us = None
        self.connections += 1

    def _first_to_speak(self) -> list[Frame]:
        """Return the first frames of a client that waits; it takes the place of the silent one."""
        for place in list(self._waiting):
            client, framer = place
            try:
                data = client.recv(_CHUNK)
            except (BlockingIOError, InterruptedError):
                continue
            except OSError:
                data = b""
            frames = list(framer.feed(data))
            if frames or not data:
                self._waiting.remove(place)
            if frames:
                self.drop()
                self._take_peer(client, framer)
                return frames
            if not data:
                client.close()
        return []

    def _refuse_waiting(self) -> None:
        for client, _ in self._waiting:
            client.close()
        self.refused += len(self._waiting)
        self._waiting.clear()

    def _peer_ended(self) -> bool:
        """Whether the connection has ended, after all that has been read: PX4 was restarted."""
        try:
            return self._peer is None or not self._peer.recv(1, socket.MSG_PEEK)
        except (BlockingIOError, InterruptedError):
            return False
        except OSError:
            return True

    def drop(self) -> None:
        """Close the connection; the next client can connect."""
        if self._peer is not None:
            self._peer.close()
            self._peer = None
            self._peer_spoke = False
        self._unsent = b""

    def close(self) -> None:
        """Close all."""
        self.drop()
        self._refuse_waiting()
        self._listener.close()
