"""The simulator link: PX4 is the client of a TCP server, one at a time.

The first client that connects is taken for PX4, which speaks at once. While it has said nothing,
others wait beside it, and the first of them that speaks takes its place.
"""

from __future__ import annotations

import errno
import math
import select
import socket
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common as mav

from tombo_dynamics.errors import InputError
from tombo_px4.link.framing import Frame, FrameCounts, StreamFramer, decode
from tombo_px4.link.tcp import TcpIn
from tombo_px4.link.transport import Url

PX4_PORT = 4560
"""Of PX4 instance 0; instance N asks for this port plus N."""
_MOST_WAITING = 4


class ActuatorControls(NamedTuple):
    """A HIL_ACTUATOR_CONTROLS."""

    time_us: int
    controls: tuple[float, ...]
    """Of PX4's motors 1 to 4, unchecked."""
    armed: bool
    lockstep: bool


class HilLink(TcpIn):
    """The server's side of PX4's TCP connection. Polled; only `wait` blocks.

    Attributes:
        port: the one listened on.
        heartbeats: how many have come.
        interval_us: what PX4 asked for by SET_MESSAGE_INTERVAL for HIL_STATE_QUATERNION; None: it
            did not, or `take_interval` has returned it.
        connections: how many there have been.
        refused: connections closed because another client speaks.
    """

    room = 1 << 20

    def __init__(self, port: int = PX4_PORT) -> None:
        """Listen on this machine. Port 0 takes a free one.

        Raises:
            InputError: the port is taken or not allowed.
        """
        url = Url(f"tcpin://127.0.0.1:{port}", "tcpin", "127.0.0.1", port)
        try:
            super().__init__(url, lambda: 0, {"foreign_address": 0}, False)
        except (InputError, OverflowError) as error:
            cause = error.__cause__ or error
            busy = getattr(cause, "errno", None) == errno.EADDRINUSE
            why = "is taken by another program" if busy else f"can't be listened on ({cause})"
            raise InputError(
                f"port {port} of {url.host} {why}; accepted: a free port (PX4 instance N asks for "
                f"{PX4_PORT} + N)"
            ) from error
        self.port = int(self._listener.getsockname()[1])
        self._counts = FrameCounts()
        self._framers: dict[Any, StreamFramer] = {}
        self.interval_us: float | None = None
        self.heartbeats = 0
        self.connections = 0
        self.refused = 0
        self._other = 0

    @property
    def connected(self) -> bool:
        """Whether PX4 is there."""
        return self._connection(self._peer) is not None

    @property
    def counters(self) -> dict[str, int]:
        """Counts of received data other than actuator controls."""
        return {
            "heartbeats": self.heartbeats,
            **self._counts.counts(),
            "other_message": self._other,
            "refused_connections": self.refused,
        }

    def wait(self, timeout_s: float) -> None:
        """Sleep until something comes or the time is over."""
        select.select([self.fileno()], (), (), max(timeout_s, 0.0))

    def receive(self) -> list[ActuatorControls]:
        """Return the received actuator controls; without PX4, take the first client for it."""
        frames = self._receive_frames()
        if not self.connected and self._connections:
            self._take_peer(next(iter(self._connections.values())).peer)
        if self.connected and not self._peer_spoke:
            clients = [c.peer for c in self._connections.values() if frames.get(c.peer)]
            speaks = self._peer if self._peer in clients else next(iter(clients), None)
            if speaks is not None:
                if speaks != self._peer:
                    self._close(self._peer)
                    self._take_peer(speaks)
                self.peer = speaks
                others = [c.peer for c in self._connections.values() if c.peer != speaks]
                self.refused += len(others)
                for other in others:
                    self._close(other)
        answers = []
        for frame in frames.get(self._peer, ()):
            if frame.message_id == mav.MAVLINK_MSG_ID_HIL_ACTUATOR_CONTROLS:
                message = decode(frame)
                answers.append(
                    ActuatorControls(
                        int(message.time_usec),
                        tuple(message.controls[:4]),
                        bool(message.mode & mav.MAV_MODE_FLAG_SAFETY_ARMED),
                        bool(message.flags & mav.HIL_ACTUATOR_CONTROLS_FLAGS_LOCKSTEP),
                    )
                )
            elif frame.message_id == mav.MAVLINK_MSG_ID_HEARTBEAT:
                self.heartbeats += 1
            elif frame.message_id == mav.MAVLINK_MSG_ID_COMMAND_LONG:
                self._take_command(decode(frame))
            else:
                self._other += 1
        return answers

    def _receive_frames(self) -> dict[Any, list[Frame]]:
        """Return client -> frames, of one piece of each stream at most."""
        frames: dict[Any, list[Frame]] = {}
        packet = self.read()
        while packet is not None:
            if packet.data:
                framer = self._framers.setdefault(packet.peer, StreamFramer(self._counts))
                frames[packet.peer] = framer.feed(packet.data)
            else:
                self._framers.pop(packet.peer, None)
            packet = self.read() if self._ready or self._ended else None
        return frames

    def _take_command(self, message: Any) -> None:
        wanted = (mav.MAV_CMD_SET_MESSAGE_INTERVAL, mav.MAVLINK_MSG_ID_HIL_STATE_QUATERNION)
        if (message.command, message.param1) == wanted and math.isfinite(message.param2):
            self.interval_us = message.param2
        else:
            self._other += 1

    def take_interval(self) -> float | None:
        """Return once the interval [us] that PX4 requested for HIL_STATE_QUATERNION."""
        interval_us, self.interval_us = self.interval_us, None
        return interval_us

    def send(self, data: bytes) -> None:
        """Send to PX4; what the socket does not take now goes later, too much of it ends it."""
        if self.write(data, self._peer) == "send_failed":
            self._close(self._peer)

    @property
    def _peer_spoke(self) -> bool:
        connection = self._connection(self._peer)
        return connection is not None and connection.spoke

    def _refuses(self, peer: Any) -> bool:
        if self._peer_spoke and self._peer_ended():
            self._close(self._peer)
        refuses = self._peer_spoke or len(self._connections) > _MOST_WAITING
        self.refused += refuses
        return refuses

    def _peer_ended(self) -> bool:
        """Whether the connection has ended, after all that has been read: PX4 was restarted."""
        connection = self._connection(self._peer)
        try:
            return connection is None or not connection.socket.recv(1, socket.MSG_PEEK)
        except BlockingIOError:
            return False
        except OSError:
            return True

    def _take_peer(self, peer: Any) -> None:
        self._peer = peer
        self.interval_us = None
        self.connections += 1

    def _close(self, peer: Any) -> None:
        """Close a client's connection; the next one can connect."""
        for number in [n for n, c in self._connections.items() if c.peer == peer]:
            self._drop(number)
