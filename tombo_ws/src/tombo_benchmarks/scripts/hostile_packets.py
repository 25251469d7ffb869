"""What a million hostile packets do to a MAVLink link, and what a message costs.

    python hostile_packets.py [PACKETS]

A legitimate partner speaks between the packets: noise, frames cut short, flipped bits, false
headers, valid checksums around NaN, infinities and wild numbers, crowded datagrams, half frames.
All of it over UDP and over TCP, on 127.0.0.1, with one process on both sides. The time of a call
is the processor's.
"""

from __future__ import annotations

import contextlib
import multiprocessing
import random
import socket
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[4] / "tombo_ws/src/tombo_px4/test"))

from mavlink_packets import encoder, heartbeat, hostile_packets
from pymavlink.dialects.v20 import common

from tombo_px4.link.framing import FrameCounts, frames_of
from tombo_px4.link.mavlink_link import Link

PACKETS = 1_000_000
CROWD = 64
"""Hostile packets between two legitimate ones; the kernel keeps some 200."""
FLOOD_S = 5.0
PERIOD_S = 0.01
"""Between the partner's messages during a flood."""
PARTNER = 9
TAG = 0x70000000
"""What the partner counts up from: no packet at random says that."""
KEY = bytes(range(1, 33))


def say(text: str = "") -> None:
    """Write a line."""
    sys.stdout.write(text + "\n")


@dataclass
class Siege:
    """What came of an attack."""

    sent: int = 0
    delivered: int = 0
    hostile_bytes: int = 0
    calls_s: list[float] = field(default_factory=list)

    def call(self, link: Link) -> None:
        """Receive once, and take the time."""
        begin = time.thread_time()
        received = link.receive()
        self.calls_s.append(time.thread_time() - begin)
        for item in received:
            if item.system == PARTNER and item.message.get_type() == "HEARTBEAT":
                self.delivered += 0 <= item.message.custom_mode - TAG < self.sent


