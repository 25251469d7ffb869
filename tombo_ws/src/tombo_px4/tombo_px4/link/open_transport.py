"""Opens the transport that a URL names."""

from __future__ import annotations

from tombo_px4.link.address import Address, Url
from tombo_px4.link.serial_port import SerialPort
from tombo_px4.link.tcp import TcpIn, TcpOut
from tombo_px4.link.transport import Clock, Counters, Transport
from tombo_px4.link.udp import UdpIn, UdpOut


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
