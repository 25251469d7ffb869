"""The simulator link as a node, driven by a PX4 stand-in: the lab's view of it."""

from __future__ import annotations

import itertools
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from in_time import in_time

pytest.importorskip("rclpy")

from tombo_bag.topics import IMU, MOCAP_POSE, TRUE_ODOMETRY
from tombo_ros.conversion import to_ns

NODE = "tombo_px4.hil_sim_node"
SRC = Path(__file__).parents[2] / "tombo_ws" / "src"
PEER = SRC / "tombo_px4" / "test" / "autopilot" / "hil_peer.py"
MS = 1_000_000


@pytest.fixture
def port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


@contextmanager
def px4(port: int) -> Iterator[None]:
    with subprocess.Popen([sys.executable, str(PEER), str(port), "60"]) as peer:
        try:
            yield
        finally:
            peer.kill()


def heights(world, seconds: float) -> list[float]:
    """True heights of a span of time."""
    begun = len(world.heard[TRUE_ODOMETRY.name])
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        world.hear()
        time.sleep(0.01)
    return [m.pose.pose.position.z for m in world.heard[TRUE_ODOMETRY.name][begun:]]


@pytest.mark.real_time
def test_a_px4_lifts_it_and_the_mocap_sees_it(world, start, port):
    world.subscribe(MOCAP_POSE, TRUE_ODOMETRY)
    node = start(NODE, "-p", f"port:={port}")
    world.meet(MOCAP_POSE, TRUE_ODOMETRY)
    assert heights(world, 0.5) == [], "time goes on without PX4"

    with px4(port):
        first = world.wait_for(TRUE_ODOMETRY)
        assert first.pose.pose.position.z == pytest.approx(0.18, abs=0.05)
        world.wait_for(TRUE_ODOMETRY, lambda m: m.pose.pose.position.z > 0.5)
        stamps = [to_ns(m.header.stamp) for m in world.heard[MOCAP_POSE.name]]
        gaps = [(b - a) / MS for a, b in itertools.pairwise(stamps)]
        with in_time():
            assert sorted(gaps)[len(gaps) // 2] == pytest.approx(33.3, abs=3.0)
            assert abs(time.time_ns() - stamps[-1]) < 2_000 * MS
        assert world.node.count_publishers(IMU.name) == 0, "PX4 has the sensors"

    # that flight is over; the next one begins on the ground
    with px4(port):
        world.wait_for(TRUE_ODOMETRY, lambda m: abs(m.pose.pose.position.z - 0.18) < 0.05)
    assert node.end() == 0
    assert "flight 2 begins" in node.output
