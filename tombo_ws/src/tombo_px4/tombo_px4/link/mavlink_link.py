"""A link to a MAVLink partner: pymavlink's parser and signing over a transport.

Calls do not block, and no received bytes raise an exception: refused frames are counted. A link
has one peer at a time, and is for one thread.
"""

from __future__ import annotations

import hashlib
import hmac
import os
import select
from collections.abc import Callable
from typing import Any, NamedTuple

from pymavlink.dialects.v20 import common

from tombo_dynamics.errors import InputError
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.link import extra_messages  # noqa: F401  for the parser
from tombo_px4.link.link_params import LinkParams
from tombo_px4.link.transport import Clock, open_transport, parse_peer, parse_url

common.MAVLINK_IGNORE_CRC = None  # pymavlink takes it from the environment

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
    return check_key(key, f"key '{path}'")


def check_key(key: bytes, what: str = "key") -> bytes:
    """Return the key.

    Raises:
        InputError: it has not 32 bytes, or is zero, which to MAVLink means none.
    """
    if len(key) != KEY_SIZE or not any(key):
        raise InputError(f"{what} is no key; accepted: {_ACCEPTED_KEY}")
    return key


_EPOCH_S = 1_420_070_400
"""1 January 2015, where the timestamps of signatures begin."""
_UNIT_NS = 10_000
_LAST = (1 << 48) - 1
_SIGNATURE = 6
_MAGIC = (common.PROTOCOL_MARKER_V1, common.PROTOCOL_MARKER_V2)
_TRIES = 64
"""Failed candidates in one piece of bytes after which pymavlink goes on behind each."""


