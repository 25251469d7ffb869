"""A link to a MAVLink partner: pymavlink's parser and signing over UDP, TCP or a serial port.

Calls do not block, and no received bytes raise an exception: refused frames are counted. A link
has one peer at a time, and is for one thread.
"""

from __future__ import annotations

import contextlib
import errno
import hashlib
import hmac
import os
import re
import select
import socket
import struct
import termios
import tty
from collections.abc import Callable, Iterator
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS

common.MAVLINK_IGNORE_CRC = None  # pymavlink takes it from the environment

Clock = Callable[[], int]
"""Time now, CLOCK_REALTIME [ns]."""

# --- Signing keys ---------------------------------------------------------------------------

KEY_SIZE = 32
_ACCEPTED_KEY = (
    f"a file of {KEY_SIZE} bytes, or of {2 * KEY_SIZE} hexadecimal digits, not all zero"
)


def read_key(path: str, warn: Callable[[str], object]) -> bytes | None:
    """Return the key of a file, None for an empty path; `warn` is called if others may read it.

    Raises:
        InputError: no such file, or no key in it.
    """
    if not path:
        return None
    try:
        with open(path, "rb") as file:
            key = file.read(4 * KEY_SIZE)
            others = os.fstat(file.fileno()).st_mode & 0o077
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise InputError(
            f"key '{path}' can't be read ({why}); accepted: {_ACCEPTED_KEY}"
        ) from error
    if len(key) != KEY_SIZE:
        try:
            key = bytes.fromhex(key.decode("ascii"))
        except ValueError:
            key = b""
    if others:
        warn(f"key '{path}' can be read or written by others; chmod 600 it")
    if len(key) != KEY_SIZE or not any(key):  # zero means none to MAVLink
        raise InputError(f"key '{path}' is not a key; accepted: {_ACCEPTED_KEY}")
    return key


# --- URLs -----------------------------------------------------------------------------------

_FORMS = (
    re.compile(r"(udpin|udpout|tcpin|tcpout)://([^\s:?/]+):(\d{1,5})"),
    re.compile(r"(serial)://(/[^\s:?]+):(\d{1,8})"),
)
_ACCEPTED = (
    "udpin://HOST:PORT, udpout://HOST:PORT, tcpin://HOST:PORT, tcpout://HOST:PORT, "
    "serial:///dev/tty…:BAUD"
)
_LOOPBACK = re.compile(r"127(\.\d{1,3}){3}")

Address = tuple[str, int]
"""Numeric host and port."""


class Url(NamedTuple):
    """A link's URL."""

    kind: str
    """`udpin`, `udpout`, `tcpin`, `tcpout` or `serial`."""
    place: str
    """Numeric IPv4 address, or the device of a serial port."""
    number: int
    """Port of the network, or baud rate of a serial port."""


def parse_url(text: str, allow_remote: bool) -> Url:
    """Parse a URL and resolve its host; an `…in` listens there, an `…out` sends there.

    Raises:
        InputError: it is not a URL of a link, or leads away from this machine without
        `allow_remote`.
    """
    found = next((form.fullmatch(text) for form in _FORMS if form.fullmatch(text)), None)
    if found is None:
        raise InputError(f"link '{text}' is not the URL of a link; accepted: {_ACCEPTED}")
    kind, place, number = found[1], found[2], int(found[3])
    if kind == "serial":
        if number == 0 or not hasattr(termios, f"B{number}"):
            known = "those of this system, as 57600, 115200, 921600"
            raise InputError(f"link '{text}': no baud rate {number}; accepted: {known}")
        return Url(kind, place, number)
    lowest = 0 if kind in ("udpin", "tcpin") else 1
    if not lowest <= number <= 65535:
        raise InputError(f"link '{text}': port out of bounds; accepted: {lowest} to 65535")
    if place == "localhost":
        place = "127.0.0.1"
    elif not allow_remote and not _LOOPBACK.fullmatch(place):
        raise InputError(
            f"link '{text}' leads to '{place}', not to this machine; accepted: localhost, "
            "127.0.0.1, any host when remote links are allowed (with --px4: --bridge "
            "link.allow_remote=true)"
        )
    try:
        return Url(kind, socket.gethostbyname(place), number)
    except (OSError, UnicodeError) as error:
        raise InputError(
            f"link '{text}': host '{place}' is not known; accepted: a name or an IPv4 address"
        ) from error


# --- Transport of bytes ---------------------------------------------------------------------

