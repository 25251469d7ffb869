"""The URL of a link, parsed, and which hosts are this machine."""

from __future__ import annotations

import ipaddress
import re
import socket
from dataclasses import dataclass

from tombo_dynamics.errors import InputError

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
        found = socket.getaddrinfo(host, None, socket.AF_INET, socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        raise InputError(f"{what}: host '{host}' is not known; accepted: {ACCEPTED}") from error
    return str(found[0][4][0])
