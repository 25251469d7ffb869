"""`tombo px4` as a process of its own, on ports that are free."""

from __future__ import annotations

import random
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

PATIENCE_S = 120.0
"""The first start after a change of compiled code compiles."""
TOMBO = (sys.executable, "-m", "tombo_bringup.cli.main", "px4")


class Px4Process(NamedTuple):
    process: subprocess.Popen[str]
    port: int
    ground_port: int


def free_ports() -> tuple[int, int]:
    """Ports of the client and of the ground station; the vehicle's own belong to the first."""
    for _ in range(200):
        port = random.randrange(20000, 55000)
        wanted = (port, port + 1, port + 40, port + 4030)
        sockets = [socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in wanted]
        try:
            for s, number in zip(sockets, wanted, strict=True):
                s.bind(("127.0.0.1", number))
        except OSError:
            continue
        finally:
            for s in sockets:
                s.close()
        return port, port + 1
    raise RuntimeError("no free ports")


def read_until(process: subprocess.Popen[str], words: str) -> list[str]:
    """The lines of standard output up to one with these words."""
    assert process.stdout is not None
    lines: list[str] = []
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        line = process.stdout.readline()
        assert line, f"it ended after {lines}"
        lines.append(line.rstrip("\n"))
        if words in line:
            return lines
    raise AssertionError(f"'{words}' did not come, but {lines}")


@contextmanager
def px4_process(*options: str) -> Iterator[Px4Process]:
    """Start it, wait until it is ready, and stop it in the end."""
    port, ground_port = free_ports()
    command = [*TOMBO, "--port", str(port), "--ground-port", str(ground_port), *options]
    process = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    try:
        read_until(process, "Ctrl-C")
        yield Px4Process(process, port, ground_port)
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            process.communicate(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