_MAX_DATAGRAM = 2048
"""Longest datagram that is taken whole; MAVLink's fit into a packet of the network."""
_CHUNK = 4096
"""Most bytes of a stream that are read at once."""
_ROOM = 1 << 18
"""Most bytes of a stream that wait to be sent."""
_RETRY_NS = SECOND_NS // 2
_SO_TIMESTAMPNS = 35
_STAMP = struct.Struct("@qq")
_UDP_OPTIONS = {_SO_TIMESTAMPNS: 1, socket.SO_RCVBUF: 1 << 20}
_FLAGS, _INPUT_SPEED, _OUTPUT_SPEED = 2, 4, 5
"""Places in the attributes of a terminal."""
_NEEDED = {
    "udpin": "a free port of this machine",
    "tcpin": "a free port of this machine",
    "serial": "a serial device that this user may read and write",
}
"""Kind of a link → what it needs to be opened; else a host."""


class _Packet(NamedTuple):
    """Received bytes: a datagram, or a piece of a stream."""

    data: bytes
    arrival_ns: int
    peer: Any


class _Udp:
    """Datagrams with the kernel's arrival stamps.

    A listener answers the last accepted sender. A sender is connected to its address: the kernel
    drops the datagrams of others.
    """

    whole = True
    """A packet begins and ends with frames."""
    opened = 0

    def __init__(self, url: Url, clock: Clock) -> None:
        self._clock = clock
        self._listens = url.kind == "udpin"
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        for option, value in _UDP_OPTIONS.items():
            with contextlib.suppress(OSError):
                self._socket.setsockopt(socket.SOL_SOCKET, option, value)
        with closed_on_error(self._socket):
            if self._listens:
                self._socket.bind(url[1:])
            else:
                self._socket.connect(url[1:])
        self.peer: Any = None if self._listens else url[1:]
        self.address: Address | None = self._socket.getsockname()

    @property
    def connected(self) -> bool:
        return self.peer is not None

    def fileno(self) -> int:
        return self._socket.fileno()

    def read(self) -> _Packet | None:
        """Return the next datagram; None: nothing more for now."""
        try:
            room = socket.CMSG_SPACE(_STAMP.size)
            data, ancillary, _, sender = self._socket.recvmsg(_MAX_DATAGRAM, room)
        except BlockingIOError:
            return None
        except OSError:  # told by the network that nobody listens there: the next read goes on
            return _Packet(b"", 0, None)
        arrival_ns = 0
        for _, kind, value in ancillary:
            if kind == _SO_TIMESTAMPNS and len(value) == _STAMP.size:
                seconds, rest = _STAMP.unpack(value)
                arrival_ns = seconds * SECOND_NS + rest
        return _Packet(data, arrival_ns or self._clock(), sender)

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

    def close(self) -> None:
        self._socket.close()


class _Stream:
    """Bytes of a serial port or of a TCP connection; a lost one is opened again while it is read.

    Attributes:
        opened: how often a file was opened, or a client has come.
    """

    whole = False
    address: Address | None = None

    def __init__(self, url: Url, clock: Clock) -> None:
        self.opened = 0
        self.peer: Any = url[1:]
        self._url, self._clock = url, clock
        self._watch = select.epoll()  # one descriptor, whichever file is open
        self._file: Any = None
        self._unsent = bytearray()
        self._tried_ns = clock()
        with closed_on_error(self._watch):
            self._begin()

    def _begin(self) -> None:
        if self._url.kind == "serial":
            self._take(_open_serial(self._url))
            return
        client = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        client.setblocking(False)
        # It connects in the background: reading meets a refusal, and written data waits.
        result = client.connect_ex(self._url[1:])
        if result in (0, errno.EINPROGRESS):
            self._take(client)
            return
        client.close()
        if result != errno.ECONNREFUSED:
            raise OSError(result, "connect")

    @property
    def connected(self) -> bool:
        return self._file is not None

    def fileno(self) -> int:
        return self._watch.fileno()

    def read(self) -> _Packet | None:
        """Return some bytes; None: nothing more for now."""
        if self._file is None:
            self._open_again()
        self._flush()
        if self._file is None:
            return None
        try:
            data = os.read(self._file.fileno(), _CHUNK)
        except BlockingIOError:
            return None
        except OSError:
            data = b""
        if not data:
            self._lose()
            return None
        return _Packet(data, self._clock(), self.peer)

    def write(self, data: bytes, peer: Any) -> str:
        """Send one frame, whole or not at all; return "" or the counter of what went wrong."""
        if not self.connected or peer not in (None, self.peer):
            return "no_peer"
        self._flush()
        if len(self._unsent) + len(data) > _ROOM:
            return "send_failed"
        self._unsent += data
        self._flush()
        return "" if self.connected else "send_failed"

    def _lose(self) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None
        self._unsent.clear()

    def close(self) -> None:
        self._lose()
        self._watch.close()

    def _open_again(self) -> None:
        now_ns = self._clock()
        if not 0 <= now_ns - self._tried_ns < _RETRY_NS:  # the clock may be set back
            self._tried_ns = now_ns
            with contextlib.suppress(OSError, termios.error):
                self._begin()

    def _take(self, file: Any) -> None:
        if isinstance(file, socket.socket):  # bytes are not gathered before they leave
            file.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._watch.register(file.fileno(), select.EPOLLIN)
        self._file = file
        self.opened += 1

    def _flush(self) -> None:
        """Write what waits, as far as there is room."""
        try:
            while self._unsent:
                del self._unsent[: os.write(self._file.fileno(), self._unsent[:65536])]
        except BlockingIOError:
            pass
        except OSError:
            self._lose()


