"""An endpoint and its clients in one process, over UDP, in time that the test makes."""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterable
from contextlib import contextmanager
from typing import Any

from pymavlink.dialects.v20 import common as mavlink
from vehicle_bench import table_with

from tombo_px4.autopilot.vehicle import Px4Vehicle
from tombo_px4.link.mavlink_link import Link
from tombo_px4.link.messages import StatusTextAssembler
from tombo_px4.protocol.endpoint import Endpoint
from tombo_sim.world import World

ROUND_NS = 4_000_000
SYSTEM, COMPONENT = 245, 191
ARM, SET_MODE, TAKEOFF, LAND = 400, 176, 22, 21
OFFBOARD = (1.0, 6.0, 0.0)


class Client:
    """Speaks MAVLink to the endpoint from a port of its own."""

    def __init__(self, system: int = SYSTEM, component: int = COMPONENT) -> None:
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.setblocking(False)
        self.socket.bind(("127.0.0.1", 0))
        self.mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.mav.robust_parsing = True
        self.there: tuple[str, int] | None = None
        self.seen: list[Any] = []

    @property
    def address(self) -> str:
        host, port = self.socket.getsockname()
        return f"{host}:{port}"

    def send(self, *messages: Any) -> None:
        for message in messages:
            self.send_bytes(message.pack(self.mav))
            self.mav.seq = (self.mav.seq + 1) % 256

    def send_bytes(self, data: bytes) -> None:
        assert self.there is not None
        self.socket.sendto(data, self.there)

    def command(self, number: int, *params: float, target: tuple[int, int] = (1, 1)) -> None:
        filled = (*params, *(7 - len(params)) * (0.0,))
        self.send(self.mav.command_long_encode(*target, number, 0, *filled))

    def collect(self) -> list[Any]:
        new = []
        while True:
            try:
                data = self.socket.recv(2048)
            except (BlockingIOError, ConnectionRefusedError):
                break
            new += self.mav.parse_buffer(data) or []
        self.seen += new
        return new


class Bench:
    """One vehicle, a link and a client for each stream set."""

    def __init__(self, streams: Iterable[str], parameters: dict[str, float]) -> None:
        self.vehicle = Px4Vehicle(World(), 0, table_with(**parameters))
        self.clients = []
        self.links = []
        links = []
        for stream_set in streams:
            client = Client()
            link = Link(
                "udpin://127.0.0.1:0",
                system=1,
                component=1,
                clock=time.time_ns,
                default_peer=client.address,
            )
            client.there = link.address
            self.clients.append(client)
            self.links.append(link)
            links.append((link, stream_set))
        self.client = self.clients[0]
        self.said: list[str] = []
        self.endpoint = Endpoint(self.vehicle, links, lambda _, text: self.said.append(text))
        for port in self.endpoint.channels:
            port.hear_station(0)
        self.boot_ns = 0
        self.each_round: Callable[[], None] | None = None
        self.station = True
        """A ground station is heard on each link, so that texts come."""

    def run(self, seconds: float, until: Callable[[Any], bool] | None = None) -> list[Any]:
        """Let time pass; return the messages of the first client. `until` ends it early."""
        heard: list[Any] = []
        for _ in range(round(seconds * 1e9 / ROUND_NS)):
            self.boot_ns += ROUND_NS
            if self.each_round is not None:
                self.each_round()
            for port in self.endpoint.channels if self.station else ():
                port.hear_station(self.vehicle.boot_us)
            self.endpoint.advance(self.boot_ns, time.time_ns())
            new, *_ = [client.collect() for client in self.clients]
            heard += new
            if until is not None and any(until(m) for m in new):
                return heard
        assert until is None, f"it did not come within {seconds} s"
        return heard

    def wait(self, kind: str, seconds: float = 2.0, **fields: Any) -> Any:
        """Let time pass until a message comes that has these fields; return it."""

        def fits(message: Any) -> bool:
            return message.get_type() == kind and all(
                getattr(message, name) == value for name, value in fields.items()
            )

        return next(m for m in reversed(self.run(seconds, fits)) if fits(m))

    def acks(self, number: int, *params: float, **more: Any) -> list[int]:
        """Send a command; return the results it is acknowledged with."""
        self.client.command(number, *params, **more)
        return [m.result for m in of(self.run(0.1), "COMMAND_ACK") if m.command == number]

    def settle(self) -> None:
        """Let time pass until the vehicle can be armed."""
        self.run(10.0, lambda _: not self.vehicle.problems)

    def take_off(self, height: float = 1.0) -> None:
        self.settle()
        assert self.acks(ARM, 1.0) == [0]
        self.vehicle.parameters.store("MIS_TAKEOFF_ALT", height)
        assert self.acks(TAKEOFF, *4 * (float("nan"),), *3 * (float("nan"),)) == [0]
        self.run(12.0, lambda _: self.vehicle.mode.sub == 3)


def of(messages: Iterable[Any], kind: str) -> list[Any]:
    return [m for m in messages if m.get_type() == kind]


def texts(messages: Iterable[Any]) -> list[str]:
    """The texts that were said, their pieces put together."""
    joiner = StatusTextAssembler()
    joined = [joiner.take(m, 0) for m in of(messages, "STATUSTEXT")]
    return [text.text for text in joined if text is not None]


@contextmanager
def bench(*streams: str, **parameters: float):
    made = Bench(streams or ("onboard",), parameters)
    try:
        yield made
    finally:
        for link in made.links:
            link.close()
        for client in made.clients:
            client.socket.close()