def timestamp_of(time_ns: int) -> int:
    """Return a CLOCK_REALTIME as a signature has it: 10 µs since the begin of 2015."""
    return min(max((time_ns - _EPOCH_S * SECOND_NS) // _UNIT_NS, 0), _LAST)


COUNTED = {
    "received": "messages let in",
    "sent": "messages sent",
    "garbage_bytes": "bytes in no frame",
    "bad_checksum": "candidates for a frame with a wrong checksum, or with flags nobody knows",
    "unknown_message": "frames of messages that the dialect does not know",
    "wrong_system": "frames of another system than the accepted one",
    "wrong_component": "frames of another component than the accepted one",
    "unsigned": "frames without a signature, where there is a key",
    "bad_signature": "frames signed with another key",
    "replayed": "signed frames with a timestamp that is not newer",
    "dropped": "datagrams the kernel had no room for, TCP clients beside the one that speaks",
    "foreign_address": "datagrams and TCP clients from another machine, where none is allowed",
    "oversized": "datagrams longer than MAVLink's can be",
    "no_peer": "messages not sent: nobody is there yet",
    "send_failed": "messages not sent: no room, no way, or a value that does not fit its field",
}
"""The counters of a link."""


class Codec(common.MAVLink):  # type: ignore[misc]
    """pymavlink's encoder, parser and signing of one link.

    A frame that fails costs one byte and hides nothing behind it: pymavlink alone goes on behind
    the length that a damaged header promises.

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
        self.signing.secret_key = check_key(key)
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
        tries = _TRIES
        while tries:
            self._refusal = ""
            message = self.parse_char(b"")
            rest = self.buf[self.buf_index :]
            if message is None:
                if not (whole and rest):
                    break
                frame, rest, kind = rest, rest[:0], common.MAVLINK_MSG_ID_BAD_DATA
            else:
                frame, kind = message.get_msgbuf(), message.get_msgId()
            if kind == common.MAVLINK_MSG_ID_BAD_DATA and not self._refusal:
                if frame[0] not in _MAGIC:
                    self.counters["garbage_bytes"] += len(frame)
                    continue
                self.counters["bad_checksum"] += message is not None
            elif kind == common.MAVLINK_MSG_ID_UNKNOWN:
                # its checksum can't be known: it is a frame where the next one begins behind it
                if not (rest or whole):
                    self.buf, self.buf_index = frame, 0
                    break
                if not rest or rest[0] in _MAGIC:
                    self.counters["unknown_message"] += 1
                    continue
            else:
                if self._lets_in(frame):
                    messages.append(message)
                continue
            tries -= 1
            self.counters["garbage_bytes"] += 1
            self.buf, self.buf_index = frame[1:] + rest, 0
        if whole or not tries:
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

    def _lets_in(self, frame: bytearray) -> bool:
        """Return whether a frame is of the accepted sender, and signed if it must be; count it."""
        at = 5 if frame[0] == common.PROTOCOL_MARKER_V2 else 3
        sender = (frame[at], frame[at + 1])
        refusal = self._refusal
        for accepted, number, counter in zip(
            self._accept, sender, ("wrong_system", "wrong_component"), strict=True
        ):
            if accepted not in (0, number):
                self.rejected_sender, refusal = sender, counter
                break
        if refusal:
            self.counters[refusal] += 1
        return not refusal


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
            url: see `ACCEPTED`; port 0 of a listener: any that is free, see `address`.
            system: our system, 1 to 255.
            component: our component, 1 to 255.
            clock: time now, CLOCK_REALTIME [ns]: `time.time_ns`.
            accept_system: the only system that is let in, 0 for any.
            accept_component: the only component that is let in, 0 for any.
            key: 32 bytes: only signed messages go out and come in.
            link_id: number in our signatures, different on each link of one component.
            allow_remote: speak with other machines too.
            default_peer: "HOST:PORT" to send to before a peer is known (udpin).

        Raises:
            InputError: URL, busy port, unreachable host, another machine, ids, key.
        """
        ours = {"system": system, "component": component}
        others = {"accept_system": accept_system, "accept_component": accept_component}
        for name, number in {**ours, **others, "link_id": link_id}.items():
            lowest = 1 if name in ours else 0
            if not lowest <= number <= 255:
                raise InputError(f"{name} {number} is out of bounds; accepted: {lowest} to 255")
        parsed = parse_url(url, allow_remote)
        if default_peer and parsed.kind != "udpin":
            raise InputError(
                f"link '{url}': peer '{default_peer}' belongs to a listener; accepted: udpin"
            )
        peer = parse_peer(default_peer, allow_remote) if default_peer else None
        self.url = url
        self.pack_error = ""
        self.mav = Codec(**ours, **others)
        self.counters = self.mav.counters
        self._clock = clock
        if key is not None:
            self.mav.set_key(key, link_id, clock())
        self._closed = False
        self._transport = open_transport(parsed, clock, self.counters, allow_remote, peer)

    @property
    def connected(self) -> bool:
        """The TCP peer is connected, the UDP peer known, or the serial device open."""
        return not self._closed and self._transport.connected

    @property
    def address(self) -> tuple[str, int] | None:
        """Host and port where it listens or sends from; None: it has no address."""
        return self._transport.address

    @property
    def opened(self) -> int:
        """How often there was a connection (TCP and serial)."""
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
        self._transport.maintain()
        for _ in range(_READS_PER_MESSAGE * limit):
            packet = self._transport.read() if len(received) < limit else None
            if packet is None:
                break
            if not packet.data:
                self.mav.forget()
            for message in self.mav.feed(packet.data, whole=not self._transport.stream):
                self._transport.answer(packet.peer)  # only accepted peers are answered
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

    def disconnect(self) -> None:
        """Close the connection (TCP and serial); another one may follow."""
        self._transport.lose()

    def wait(self, timeout_s: float) -> bool:
        """Sleep until something comes, `timeout_s` at most; return whether something has."""
        if self._closed:
            return False
        self._transport.maintain()
        due_ns = self._transport.due_ns()
        if due_ns is not None:  # to connect again may be due before
            timeout_s = min(timeout_s, 1e-9 * due_ns)
        # Unlike poll and epoll it counts in microseconds.
        return bool(select.select([self.fileno()], (), (), max(0.0, timeout_s))[0])

    def close(self) -> None:
        """Close the socket or port; a second call does nothing."""
        if not self._closed:
            self._closed = True
            self._transport.close()


def link_faults(link: Link, params: LinkParams, linked: bool) -> dict[str, str]:
    """Return key -> fault of the link, with cause and remedy.

    Args:
        link: what came, went and was refused.
        params: whom we wait for.
        linked: the vehicle is heard.
    """
    faults: dict[str, str] = {}
    counters, rejected_sender = link.counters, link.mav.rejected_sender
    if link.pack_error:
        faults["unsendable"] = link.pack_error
    if linked:
        return faults
    if rejected_sender is not None and rejected_sender[0] != params.system:
        faults["wrong_system"] = (
            f"system {rejected_sender[0]} speaks here, waiting for {params.system}: set "
            "link.system, or the vehicle's MAV_SYS_ID"
        )
    elif rejected_sender is not None:
        faults["wrong_component"] = (
            f"component {rejected_sender[1]} of system {rejected_sender[0]} speaks here, "
            f"waiting for {params.component}: set link.component"
        )
    if counters["unsigned"]:
        faults["unsigned"] = (
            f"{counters['unsigned']} messages without a signature were left out: link.key_file is"
            " set here, but the other side does not sign"
        )
    if counters["bad_signature"]:
        faults["bad_signature"] = (
            f"{counters['bad_signature']} messages are signed with another key: compare"
            " link.key_file with the vehicle's key"
        )
    if counters["foreign_address"]:
        faults["foreign_address"] = (
            f"{counters['foreign_address']} datagrams came from another machine: set"
            " link.allow_remote if that is the vehicle"
        )
    if not counters["received"] and counters["garbage_bytes"] > 1000:
        faults["garbage"] = (
            f"{counters['garbage_bytes']} bytes came that are no MAVLink: baud rate, or another"
            " program on this port"
        )
    return faults