class _TcpServer(_Stream):
    """A TCP server with one client; others are turned away as long as it is there."""

    def __init__(self, url: Url, clock: Clock) -> None:
        self._listener = socket.create_server(url[1:])
        self._listener.setblocking(False)
        self.address = self._listener.getsockname()
        super().__init__(url, clock)

    def _begin(self) -> None:
        self._watch.register(self._listener.fileno(), select.EPOLLIN)

    def read(self) -> _Packet | None:
        """Return some bytes; None: nothing more for now. Then a client may have come."""
        packet = super().read()
        if packet is None:
            self._accept()
        return packet

    def close(self) -> None:
        self._listener.close()
        super().close()

    def _open_again(self) -> None:
        """Clients come by themselves."""

    def _accept(self) -> None:
        try:
            client, peer = self._listener.accept()
        except OSError:
            return
        if self._file is not None:
            client.close()
            return
        client.setblocking(False)
        self.peer = peer
        self._take(client)


@contextlib.contextmanager
def closed_on_error(file: Any) -> Iterator[None]:
    """Close a file if what is done with it fails."""
    try:
        yield
    except BaseException:
        file.close()
        raise


def _open_serial(url: Url) -> Any:
    """Return the file of a serial port: raw, 8 bits, no parity, no flow control."""
    flags = os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK | os.O_CLOEXEC
    port = open(os.open(url.place, flags), "r+b", buffering=0)  # noqa: SIM115 - kept open
    with closed_on_error(port):
        tty.setraw(port.fileno(), termios.TCSANOW)
        mode = termios.tcgetattr(port)
        mode[_FLAGS] |= termios.CLOCAL | termios.CREAD
        mode[_FLAGS] &= ~(termios.CRTSCTS | termios.CSTOPB | termios.PARENB)
        mode[_INPUT_SPEED] = mode[_OUTPUT_SPEED] = getattr(termios, f"B{url.number}")
        termios.tcsetattr(port, termios.TCSANOW, mode)
        termios.tcflush(port, termios.TCIOFLUSH)
    return port


def open_transport(text: str, clock: Clock, allow_remote: bool) -> _Udp | _Stream:
    """Open what a URL names; without `allow_remote` an address of this machine alone.

    Raises:
        InputError: no URL, busy port, no such device, no such host.
    """
    url = parse_url(text, allow_remote)
    try:
        if url.kind in ("udpin", "udpout"):
            return _Udp(url, clock)
        if url.kind == "tcpin":
            return _TcpServer(url, clock)
        return _Stream(url, clock)
    except (OSError, termios.error) as error:
        number = error.args[0] if error.args else None  # termios.error has no errno
        why = os.strerror(number).lower() if isinstance(number, int) else str(error)
        needed = _NEEDED.get(url.kind, "a host this machine can reach")
        raise InputError(f"link '{text}': can't be opened ({why}); accepted: {needed}") from error


# --- Frames ---------------------------------------------------------------------------------

_EPOCH_S = 1_420_070_400
"""1 January 2015, where the timestamps of signatures begin."""
_UNIT_NS = 10_000
_LAST = (1 << 48) - 1
_SIGNATURE = 6
_MAGIC = (common.PROTOCOL_MARKER_V1, common.PROTOCOL_MARKER_V2)

COUNTED = {
    "received": "messages let in",
    "sent": "messages sent",
    "garbage_bytes": "bytes of no frame, or of a damaged one",
    "bad_checksum": "frames with a wrong checksum, or with flags nobody knows",
    "unknown_message": "frames of messages that the dialect does not know",
    "wrong_system": "frames of another system than the accepted one",
    "wrong_component": "frames of another component than the accepted one",
    "unsigned": "frames without a signature, where there is a key",
    "bad_signature": "frames signed with another key",
    "replayed": "signed frames with a timestamp that is not newer",
    "no_peer": "messages not sent: nobody is there yet",
    "send_failed": "messages not sent: no room, no way, or a value that does not fit its field",
}
"""The counters of a link."""


