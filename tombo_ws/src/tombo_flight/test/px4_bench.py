"""An autopilot that says nothing but its heartbeat."""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tombo_px4.link.mavlink_link import Link
from tombo_px4.modes import AUTO_HOLD, custom_mode

PX4, QUADROTOR = 12, 2


@contextmanager
def speaking(system: int, component: int = 1, *, armed: bool = False, autopilot: int = PX4,
             kind: int = QUADROTOR, key: bytes | None = None) -> Iterator[str]:  # fmt: skip
    """An autopilot that says a heartbeat ten times a second; the URL to meet it."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    link = Link(
        f"udpout://127.0.0.1:{port}", system=system, component=component, clock=time.time_ns,
        key=key,
    )  # fmt: skip
    done = threading.Event()

    def speak() -> None:
        while not done.wait(0.1):
            base = 0x81 if armed else 0x01
            mode = custom_mode(AUTO_HOLD)
            link.send(link.mav.heartbeat_encode(kind, autopilot, base, mode, 3))

    thread = threading.Thread(target=speak)
    thread.start()
    try:
        yield f"udpin://127.0.0.1:{port}"
    finally:
        done.set()
        thread.join()
        link.close()
