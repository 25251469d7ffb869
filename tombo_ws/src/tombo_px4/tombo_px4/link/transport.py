"""URL of a link, and transport of bytes over UDP, TCP and serial ports; none blocks."""

from __future__ import annotations

import contextlib
import errno
import ipaddress
import os
import re
import select
import socket
import struct
import termios
import tty
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
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
MAX_DATAGRAM = 2048
"""Longest datagram that is taken whole; MAVLink's fit into a packet of the network."""
_CHUNK = 4096
"""Most bytes of a stream that are read at once."""
_ROOM = 1 << 18
"""Most bytes of a stream that wait to be sent."""
_RETRY_NS = SECOND_NS // 2
_CONNECTING_NS = SECOND_NS // 50
_SO_TIMESTAMPNS, _SO_RXQ_OVFL = 35, 40
_STAMP, _COUNT = struct.Struct("@qq"), struct.Struct("@I")
_ANCILLARY = socket.CMSG_SPACE(_STAMP.size) + socket.CMSG_SPACE(_COUNT.size)
_RECEIVE_BUFFER = 1 << 20
_SPEEDS = {
    int(name[1:]): getattr(termios, name)
    for name in dir(termios)
    if name[0] == "B" and name[1:].isdecimal() and int(name[1:]) >= 9600
}
_OUTPUT_SPEED, _INPUT_SPEED, _FLAGS = 5, 4, 2
"""Places in the attributes of a terminal."""
_FREE_PORT = "a free port of this machine"


class Packet(NamedTuple):
    """Received bytes: a datagram, or a piece of a stream (empty: the stream ended)."""

    data: bytes
    arrival_ns: int
    peer: Any


class _Udp:
    """Datagrams with the kernel's arrival stamps, and the count of those it had no room for.

    A listener answers the last accepted sender. A sender is connected to its address: the kernel
    drops the datagrams of others.
    """

    stream = False
    opened = 0

    def __init__(
        self, url: Url, clock: Clock, counters: Counters, allow_remote: bool, peer: Address | None
    ) -> None:
        self._clock = clock
        self._counters = counters
        self._foreign = allow_remote
        self._overflowed = 0
        self._listens = url.kind == "udpin"
        self._socket = socket.socket(url.family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        for option, value in (
            (_SO_TIMESTAMPNS, 1),
            (_SO_RXQ_OVFL, 1),
            (socket.SO_RCVBUF, _RECEIVE_BUFFER),
        ):
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, value)
        doing, accepted = "listen there", _FREE_PORT
        try:
            if self._listens:
                self._socket.bind(url.address)
            else:
                doing, accepted = "send there", "a host this machine can reach, a free local port"
                if url.local:
                    anywhere = "::" if url.family == socket.AF_INET6 else "0.0.0.0"
                    self._socket.bind((url.host if is_loopback(url.host) else anywhere, url.local))
                self._socket.connect(url.address)
        except OSError as error:
            self.close()
            raise _refused(url, doing, error, accepted) from error
        self.peer: Any = peer if self._listens else url.address
        self.address = self._socket.getsockname()[:2]

    @property
    def connected(self) -> bool:
        return self.peer is not None

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> Packet | None:
        """Return the next datagram, empty if it is refused; None: nothing more for now."""
        try:
            data, ancillary, flags, sender = self._socket.recvmsg(MAX_DATAGRAM, _ANCILLARY)
        except BlockingIOError:
            return None
        except OSError:  # told by the network that nobody listens there: the next read goes on
            return Packet(b"", 0, None)
        arrival_ns = 0
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS and len(value) == _STAMP.size:
                seconds, rest = _STAMP.unpack(value)
                arrival_ns = seconds * SECOND_NS + rest
            elif kind == _SO_RXQ_OVFL and len(value) == _COUNT.size:
                (total,) = _COUNT.unpack(value)
                self._counters["dropped"] += (total - self._overflowed) & 0xFFFFFFFF
                self._overflowed = total
        refusal = ""
        if not self._foreign and not is_loopback(sender[0]):
            refusal = "foreign_address"
        elif flags & socket.MSG_TRUNC:
            refusal = "oversized"
        if refusal:
            self._counters[refusal] += 1
            data = b""
        return Packet(data, arrival_ns or self._clock(), sender)

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

    def answer(self, peer: Any) -> None:
        """Take the sender of a valid message for the peer."""
        self.peer = peer

    def maintain(self) -> None:
        """Do nothing: a datagram needs no connection."""

    def due_ns(self) -> int | None:
        return None

    def lose(self) -> None:
        """Do nothing: UDP has no connection."""

    def close(self) -> None:
        self._socket.close()


