"""Markers mixed up: a pose that no strike can explain is not a collision."""

import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from pose_bench import Poses, flight, watch
from scipy.spatial.transform import Rotation

from core_calls import CollisionDetector
from tombo_collision.params import DetectorParams
from tombo_dynamics.input_check import PoseRefusal

SWAPPED = 75
"""Index of the first sample that is displaced."""
vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
directions = vectors.filter(lambda v: np.linalg.norm(v) > 0.1).map(lambda v: v / np.linalg.norm(v))
sizes = st.floats(0.2, 3.0)


def displaced(poses, begin, end, offset=(0.0, 0.0, 0.0), turn=(0.0, 0.0, 0.0)):
    """The samples begin:end are of the other body: put elsewhere, and turned."""
    position, attitude = poses.position.copy(), poses.attitude.copy()
    position[begin:end] += offset
    turned = Rotation.from_quat(attitude[begin:end]) * Rotation.from_rotvec(turn)
    attitude[begin:end] = turned.as_quat()
    return Poses(poses.t, position, attitude)


def refusals(poses, **params):
    """Why each sample was refused, and the events."""
    detector = CollisionDetector(DetectorParams(**params))
    reasons, events = [], []
    for t, position, attitude in zip(poses.t, poses.position, poses.attitude, strict=True):
        event = detector.update(float(t), position, attitude)
        reasons.append(detector.refused)
        if event is not None:
            events.append(event)
    return reasons, events


@settings(max_examples=30)
@given(directions, sizes, st.integers(1, 2), st.integers(0, 50), st.sampled_from([0.0, 0.7, 2.0]))
def test_a_swap_for_a_sample_or_two_never_happened(direction, size, length, seed, speed):
    swap = slice(SWAPPED, SWAPPED + length)
    size = max(size, 0.06 + (3.0 + speed) / 30.0)
    poses = flight(velocity=(speed, 0.0, 0.0), seed=seed)
    reasons, events = refusals(displaced(poses, swap.start, swap.stop, size * direction))
    assert not events
    assert [i for i, r in enumerate(reasons) if r] == list(range(swap.start, swap.stop))
    assert set(reasons[swap]) == {PoseRefusal.JUMP}


@pytest.mark.slow
@settings(max_examples=30)
@given(directions, sizes, st.integers(0, 50))
def test_a_swap_that_stays_starts_the_filter_again_there(direction, size, seed):
    direction[2] = abs(direction[2])  # it must stay above the height at which it watches
    poses = displaced(flight(8.0, seed=seed), SWAPPED, None, size * direction)
    reasons, events = refusals(poses)
    assert not events
    assert [i for i, r in enumerate(reasons) if r] == [SWAPPED, SWAPPED + 1]
    # a strike later on is found, and put where the vehicle now is
    struck = poses.pushed(6.0, (-1.5, 0.0, 0.0))
    (event,) = watch(struck)[0]
    assert event.stamp_s == pytest.approx(6.0, abs=0.07)
    assert event.x_c == pytest.approx([*(size * direction + [0.0, 0.0, 2.0])], abs=0.06)


@pytest.mark.parametrize("turn", [(0, 0, 0.5 * math.pi), (0, 0, math.pi), (math.pi, 0, 0)])
@pytest.mark.parametrize("length", [1, 2, 3, 20, 100])
def test_a_body_seen_turned_raises_no_alarm(turn, length):
    for seed in range(5):
        straight = flight(8.0, velocity=(0.7, 0.0, 0.0), seed=seed)
        poses = displaced(straight, SWAPPED, SWAPPED + length, turn=turn)
        reasons, events = refusals(poses)
        assert not events
        refused = [i for i, reason in enumerate(reasons) if reason == PoseRefusal.JUMP]
        assert refused[: min(length, 2)] == [SWAPPED, SWAPPED + 1][: min(length, 2)]


@pytest.mark.parametrize("rate", [3.0, 8.0, 15.0])
def test_a_vehicle_that_rolls_over_has_not_jumped(rate):
    poses = flight(8.0)
    turns = Rotation.from_rotvec(
        np.outer(np.clip(poses.t - 4.0, 0.0, math.pi / rate), [rate, 0, 0])
    )
    over = Poses(poses.t, poses.position, (Rotation.from_quat(poses.attitude) * turns).as_quat())
    reasons, events = refusals(over)
    assert not any(reasons)
    assert len(events) <= 1


@pytest.mark.slow
@settings(max_examples=30)
@given(
    vectors.filter(lambda v: 0.3 < np.linalg.norm(v) <= 1.0),
    st.floats(0.0, 4.0),
    st.sampled_from([15.0, 30.0, 100.0, 240.0]),
)
def test_what_a_strike_can_do_is_no_jump(way, speed, rate):
    """It takes away the speed there was, and gives up to 3 m/s."""
    push = np.array([-speed, 0.0, 0.0]) + 2.9 * way
    assume(np.linalg.norm(push) > 0.8)  # the two may cancel, which is not a strike
    poses = flight(velocity=(speed, 0.0, 0.0), rate=rate).pushed(4.0, push)
    reasons, events = refusals(poses)
    assert not any(reasons)
    assert len(events) == 1


def test_a_swap_into_the_known_region_is_no_entry():
    p = DetectorParams(trigger="region")
    centre = np.array([p.region_x, p.region_y, p.region_z])
    poses = displaced(flight(start=(0.5, 0.0, 2.0)), SWAPPED, None, centre - [0.5, 0.0, 2.0])
    assert not watch(poses, trigger="region")[0]


def test_started_in_flight_it_watches_at_once():
    poses = flight().pushed(4.0, (-1.5, 0.0, 0.0))
    in_flight = poses.without(poses.t > 2.0)
    assert len(watch(in_flight)[0]) == 1
    assert not watch(in_flight, floor_height=1.5)[0]
