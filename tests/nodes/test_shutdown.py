"""The suite ends when it is told to: all processes gone, exit 0, no traceback."""

from __future__ import annotations

import os
import signal
import time

import pytest

from in_time import in_time
from ros_bench import NodeProcess

pytest.importorskip("rclpy")

NODES = (
    "tombo_sim.sim_node",
    "tombo_control.estimator_node",
    "tombo_control.controller_node",
    "tombo_control.mission_node",
    "tombo_collision.detector_node",
    "tombo_collision.reaction_node",
    "tombo_ros.recorder_node",
)


@pytest.mark.real_time
def test_the_whole_suite_is_gone_within_three_seconds(start, tmp_path):
    """Every other node is told by SIGTERM, the others by Ctrl-C, twice."""
    processes: list[NodeProcess] = []
    for module in NODES:
        more = ("-p", f"output:={tmp_path / 'bag'}") if "recorder" in module else ()
        processes.append(start(module, "-p", "use_sim_time:=false", *more))
    until = time.monotonic() + 60.0
    while not all("running" in node.output for node in processes):
        assert time.monotonic() < until, [n.module for n in processes if "running" not in n.output]
        time.sleep(0.05)
    time.sleep(0.5)
    began = time.monotonic()
    for node in processes[::2]:
        os.killpg(node.process.pid, signal.SIGTERM)
    for _ in range(2):
        for node in processes[1::2]:
            os.killpg(node.process.pid, signal.SIGINT)  # as Ctrl-C does it
        time.sleep(0.05)
    codes = {node.module: node.process.wait(60.0) for node in processes}
    with in_time():
        assert time.monotonic() - began < 3.0
    assert set(codes.values()) == {0}, codes
    assert not any("Traceback" in node.output for node in processes)
