"""A link to a MAVLink partner: owns the socket or serial port, accepts only valid frames.

Nothing here blocks, and no received bytes raise an exception: refused frames are counted. A link
is for one thread.
"""

from __future__ import annotations

import select
from collections import deque
from typing import Any, NamedTuple

from tombo_dynamics.errors import InputError
from tombo_px4.link.framing import Frame, FrameCounts, StreamFramer, decode, encoder, frames_of
from tombo_px4.link.link_params import LinkParams
from tombo_px4.link.signing import SignatureVerifier, check_key
from tombo_px4.link.tcp import TcpIn, TcpOut
from tombo_px4.link.transport import (
    Address,
    Clock,
    Counters,
    Packet,
    SerialPort,
    Transport,
    Url,
    parse_peer,
    parse_url,
)
from tombo_px4.link.udp import UdpIn, UdpOut

COUNTED = {
    "received": "messages let in",
    "sent": "messages sent",
    "garbage_bytes": "bytes in no frame",
    "bad_checksum": "candidates of a known message with a wrong checksum",
    "unknown_message": "frames of messages that the dialect does not know",
    "wrong_system": "frames of another system than the accepted one",
    "wrong_component": "frames of another component than the accepted one",
    "unsigned": "frames without a signature, where there is a key",
    "bad_signature": "frames signed with another key",
    "replayed": "signed frames with a timestamp that is not newer",
    "undecodable": "frames that could not be decoded",
    "dropped": "datagrams the kernel had no room for, TCP clients there was none for",
    "foreign_address": "datagrams and TCP clients from another machine, where none is allowed",
    "oversized": "datagrams longer than MAVLink's can be",
    "no_peer": "messages not sent: nobody is there yet",
    "send_failed": "messages not sent: no room, no way, or a value that does not fit its field",
}
"""The counters of a link."""

_WORK_PER_MESSAGE = 4
"""Steps of work that one call may spend for each message it may return."""

_BYTES_PER_STEP = 256


def open_transport(
    url: Url, clock: Clock, counters: Counters, allow_remote: bool, peer: Address | None
) -> Transport:
    """Open what the URL names.

    Raises:
        InputError: busy port, no such device, no such host.
    """
    if url.kind == "udpin":
        return UdpIn(url, clock, counters, allow_remote, peer)
    if url.kind == "udpout":
        return UdpOut(url, clock, counters, allow_remote)
    if url.kind == "tcpin":
        return TcpIn(url, clock, counters, allow_remote)
    if url.kind == "tcpout":
        return TcpOut(url, clock)
    return SerialPort(url, clock)


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
        rejected_sender: system and component that were last refused for being others.
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
            url: see `address.ACCEPTED`; port 0 of a listener: any that is free, see `address`.
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
        self.counters = dict.fromkeys(COUNTED, 0)
        self.pack_error = ""
        self.rejected_sender: tuple[int, int] | None = None
        self.mav = encoder(system, component)
        self._clock = clock
        self._accept_system = accept_system
        self._accept_component = accept_component
        self._signature_verifier: SignatureVerifier | None = None
        if key is not None:
            self._signature_verifier = SignatureVerifier(check_key(key), clock())
            self.mav.signing.secret_key = key
            self.mav.signing.link_id = link_id
            self.mav.signing.sign_outgoing = True
        self._findings = FrameCounts()
        self._streams: dict[Any, StreamFramer] = {}
        self._waiting: deque[tuple[Frame, int, Any]] = deque()
        self._closed = False
        self._transport = open_transport(parsed, clock, self.counters, allow_remote, peer)

    @property
    def connected(self) -> bool:
        """The TCP peer is connected, the UDP peer known, or the serial device open."""
        return not self._closed and self._transport.connected

    @property
    def address(self) -> tuple[str, int] | None:
        """Host and port where it listens or sends from; None of what has none."""
        return self._transport.address

    def fileno(self) -> int:
        """Return what select() can wait on, the same one until it is closed.

        What `receive` has left over does not show there: read until it returns nothing.
        """
        return self._transport.fileno()

    def receive(self, limit: int = 200) -> list[Received]:
        """Return the messages that have come, `limit` at most; the rest waits.

        The work is bounded too: under a flood of garbage it returns with less.
        """
        received: list[Received] = []
        if self._closed:
            return received
        self._transport.maintain()
        work = _WORK_PER_MESSAGE * limit
        while work > 0 and len(received) < limit:
            if self._waiting:
                work -= 1
                frame, arrival_ns, peer = self._waiting.popleft()
                message = self._admit(frame)
                if message is not None:
                    # only accepted peers are answered
                    self._transport.peer = peer
                    sender = (frame.system, frame.component)
                    received.append(Received(message, arrival_ns, *sender, peer))
                continue
            packet = self._transport.read()
            if packet is None:
                break
            tries = self._findings.tries
            frames = self._frames(packet)
            self._waiting.extend((frame, packet.arrival_ns, packet.peer) for frame in frames)
            work -= 1 + len(packet.data) // _BYTES_PER_STEP + self._findings.tries - tries
        self.counters["received"] += len(received)
        self.counters |= self._findings.counts()
        return received

    def send(self, message: Any, to: Any = None) -> bool:
        """Send a message to the peer, or to one from `Received.peer`; False: counted, not sent."""
        if self._signature_verifier:
            self.mav.signing.timestamp = self._signature_verifier.next_timestamp(self._clock())
        try:
            data = message.pack(self.mav)
        except Exception as error:  # pymavlink raises several kinds of errors
            self.counters["send_failed"] += 1
            self.pack_error = f"{type(message).__name__} can't be packed: {error}"
            return False
        self.mav.seq = (self.mav.seq + 1) % 256
        wrong = "send_failed" if self._closed else self._transport.write(data, to)
        self.counters[wrong or "sent"] += 1
        return not wrong

    def wait(self, timeout_s: float) -> bool:
        """Sleep until something comes, `timeout_s` at most; return whether something has."""
        if self._waiting:
            return True
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
            self._waiting.clear()
            self._transport.close()

    def _frames(self, packet: Packet) -> list[Frame]:
        if not self._transport.stream:
            return frames_of(packet.data, self._findings)
        if not packet.data:
            self._streams.pop(packet.peer, None)
            return []
        framer = self._streams.setdefault(packet.peer, StreamFramer(self._findings))
        return framer.feed(packet.data)

    def _admit(self, frame: Frame) -> Any:
        """Return the message of an accepted frame, else None."""
        refusal = ""
        if self._accept_system not in (0, frame.system):
            refusal = "wrong_system"
        elif self._accept_component not in (0, frame.component):
            refusal = "wrong_component"
        elif self._signature_verifier:
            refusal = self._signature_verifier.refusal(frame)
        if refusal.startswith("wrong_"):
            self.rejected_sender = (frame.system, frame.component)
        if not refusal:
            try:
                return decode(frame)
            except Exception:  # pymavlink on untrusted bytes: any exception is counted here
                refusal = "undecodable"
        self.counters[refusal] += 1
        return None


def link_faults(link: Link, params: LinkParams, linked: bool) -> dict[str, str]:
    """Return key -> fault of the link, with cause and remedy.

    Args:
        link: what came, went and was refused.
        params: whom we wait for.
        linked: the vehicle is heard.
    """
    faults: dict[str, str] = {}
    counters, rejected_sender = link.counters, link.rejected_sender
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