def besiege(
    link: Link, attack: Callable[[bytes], object], speak: Callable[[bytes], object], packets: int
) -> Siege:
    """Send hostile packets in crowds with a legitimate message behind each."""
    siege = Siege()
    partner = encoder(PARTNER, 1)
    chance = random.Random(1)
    for number in range(packets // CROWD):
        for packet in hostile_packets(chance, CROWD):
            attack(packet)
            siege.hostile_bytes += len(packet)
        speak(heartbeat(TAG + number, partner))
        siege.sent += 1
        while link.wait(0.0):
            siege.call(link)
    while link.wait(0.1):
        siege.call(link)
    return siege


def pour(address: tuple[str, int], words: bytes | None) -> None:
    """Send as fast as one process can, for some seconds."""
    packets = [words] if words else list(hostile_packets(random.Random(3), 4096))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker:
        end = time.monotonic() + FLOOD_S
        while time.monotonic() < end:
            for packet in packets * (1 if len(packets) > 1 else 1000):
                attacker.sendto(packet, address)


def flood(name: str, words: bytes | None) -> None:
    """Print how many of a partner's messages at 100 Hz come through a flood from elsewhere."""
    siege = Siege()
    with under_udp() as (link, _, partner):
        attacker = multiprocessing.Process(target=pour, args=(link.address, words))
        attacker.start()
        mav = encoder(PARTNER, 1)
        begin = due = time.monotonic()
        while attacker.is_alive():
            if time.monotonic() >= due:
                due += PERIOD_S
                partner.send(heartbeat(TAG + siege.sent, mav))
                siege.sent += 1
            if link.wait(max(0.0, min(PERIOD_S, due - time.monotonic()))):
                siege.call(link)
        seconds = time.monotonic() - begin
        attacker.join()
        while link.wait(0.05):
            siege.call(link)
        say(
            f"UDP, a flood of {name}: {siege.delivered} of {siege.sent} legitimate messages, "
            f"{link.counters['received'] / seconds:.0f} messages/s let in, "
            f"{link.counters['dropped'] / seconds:.0f} datagrams/s dropped by the kernel, "
            f"longest call {1e3 * max(siege.calls_s):.2f} ms"
        )


@contextlib.contextmanager
def under_udp(key: bytes | None = None) -> Iterator[tuple[Link, socket.socket, socket.socket]]:
    """Open a listening link, an attacker and a partner."""
    link = Link("udpin://127.0.0.1:0", system=1, component=1, clock=time.time_ns, key=key)
    with (
        contextlib.closing(link),
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as partner,
    ):
        attacker.connect(link.address)
        partner.connect(link.address)
        yield link, attacker, partner


@contextlib.contextmanager
def under_tcp() -> Iterator[tuple[Link, socket.socket, socket.socket]]:
    """Open a TCP server, an attacker and a partner."""
    link = Link("tcpin://127.0.0.1:0", system=1, component=1, clock=time.time_ns)
    with (
        contextlib.closing(link),
        socket.create_connection(link.address) as attacker,
        socket.create_connection(link.address) as partner,
    ):
        yield link, attacker, partner


def report(name: str, siege: Siege, link: Link) -> None:
    """Print a row and the counters."""
    calls = sorted(siege.calls_s)
    total = sum(calls)
    megabytes = siege.hostile_bytes / 1e6
    say(
        f"{name}: {siege.delivered} of {siege.sent} legitimate messages delivered; "
        f"{megabytes:.0f} MB of garbage at {megabytes / total:.0f} MB/s; "
        f"receive() p50 {1e3 * calls[len(calls) // 2]:.2f} ms, "
        f"p99 {1e3 * calls[len(calls) * 99 // 100]:.2f} ms, longest {1e3 * calls[-1]:.2f} ms"
    )
    say("  " + ", ".join(f"{name} {count}" for name, count in link.counters.items() if count))


def each_us(action: Callable[[], object], number: int) -> float:
    """Return the time of one of `number` things that the action does, the best of 5 [µs]."""
    best = float("inf")
    for _ in range(5):
        begin = time.perf_counter()
        action()
        best = min(best, time.perf_counter() - begin)
    return 1e6 * best / number


def costs() -> None:
    """Print what a message costs out and in, and garbage beside pymavlink's parser."""
    say("| message | out, µs | in, µs | signed: out | in |")
    say("|---|---|---|---|---|")
    mav = encoder()
    covariance = [0.1] * 21
    spin = [0.0] * 6
    messages = {
        "HEARTBEAT": mav.heartbeat_encode(6, 8, 0, 0, 3),
        "HIGHRES_IMU": mav.highres_imu_encode(1, *[1.0] * 12, 1.0, 0xFFFF),
        "ODOMETRY": mav.odometry_encode(
            1, 1, 12, 1.0, 2.0, 3.0, [1.0, 0.0, 0.0, 0.0], *spin, covariance, covariance
        ),
    }
    number = 200
    for name, message in messages.items():
        row = [name]
        for key in (None, KEY):
            with under_udp(key) as (link, _, _):
                url = f"udpout://127.0.0.1:{link.address[1]}"
                out = Link(url, system=PARTNER, component=1, clock=time.time_ns, key=key)
                with contextlib.closing(out):
                    went = came = float("inf")
                    for _ in range(50):
                        begin = time.perf_counter()
                        for _ in range(number):
                            out.send(message)
                        middle = time.perf_counter()
                        assert len(link.receive(number)) == number
                        end = time.perf_counter()
                        went, came = min(went, middle - begin), min(came, end - middle)
                row += [f"{1e6 * went / number:.1f}", f"{1e6 * came / number:.1f}"]
        say(f"| {' | '.join(row)} |")
    say()
    noise = random.Random(2).randbytes(2000)
    theirs = common.MAVLink(None)
    theirs.robust_parsing = True
    rows = (
        ("frames_of", lambda: [frames_of(noise, FrameCounts()) for _ in range(100)]),
        ("pymavlink's parse_buffer", lambda: [theirs.parse_buffer(noise) for _ in range(100)]),
    )
    for name, action in rows:
        say(f"noise through {name}: {2000 / each_us(action, 100):.0f} MB/s")


def main() -> None:
    """Measure and print."""
    packets = int(sys.argv[1]) if len(sys.argv) > 1 else PACKETS
    costs()
    say()
    say(f"{packets} hostile packets each:")
    with under_udp() as (link, attacker, partner):
        report("UDP", besiege(link, attacker.send, partner.send, packets), link)
    with under_tcp() as (link, attacker, partner):
        report("TCP", besiege(link, attacker.sendall, partner.sendall, packets), link)
    for name, words in (("hostile packets", None), ("well-formed messages", heartbeat(0))):
        flood(name, words)
    worst = (b"\xfe\xff\x00\x01\x01\x00" * 400)[:2000]
    for name, under in (("UDP", under_udp), ("TCP", under_tcp)):
        with under() as (link, attacker, _):
            siege = Siege()
            for _ in range(200):
                attacker.send(worst)
            while link.wait(0.05):
                siege.call(link)
            longest = 1e3 * max(siege.calls_s)
            say(
                f"{name}: the worst of garbage, a full buffer of it: longest call {longest:.2f} ms"
            )


if __name__ == "__main__":
    main()
