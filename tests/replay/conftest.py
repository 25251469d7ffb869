"""Recorded flights of the repository, and recordings made up for a test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tombo_bag.recording import Recording
from tombo_flight.replay.poses import PoseTrack, read_poses
from tombo_flight.replay.run import Replay, ReplayRequest, replay_bag

BAGS = Path(__file__).parents[2] / "tests" / "bags"


@pytest.fixture(scope="session")
def poses() -> Callable[[str], PoseTrack]:
    """The poses of a flight of tests/bags."""

    def read(name: str) -> PoseTrack:
        with Recording(BAGS / f"{name}.mcap") as recording:
            return read_poses(recording, "/mocap/pose")

    return read


@pytest.fixture(scope="session")
def flight(poses: Callable[[str], PoseTrack]) -> PoseTrack:
    return poses("paper_collision_7")


@pytest.fixture
def replayed() -> Callable[..., Replay]:
    """Replay a flight of tests/bags: `replayed("aggressive_2", "detector.threshold=5")`."""

    def replay(name: str, *settings: str, **request: object) -> Replay:
        return replay_bag(BAGS / f"{name}.mcap", ReplayRequest(settings=settings, **request))

    return replay
