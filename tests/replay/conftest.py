"""Recorded flights of the repository, and recordings made up for a test."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tombo_flight.replay.run import Replay, Request, replay_bag

BAGS = Path(__file__).parents[2] / "tests" / "bags"


@pytest.fixture
def replayed() -> Callable[..., Replay]:
    """Replay a flight of tests/bags: `replayed("aggressive_2", "detector.threshold=5")`."""

    def replay(name: str, *settings: str, **request: object) -> Replay:
        return replay_bag(BAGS / f"{name}.mcap", Request(settings=settings, **request))

    return replay
