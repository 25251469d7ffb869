"""Poses are judged by the time at which they were received, not by when the loop got to them."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="rclpy is not installed")

from tombo_collision.detector_core import DetectorCore
from tombo_collision.params import DetectorParams
from tombo_dynamics.core import CoreRunner
from tombo_dynamics.messages import Pose
from tombo_ros.core_node import CoreNode
from tombo_ros.topic import ReceivedMessage

MS = 1_000_000
NOW = 1_763_700_000_000 * MS
LEVEL = np.array([0.0, 0.0, 0.0, 1.0])


def refused(captured_ms: int, received_ms: int, *, sim_time: bool = False) -> str:
    """A detector's answer to a pose, by the ages of its capture and its arrival."""
    core = DetectorCore(DetectorParams())
    runner = CoreRunner(core)
    node = SimpleNamespace(runner=runner, sim_time=sim_time, present_ns=lambda: NOW)
    node.decode = lambda source, data, arrival_ns: runner.take(source.topic, data, arrival_ns)
    source = SimpleNamespace(
        topic="/mocap/pose",
        several=False,
        subscription=SimpleNamespace(multiple_publishers=lambda wall_ns: False),
    )
    pose = Pose(NOW - captured_ms * MS, "map", np.zeros(3), LEVEL)
    taken = [(source, [ReceivedMessage(pose, NOW - received_ms * MS)])]
    assert CoreNode._deliver_messages(node, taken) == NOW
    return " ".join(core.refused)


@pytest.mark.parametrize("behind_ms", [0, 40, 4600])
def test_how_late_the_loop_is_does_not_count(behind_ms: int) -> None:
    assert refused(behind_ms + 8, behind_ms) == ""
    assert refused(behind_ms - 8, behind_ms) == "future"
    assert refused(behind_ms + 600, behind_ms) == "late"


def test_in_simulated_time_it_is_the_present_that_counts() -> None:
    assert refused(8, 4600, sim_time=True) == ""
    assert refused(600, 0, sim_time=True) == "late"
