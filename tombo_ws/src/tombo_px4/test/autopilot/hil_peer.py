"""PX4's side of the simulator link for the tests: after its start it arms, and pushes evenly.

Polled; run as a program it is a peer of its own:

    python hil_peer.py PORT SECONDS
"""

from __future__ import annotations

import contextlib
import select
import socket
import sys
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import common

ALIGN = 100
"""Steps before it arms."""
PUSH = 0.6
"""Control of each motor once it is armed; 0.46 hovers."""


class Peer:
    """PX4's side of the socket."""

    def __init__(self, port: int, silent: int = 9, align: int = ALIGN) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout=5.0)
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self.socket.setblocking(False)
        self.silent, self.align = silent, align
        """So many HIL_SENSOR go unanswered first, as when PX4 boots; their number until it
        arms."""
        self.out = common.MAVLink(None, srcSystem=1, srcComponent=1)
        self.parser = common.MAVLink(None)
        self.answer: Callable[[Any], bytes | None] = self.controls
        self.heard: list[Any] = []
        """All messages, if `keep`."""
        self.keep = False
        self.sensors = self.last_us = 0
        self.gap_us = 0
        """Longest step of time."""
        self.socket.sendall(
            self.out.heartbeat_encode(6, 12, 0, 0, 0).pack(self.out)
            + self.out.command_long_encode(0, 0, 511, 0, 115, 5e3, 0, 0, 0, 0, 0).pack(self.out)
        )

    @property
    def armed(self) -> bool:
        return self.sensors > self.align

    def controls(
        self,
        sensor: Any,
        values: tuple[float, ...] | None = None,
        shift_us: int = 0,
        armed: bool | None = None,
    ) -> bytes:
        armed = self.armed if armed is None else armed
        values = 4 * (PUSH if armed else 0.0,) if values is None else values
        padded = [*values, *(16 - len(values)) * [0.0]]
        mode = 0x81 if armed else 0x01
        time_us = sensor.time_usec + shift_us
        message = self.out.hil_actuator_controls_encode(time_us, padded, mode, 1)
        return bytes(message.pack(self.out))

    def pump(self) -> bool:
        """Take what has come and answer it; False: the simulator has gone."""
        try:
            data = self.socket.recv(65_536)
        except BlockingIOError:
            return True
        except OSError:
            return False
        for message in self.parser.parse_buffer(data) or []:
            if self.keep:
                self.heard.append(message)
            if message.get_type() == "HIL_SENSOR":
                self._sensor(message)
        return bool(data)

    def _sensor(self, message: Any) -> None:
        self.sensors += 1
        self.gap_us = max(self.gap_us, message.time_usec - self.last_us)
        self.last_us = message.time_usec
        data = None if self.sensors <= self.silent else self.answer(message)
        if data is not None:
            self.socket.sendall(data)

    def close(self) -> None:
        self.socket.close()


def main() -> None:
    """Answer until the simulator has gone, or the time is over."""
    port, seconds = int(sys.argv[1]), float(sys.argv[2])
    peer = Peer(port)
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):
        while peer.last_us < 1e6 * seconds:
            select.select([peer.socket], [], [], 1.0)
            if not peer.pump():
                break
    peer.close()


if __name__ == "__main__":
    main()
