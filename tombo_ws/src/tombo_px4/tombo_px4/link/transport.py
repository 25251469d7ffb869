"""URL of a link, and transport of bytes: interface of UDP, TCP and serial ports; none blocks."""

from __future__ import annotations

import contextlib
import ipaddress
import os
import re
import select
import socket
import termios
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS

ACCEPTED = (
    "udpin://HOST:PORT, udpout://HOST:PORT[?local=PORT], tcpin://HOST:PORT, tcpout://HOST:PORT, "
    "serial:///dev/tty…:BAUD"
)
_NETWORK = re.compile(
    r"(?P<kind>udpin|udpout|udp|tcpin|tcpout|tcp)://"
    r"(?P<host>\[[0-9A-Fa-f:.]+\]|[^\s/:?\[\]]*):(?P<port>\d{1,5})(\?local=(?P<local>\d{1,5}))?"
)
_SERIAL = re.compile(r"serial://(?P<device>/[^\s:?]+):(?P<baud>\d{1,8})")
_LISTENING = {"udpin", "tcpin"}
_SHORT = {"udp": "udpin", "tcp": "tcpout"}

Address = tuple[str, int]
"""Numeric host and port."""


@dataclass(frozen=True)
class Url:
    """A link's URL, and its text as it was given."""

    text: str
    kind: str
    """`udpin`, `udpout`, `tcpin`, `tcpout` or `serial`."""
    host: str
    """Numeric address, or the device of a serial port."""
    port: int
    """Of the network, or baud rate of a serial port."""
    local: int = 0
    """Port to send from, 0 for any."""

    @property
    def address(self) -> Address:
        """Host and port."""
        return self.host, self.port

    @property
    def family(self) -> socket.AddressFamily:
        """IPv4 or IPv6."""
        return socket.AF_INET6 if ":" in self.host else socket.AF_INET


def parse_url(text: str, allow_remote: bool) -> Url:
    """Parse a URL and resolve its host.

    Raises:
        InputError: it is no URL of a link, or leads away from this machine without `allow_remote`.
    """
    serial = _SERIAL.fullmatch(text)
    if serial:
        return Url(text, "serial", serial["device"], int(serial["baud"]))
    network = _NETWORK.fullmatch(text)
    if not network:
        raise InputError(f"link '{text}' is no URL of a link; accepted: {ACCEPTED}")
    kind = _SHORT.get(network["kind"], network["kind"])
    listening = kind in _LISTENING
    port, local = int(network["port"]), int(network["local"] or 0)
    lowest = 0 if listening else 1
    if not lowest <= port <= 65535 or local > 65535:
        raise InputError(f"link '{text}': port out of bounds; accepted: {lowest} to 65535")
    if network["local"] is not None and kind != "udpout":
        raise InputError(f"link '{text}': a local port belongs to udpout; accepted: {ACCEPTED}")
    host = network["host"].strip("[]")
    if not host:
        if not listening:
            raise InputError(f"link '{text}' names no host to go to; accepted: {ACCEPTED}")
        host = "0.0.0.0" if allow_remote else "127.0.0.1"
    return Url(text, kind, _numeric(host, f"link '{text}'", allow_remote), port, local)


def parse_peer(text: str, allow_remote: bool) -> Address:
    """Return the address of "HOST:PORT".

    Raises:
        InputError: it is none, or another machine's without `allow_remote`.
    """
    host, _, port = text.rpartition(":")
    if not host or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise InputError(f"peer '{text}' is no address; accepted: HOST:PORT, port 1 to 65535")
    return _numeric(host.strip("[]"), f"peer '{text}'", allow_remote), int(port)


def is_loopback(host: str) -> bool:
    """Whether a numeric address is this machine's loopback."""
    if host.startswith("127.") or host == "::1":  # parsing takes longer than receiving
        return True
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return False
    mapped = getattr(address, "ipv4_mapped", None)
    return bool((mapped or address).is_loopback)


def _numeric(host: str, what: str, allow_remote: bool) -> str:
    if host == "localhost":
        return "127.0.0.1"
    try:
        numeric = str(ipaddress.ip_address(host))
    except ValueError:
        numeric = ""
    if not allow_remote and not is_loopback(numeric):
        raise InputError(
            f"{what} leads to '{host}', not to this machine; accepted: localhost, 127.0.0.1, ::1, "
            "any host "
            "when remote links are allowed (with --px4: --bridge link.allow_remote=true)"
        )
    if numeric:
        return numeric
    try:
        addresses = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise InputError(f"{what}: host '{host}' is not known; accepted: {ACCEPTED}") from error
    return str(addresses[0][4][0])


Clock = Callable[[], int]
"""Time now, CLOCK_REALTIME [ns]."""

Counters = dict[str, int]

CHUNK = 4096
"""Most bytes of a stream that are read at once."""

ROOM = 1 << 18
"""Most bytes that wait to be sent."""


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
    """Buffer for sending on a watched file: a frame is sent whole or not at all.

    Attributes:
        broken: the other side has gone; nothing more is sent.
    """

    def __init__(
        self, watch: select.epoll, number: int, write: Callable[[bytes], int], room: int = ROOM
    ) -> None:
        """Watch the file for what comes, and for room while something waits.

        Args:
            watch: where it is registered; unregistering it is up to the caller.
            number: of the file.
            write: writes to it as far as there is room.
            room: most bytes that wait.
        """
        self._watch = watch
        self._number = number
        self._write = write
        self._room = room
        self._waiting = bytearray()
        self._full = False
        self.broken = False
        watch.register(number, select.EPOLLIN)

    def push(self, data: bytes) -> bool:
        """Write a frame behind what waits; False: there is no room for it, or it is broken."""
        if len(self._waiting) + len(data) > self._room:
            self.flush()
            if len(self._waiting) + len(data) > self._room:
                return False
        self._waiting += data
        self.flush()
        return not self.broken

    def flush(self) -> None:
        """Write what waits, as far as there is room."""
        try:
            while self._waiting:
                del self._waiting[: self._write(bytes(self._waiting[:65536]))]
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            self.broken = True
            return
        if bool(self._waiting) != self._full:
            self._full = not self._full
            room = select.EPOLLOUT if self._full else 0
            self._watch.modify(self._number, select.EPOLLIN | room)


def refused(url: Url, doing: str, error: Exception, accepted: str) -> InputError:
    """Build the error for a transport that can't be opened."""
    number = getattr(error, "errno", None)
    why = os.strerror(number).lower() if isinstance(number, int) and number > 0 else str(error)
    return InputError(f"link '{url.text}': can't {doing} ({why}); accepted: {accepted}")


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
        self._out.flush()
        try:
            data = b"" if self._out.broken else os.read(self._port, CHUNK)
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
        if self._out.push(data):
            return ""
        if self._out.broken:
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
