"""The four triggers: the known region, the innovation, both, none."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_bench import flight, watch

from core_calls import CollisionDetector
from tombo_collision.params import TRIGGERS, DetectorParams
from tombo_dynamics.errors import InputError

P = DetectorParams()
X_C = np.array([P.region_x, P.region_y, P.region_z])
SPEED = 0.7
THROUGH = flight(7.0, (SPEED, 0.0, 0.0))
"""Flies through the region without touching anything."""
REACHED = 1.0 + P.region_x / SPEED
STEP = 1.0 / 30.0


@pytest.mark.parametrize(
    ("trigger", "by_region", "by_push"),
    [("region", 1, 0), ("innovation", 0, 1), ("both", 1, 1), ("none", 0, 0)],
)
def test_each_trigger_sees_its_own(trigger, by_region, by_push):
    assert len(watch(THROUGH, trigger=trigger)[0]) == by_region
    pushed = flight().pushed(4.0, (0.0, -1.0, 0.0))
    assert len(watch(pushed, trigger=trigger)[0]) == by_push


def test_there_are_no_other_triggers():
    assert set(TRIGGERS) == {"region", "innovation", "both", "none"}
    with pytest.raises(InputError, match=r"detector\.trigger 'regoin'.*region"):
        CollisionDetector(DetectorParams(trigger="regoin"))


@pytest.mark.slow
@settings(max_examples=60)
@given(st.floats(-3.1, 3.1), st.floats(-0.4, 0.4), st.floats(0.2, 1.5), st.integers(0, 50))
def test_region_fires_once_and_inside(heading, beside, speed, seed):
    """Flown through from any side: a cylinder of the region's depth along the flight."""
    ahead = np.array([np.cos(heading), np.sin(heading), 0.0])
    left = np.array([-np.sin(heading), np.cos(heading), 0.0])
    seconds = 1.0 + 2.0 / speed
    start = X_C + beside * left - 1.0 * ahead
    poses = flight(seconds, speed * ahead, start, seed)
    events, _ = watch(poses, trigger="region")
    if abs(beside) < P.region_radius - 0.01:
        assert len(events) == 1
        off = events[0].x_c - X_C
        along = float(off @ ahead)
        # in at its near face, at the latest by the way flown between two samples
        assert -P.region_depth - 0.02 < along < -P.region_depth + speed * STEP + 0.02
        assert abs(float(off @ left)) < P.region_radius + 0.02
        assert events[0].flight_direction @ ahead > 0.99
    elif abs(beside) > P.region_radius + 0.01:
        assert not events


def test_region_fires_again_when_it_is_left_and_reentered():
    poses = flight(20.0, (SPEED, 0.0, 0.0))
    there = 1.0 + (P.region_x + 1.5) / SPEED
    back = poses.pushed(there, (-2.0 * SPEED, 0.0, 0.0))
    events, _ = watch(back, trigger="region")
    assert [e.count for e in events] == [1, 2]
    assert events[1].flight_direction[0] < -0.99