def timestamp_of(time_ns: int) -> int:
    """Return a CLOCK_REALTIME as a signature has it: 10 µs since the begin of 2015."""
    return min(max((time_ns - _EPOCH_S * SECOND_NS) // _UNIT_NS, 0), _LAST)


class Codec(common.MAVLink):  # type: ignore[misc]
    """pymavlink's encoder, parser and signing of one link.

    Attributes:
        counters: see `COUNTED`.
        rejected_sender: system and component that were last refused for being others.
    """

    def __init__(
        self, system: int, component: int, accept_system: int = 0, accept_component: int = 0
    ) -> None:
        """Begin; `accept_…`: the only sender that is let in, 0 for any."""
        super().__init__(None, srcSystem=system, srcComponent=component)
        self.robust_parsing = True
        self.counters = dict.fromkeys(COUNTED, 0)
        self.rejected_sender: tuple[int, int] | None = None
        self._accept = (accept_system, accept_component)
        self._begin = 0
        self._refusal = ""

    def set_key(self, key: bytes, link_id: int, now_ns: int) -> None:
        """Sign what is sent, and take signed messages only.

        Messages signed before `now_ns` are refused: they may be a recording. A sender whose clock
        is behind takes over our time when it hears us, as the protocol has it.
        """
        self.signing.secret_key = key
        self.signing.link_id = link_id
        self.signing.sign_outgoing = True
        self.signing.allow_unsigned_callback = Codec._refuse
        self.signing.timestamp = self._begin = timestamp_of(now_ns)

    def forget(self) -> None:
        """Begin with a new stream: leave out what has come of an incomplete frame."""
        self.counters["garbage_bytes"] += self.buf_len()
        self.buf, self.buf_index = bytearray(), 0

    def feed(self, data: bytes, whole: bool) -> list[Any]:
        """Return the messages that are complete; the rest is kept, or garbage if it is `whole`."""
        messages = []
        self.buf, self.buf_index = self.buf[self.buf_index :] + data, 0
        while True:
            self._refusal = ""
            message = self.parse_char(b"")
            if message is None:
                break
            frame, kind = message.get_msgbuf(), message.get_msgId()
            if self._refusal:
                self.counters[self._refusal] += 1
            elif kind == common.MAVLINK_MSG_ID_UNKNOWN:
                self.counters["unknown_message"] += 1
            elif kind == common.MAVLINK_MSG_ID_BAD_DATA:
                self.counters["bad_checksum"] += frame[0] in _MAGIC
                self.counters["garbage_bytes"] += len(frame)
            elif self._is_accepted(message.get_srcSystem(), message.get_srcComponent()):
                messages.append(message)
        if whole:
            self.forget()
        return messages

    def check_signature(self, msgbuf: bytearray, srcSystem: int, srcComponent: int) -> bool:
        """Check who signed before pymavlink looks at the time, which it takes over.

        Otherwise one forged timestamp would lock the partner out.
        """
        signed, signature = bytes(msgbuf[:-_SIGNATURE]), bytes(msgbuf[-_SIGNATURE:])
        wanted = hashlib.sha256(self.signing.secret_key + signed).digest()[:_SIGNATURE]
        if not hmac.compare_digest(wanted, signature):
            self._refusal = "bad_signature"
            return False
        sender = (msgbuf[-_SIGNATURE - 7], srcSystem, srcComponent)
        self.signing.stream_timestamps.setdefault(sender, self._begin - 1)
        valid = bool(super().check_signature(msgbuf, srcSystem, srcComponent))
        self._refusal = "" if valid else "replayed"
        return valid

    def _refuse(self, number: int) -> bool:
        """Refuse a frame that has not proven who signed it."""
        self._refusal = self._refusal or "unsigned"
        return False

    def _is_accepted(self, system: int, component: int) -> bool:
        """Return whether messages of a sender are let in; count the others."""
        if self._accept[0] not in (0, system):
            counter = "wrong_system"
        elif self._accept[1] not in (0, component):
            counter = "wrong_component"
        else:
            return True
        self.counters[counter] += 1
        self.rejected_sender = system, component
        return False


# --- The link -------------------------------------------------------------------------------

_READS_PER_MESSAGE = 4
"""Reads that one call may spend for each message it may return."""


class Received(NamedTuple):
    """One accepted message, as pymavlink decodes it, with the ids of its sender."""

    message: Any
    arrival_ns: int
    """CLOCK_REALTIME, by the kernel where it can."""
    system: int
    component: int
    peer: Any
    """Where it came from; `Link.send` takes it."""


class Link:
    """A MAVLink connection over UDP, TCP or a serial port.

    Attributes:
        url: as it was given.
        mav: encoder of messages with this link's ids: `link.mav.heartbeat_encode(...)`.
        counters: how much came, went and was refused; see `COUNTED`.
        pack_error: why a message last could not be packed, "" if all could.
    """

    def __init__(
        self,
        url: str,
        *,
        system: int,
        component: int,
        clock: Clock,
        accept_system: int = 0,
        accept_component: int = 0,
        key: bytes | None = None,
        link_id: int = 0,
        allow_remote: bool = False,
        default_peer: str | None = None,
    ) -> None:
        """Open the link.

        Args:
            url: see `parse_url`; port 0 of a listener: any that is free, see `address`.
            system: our system, 1 to 255.
            component: our component, 1 to 255.
            clock: time now, CLOCK_REALTIME [ns]: `time.time_ns`.
            accept_system: the only system that is let in, 0 for any.
            accept_component: the only component that is let in, 0 for any.
            key: of `read_key`: only signed messages go out and come in.
            link_id: number in our signatures, different on each link of one component.
            allow_remote: speak with other machines too.
            default_peer: "HOST:PORT" to send to before a peer is known (udpin).

        Raises:
            InputError: URL, busy port, unreachable host, another machine.
        """
        self.url = url
        self.pack_error = ""
        self.mav = Codec(system, component, accept_system, accept_component)
        self.counters = self.mav.counters
        self._clock = clock
        if key is not None:
            self.mav.set_key(key, link_id, clock())
        self._closed = False
        peer = parse_url(f"udpout://{default_peer}", allow_remote) if default_peer else None
        self._transport = open_transport(url, clock, allow_remote)
        self._opened = 0
        if peer is not None:
            self._transport.peer = peer[1:]

    @property
    def connected(self) -> bool:
        """The TCP peer is connected, the UDP peer known, or the serial device open."""
        return not self._closed and self._transport.connected

    @property
    def address(self) -> Address | None:
        """Host and port where it listens or sends from; None: it has no address."""
        return self._transport.address

    @property
    def opened(self) -> int:
        """How often a client has come (TCP server), or the port was opened."""
        return self._transport.opened

    def fileno(self) -> int:
        """Return what select() can wait on, the same one until it is closed."""
        return self._transport.fileno()

    def receive(self, limit: int = 200) -> list[Received]:
        """Return the messages that have come; nothing more is read once there are `limit`.

        The work is bounded: under a flood of garbage it returns with less.
        """
        received: list[Received] = []
        if self._closed:
            return received
        for _ in range(_READS_PER_MESSAGE * limit):
            packet = self._transport.read() if len(received) < limit else None
            if packet is None:
                break
            if self._opened != self._transport.opened:  # another stream has begun
                self._opened = self._transport.opened
                self.mav.forget()
            for message in self.mav.feed(packet.data, self._transport.whole):
                self._transport.peer = packet.peer  # only accepted peers are answered
                sender = (message.get_srcSystem(), message.get_srcComponent())
                received.append(Received(message, packet.arrival_ns, *sender, packet.peer))
        self.counters["received"] += len(received)
        return received

    def send(self, message: Any, to: Any = None) -> bool:
        """Send a message to the peer, or to one from `Received.peer`; False: counted, not sent."""
        signing = self.mav.signing
        signing.timestamp = min(max(signing.timestamp, timestamp_of(self._clock())), _LAST)
        try:
            data = message.pack(self.mav)
        except Exception as error:  # pymavlink raises several kinds of errors
            self.counters["send_failed"] += 1
            self.pack_error = f"{type(message).__name__} can't be packed: {error}"
            return False
        self.mav.seq = (self.mav.seq + 1) % 256
        return self.send_frames(data, to)

    def send_frames(self, data: bytes, to: Any = None) -> bool:
        """Send packed messages in one piece; False: counted, not sent."""
        wrong = "send_failed" if self._closed else self._transport.write(data, to)
        self.counters[wrong or "sent"] += 1
        return not wrong

    def wait(self, timeout_s: float) -> bool:
        """Sleep until something comes, `timeout_s` at most; return whether something has."""
        if self._closed:
            return False
        # Unlike poll and epoll it counts in microseconds.
        return bool(select.select([self.fileno()], (), (), max(0.0, timeout_s))[0])

    def close(self) -> None:
        """Close the socket or port; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._transport.close()
