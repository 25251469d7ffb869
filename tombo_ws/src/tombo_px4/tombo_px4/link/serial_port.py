"""A serial port that never blocks, and opens again when the cable is plugged in."""

from __future__ import annotations

import contextlib
import os
import select
import termios
import tty
from functools import partial
from typing import Any

from tombo_dynamics.errors import InputError
from tombo_px4.link.address import Url
from tombo_px4.link.transport import (
    CHUNK,
    Clock,
    Packet,
    RetryTimer,
    SendBuffer,
    Transport,
    refused,
)

_SPEEDS = {
    int(name[1:]): getattr(termios, name)
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdecimal() and int(name[1:]) >= 9600
}
_OUTPUT_SPEED, _INPUT_SPEED, _FLAGS = 5, 4, 2


class SerialPort(Transport):
    """A serial port, raw, 8 bits, no parity, no flow control."""

    stream = True

    def __init__(self, url: Url, clock: Clock) -> None:
        self.peer: Any = url.host
        self._url = url
        self._clock = clock
        self._retry = RetryTimer(clock, 1_000_000_000)
        self._out: SendBuffer
        self._port: int | None = None
        if url.port not in _SPEEDS:
            speeds = ", ".join(str(speed) for speed in sorted(_SPEEDS))
            raise InputError(f"link '{url.text}': no baud rate {url.port}; accepted: {speeds}")
        self._watch = select.epoll()
        try:
            self._open()
        except (OSError, termios.error) as error:
            self.close()
            if not isinstance(error, OSError):  # termios has number and words, but no errno
                error = OSError(*error.args)
            raise refused(
                url, "open it", error, "a serial device that this user may read and write"
            ) from error

    @property
    def connected(self) -> bool:
        """The device is there."""
        return self._port is not None

    def fileno(self) -> int:
        """Return what select() can wait on."""
        return self._watch.fileno()

    def read(self) -> Packet | None:
        """Return some bytes; None: nothing more for now."""
        if self._port is None:
            return None
        try:
            self._out.flush()
            data = os.read(self._port, CHUNK)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        if not data:
            self._close_and_retry()
        return Packet(data, self._clock(), self.peer)

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame; return "" or the counter of what went wrong."""
        if self._port is None:
            return "no_peer"
        try:
            if self._out.push(data):
                return ""
        except OSError:
            self._close_and_retry()
        return "send_failed"

    def maintain(self) -> None:
        """Open the device again if it went away."""
        if self._port is None and self._retry.due_ns() == 0:
            with contextlib.suppress(OSError, termios.error):
                self._open()

    def due_ns(self) -> int | None:
        """Return the time until the next try."""
        return self._retry.due_ns() if self._port is None else None

    def close(self) -> None:
        """Close the device."""
        self._close_and_retry()
        self._watch.close()

    def _open(self) -> None:
        self._retry.now()
        port = os.open(self._url.host, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC)
        try:
            tty.setraw(port, termios.TCSANOW)
            mode = termios.tcgetattr(port)
            mode[_FLAGS] |= termios.CLOCAL | termios.CREAD
            mode[_FLAGS] &= ~(termios.CRTSCTS | termios.CSTOPB | termios.PARENB)
            mode[_INPUT_SPEED] = mode[_OUTPUT_SPEED] = _SPEEDS[self._url.port]
            termios.tcsetattr(port, termios.TCSANOW, mode)
            termios.tcflush(port, termios.TCIOFLUSH)
            self._out = SendBuffer(self._watch, port, partial(os.write, port))
        except BaseException:
            os.close(port)
            raise
        self._port = port

    def _close_and_retry(self) -> None:
        if self._port is not None:
            with contextlib.suppress(OSError, ValueError):
                self._watch.unregister(self._port)
            os.close(self._port)
            self._port = None