class _Stream(ABC):
    """A stream of bytes over one file, opened again after it was lost; see the three kinds.

    Attributes:
        opened: how often there was a connection.
    """

    stream = True
    address: Address | None = None
    peer: Any = None

    def __init__(self, url: Url, clock: Clock, doing: str, accepted: str) -> None:
        """Open it; `doing` and `accepted` are words of the error.

        Raises:
            InputError: it can't be opened.
        """
        self.opened = 0
        self._url = url
        self._clock = clock
        self._watch = select.epoll()  # one descriptor, whichever file is open
        self._file: Any = None
        self._waiting = bytearray()
        self._ended = False
        self._tried_ns = 0
        try:
            self._open()
        except (OSError, termios.error) as error:
            self.close()
            raise _refused(url, doing, error, accepted) from error

    @abstractmethod
    def _open(self) -> None:
        """Open the file that the bytes go through."""

    @property
    def connected(self) -> bool:
        return self._file is not None

    def fileno(self) -> int:
        return self._watch.fileno()

    def read(self) -> Packet | None:
        """Return some bytes; None: nothing more for now."""
        self._flush()
        if self._file is not None:
            try:
                data = os.read(self._file.fileno(), _CHUNK)
            except BlockingIOError:
                return None
            except OSError:
                data = b""
            if data:
                return Packet(data, self._clock(), self.peer)
            self.lose()
        if self._ended:
            self._ended = False
            return Packet(b"", 0, self.peer)
        return None

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame, whole or not at all; return "" or the counter of what went wrong."""
        if not self.connected or peer not in (None, self.peer):
            return "no_peer"
        self._flush()
        if len(self._waiting) + len(data) > _ROOM:
            return "send_failed"
        self._waiting += data
        self._flush()
        return "" if self.connected else "send_failed"

    def answer(self, peer: Any) -> None:  # noqa: B027 - a hook
        """Do nothing: the one peer is known."""

    def maintain(self) -> None:
        """Open the file again if it was lost."""
        if self._file is None and self.due_ns() == 0:
            with contextlib.suppress(OSError, termios.error):
                self._open()

    def due_ns(self) -> int | None:
        """Return the time until `maintain` has something to do; the clock may be set back."""
        if self._file is not None:
            return None
        waited_ns = self._clock() - self._tried_ns
        return _RETRY_NS - waited_ns if 0 <= waited_ns < _RETRY_NS else 0

    def close(self) -> None:
        """Close the file; the next `read` returns the end of the stream."""
        self.lose()
        self._watch.close()

    def _take(self, file: Any, peer: Any) -> None:
        self._watch.register(file.fileno(), select.EPOLLIN)
        self._file, self.peer = file, peer
        self.opened += 1

    def _flush(self) -> None:
        """Write what waits, as far as there is room."""
        try:
            while self._waiting:
                del self._waiting[: os.write(self._file.fileno(), self._waiting[:65536])]
        except BlockingIOError:
            pass
        except OSError:
            self.lose()

    def lose(self) -> None:
        """Close the file; the next `read` returns the end of the stream."""
        if self._file is not None:
            self._file.close()
            self._file = None
            self._ended = True
            self._tried_ns = self._clock()
        self._waiting.clear()


class _SerialPort(_Stream):
    """A serial port, raw, 8 bits, no parity, no flow control."""

    def __init__(self, url: Url, clock: Clock) -> None:
        if url.port not in _SPEEDS:
            speeds = ", ".join(str(speed) for speed in sorted(_SPEEDS))
            raise InputError(f"link '{url.text}': no baud rate {url.port}; accepted: {speeds}")
        accepted = "a serial device that this user may read and write"
        super().__init__(url, clock, "open it", accepted)

    def _open(self) -> None:
        self._tried_ns = self._clock()
        flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
        with contextlib.ExitStack() as stack:
            port = stack.enter_context(open(os.open(self._url.host, flags), "r+b", buffering=0))
            tty.setraw(port.fileno(), termios.TCSANOW)
            mode = termios.tcgetattr(port)
            mode[_FLAGS] |= termios.CLOCAL | termios.CREAD
            mode[_FLAGS] &= ~(termios.CRTSCTS | termios.CSTOPB | termios.PARENB)
            mode[_INPUT_SPEED] = mode[_OUTPUT_SPEED] = _SPEEDS[self._url.port]
            termios.tcsetattr(port, termios.TCSANOW, mode)
            termios.tcflush(port, termios.TCIOFLUSH)
            self._take(port, self._url.host)
            stack.pop_all()


class _TcpOut(_Stream):
    """A TCP client. It connects in the background, and again when the connection is lost."""

    _connecting = False

    def __init__(self, url: Url, clock: Clock) -> None:
        super().__init__(url, clock, "connect", "a host this machine can reach")

    @property
    def connected(self) -> bool:
        return self._file is not None and not self._connecting

    def maintain(self) -> None:
        """Begin to connect, or look whether it is connected; `read` meets a refusal."""
        super().maintain()
        if self._file is not None and self._connecting:
            with contextlib.suppress(OSError):
                itself = _is_itself(self._file)
                self._connecting = False
                if itself:
                    self.lose()

    def due_ns(self) -> int | None:
        connecting = self._file is not None and self._connecting
        return _CONNECTING_NS if connecting else super().due_ns()

    def _open(self) -> None:
        self._tried_ns = self._clock()
        self._connecting = True
        sock = _tcp_socket(self._url.family)
        result = sock.connect_ex(self._url.address)
        if result in (0, errno.EINPROGRESS):
            self._take(sock, self._url.address)
            return
        sock.close()
        if result != errno.ECONNREFUSED:
            raise OSError(result, "connect")


class _TcpIn(_Stream):
    """A TCP server with one client; one that has sent no valid message makes room for the next."""

    def __init__(self, url: Url, clock: Clock, counters: Counters, allow_remote: bool) -> None:
        self._counters = counters
        self._foreign = allow_remote
        self._spoke = False
        self._listener = _tcp_socket(url.family)
        super().__init__(url, clock, "listen there", _FREE_PORT)
        self.address = self._listener.getsockname()[:2]

    def answer(self, peer: Any) -> None:
        """Keep the client: it has sent a valid message."""
        self._spoke = True

    def read(self) -> Packet | None:
        """Return some bytes; None: nothing more for now. Then a client may have come."""
        packet = super().read()
        if packet is None:
            self._accept()
        return packet

    def maintain(self) -> None:
        """Clients come by themselves."""

    def due_ns(self) -> int | None:
        return None

    def close(self) -> None:
        self._listener.close()
        super().close()

    def _open(self) -> None:
        # A server that comes back finds its port although old connections still linger.
        self._listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self._listener.bind(self._url.address)
        self._listener.listen()
        self._watch.register(self._listener.fileno(), select.EPOLLIN)

    def _accept(self) -> None:
        try:
            sock, peer = self._listener.accept()
        except OSError:
            return
        refusal = ""
        if not self._foreign and not is_loopback(peer[0]):
            refusal = "foreign_address"
        elif self._spoke and self.connected:
            refusal = "dropped"
        if refusal:
            self._counters[refusal] += 1
            sock.close()
            return
        self.lose()
        sock.setblocking(False)
        self._spoke = False
        self._take(sock, peer)


def _tcp_socket(family: socket.AddressFamily) -> socket.socket:
    """Return a socket that neither blocks nor gathers bytes; accepted ones inherit the latter."""
    sock = socket.socket(family, socket.SOCK_STREAM)
    sock.setblocking(False)
    sock.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    return sock


def _is_itself(sock: socket.socket) -> bool:
    """Whether TCP has connected a port without a server to itself: it is tried often enough.

    Raises:
        OSError: it is not connected yet.
    """
    return bool(sock.getsockname() == sock.getpeername())


def _refused(url: Url, doing: str, error: Exception, accepted: str) -> InputError:
    """Build the error for a transport that can't be opened."""
    number = error.args[0] if error.args else None  # termios.error has no errno
    why = os.strerror(number).lower() if isinstance(number, int) and number > 0 else str(error)
    return InputError(f"link '{url.text}': can't {doing} ({why}); accepted: {accepted}")


def open_transport(
    url: Url, clock: Clock, counters: Counters, allow_remote: bool, peer: Address | None
) -> _Udp | _Stream:
    """Open what the URL names.

    Raises:
        InputError: busy port, no such device, no such host.
    """
    if url.kind in ("udpin", "udpout"):
        return _Udp(url, clock, counters, allow_remote, peer)
    if url.kind == "tcpin":
        return _TcpIn(url, clock, counters, allow_remote)
    return _TcpOut(url, clock) if url.kind == "tcpout" else _SerialPort(url, clock)
