"""What mocap may deliver: nothing, the same twice, the past, no numbers, either sign."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_bench import Poses, flight, watch

from core_calls import CollisionDetector
from tombo_collision.params import DetectorParams

STRUCK = flight(velocity=(0.7, 0.0, 0.0)).pushed(4.0, (-1.0, -0.4, 0.0))
EXPECTED = watch(STRUCK)


def inserted(samples):
    """The struck flight with samples [(index, t, position, attitude)] before those indices."""
    t, position, attitude = list(STRUCK.t), list(STRUCK.position), list(STRUCK.attitude)
    for index, *sample in sorted(samples, key=lambda s: -s[0]):
        for column, value in zip((t, position, attitude), sample, strict=True):
            column.insert(index, value)
    return Poses(np.array(t), np.array(position), np.array(attitude))


def assert_same_events(events):
    assert len(events) == len(EXPECTED[0]) == 1
    for name, value in EXPECTED[0][0]._asdict().items():
        assert np.array_equal(getattr(events[0], name), value), name


@settings(max_examples=40)
@given(
    st.integers(0, 7),
    st.lists(st.integers(1, len(STRUCK) - 1), min_size=1, max_size=5, unique=True),
    st.sampled_from([math.nan, math.inf, -math.inf]),
)
def test_a_sample_that_is_not_finite_never_happened(place, where, value):
    spoilt = []
    for i in where:
        sample = np.concatenate([[STRUCK.t[i]], STRUCK.position[i], STRUCK.attitude[i]])
        sample[place] = value
        spoilt.append((i, sample[0], sample[1:4], sample[4:]))
    assert_same_events(watch(inserted(spoilt))[0])


@pytest.mark.parametrize("age", [0.0, 0.001, 0.033, 0.2])
def test_a_sample_that_is_late_or_doubled_never_happened(age):
    extra = [
        (i, STRUCK.t[i - 1] - age, STRUCK.position[i - 1] + 0.5, STRUCK.attitude[i - 1])
        for i in range(20, 150, 7)
    ]
    assert_same_events(watch(inserted(extra))[0])


def test_the_sign_of_the_quaternion_does_not_matter():
    rng = np.random.default_rng(1)
    signs = rng.choice([-1.0, 1.0], len(STRUCK))[:, None]
    events, statistic = watch(Poses(STRUCK.t, STRUCK.position, signs * STRUCK.attitude))
    assert_same_events(events)
    assert np.array_equal(statistic, EXPECTED[1])


@pytest.mark.parametrize(("missing", "restarts"), [(0.2, False), (0.4, True)])
def test_a_long_gap_starts_the_filter_again(missing, restarts):
    """Whatever happened in the gap is no collision: after it the filter settles first."""
    quiet = flight(8.0, (0.7, 0.0, 0.0))
    moved = quiet.pushed(4.0, (3.0, 0.0, 0.0)).pushed(4.0 + missing, (-3.0, 0.0, 0.0))
    with_gap = moved.without((quiet.t <= 4.0) | (quiet.t > 4.0 + missing))
    events, statistic = watch(with_gap)
    after = with_gap.t > 4.0
    if restarts:
        assert not events
        assert (statistic[after][:8] == 0.0).all()
        assert statistic[after][15:].mean() > 0.2
    else:
        assert len(events) == 1
    # and a strike later on is found
    later = with_gap.pushed(7.0, (-1.5, 0.0, 0.0))
    assert watch(later)[0][-1].stamp_s == pytest.approx(7.0, abs=0.07)


def test_short_dropouts_raise_no_alarm():
    rng = np.random.default_rng(3)
    poses = flight(60.0, (0.4, 0.0, 0.0))
    assert not watch(poses.without(rng.random(len(poses)) > 0.4))[0]


@pytest.mark.parametrize("jump", [-100.0, 100.0])
def test_a_clock_that_is_set_does_not_deafen_it(jump):
    poses = flight(12.0, (0.7, 0.0, 0.0)).pushed(10.0, (-1.0, 0.0, 0.0))
    stamps = np.where(poses.t < 5.0, poses.t, poses.t + jump)
    events, _ = watch(Poses(stamps, poses.position, poses.attitude))
    assert [e.stamp_s for e in events] == [pytest.approx(10.0 + jump, abs=0.07)]


def test_one_stamp_from_far_ahead_does_not_deafen_it():
    i = 60
    wild = inserted([(i, 1e6, STRUCK.position[i], STRUCK.attitude[i])])
    events, _ = watch(wild)
    assert [e.stamp_s for e in events] == [EXPECTED[0][0].stamp_s]


def test_the_caller_may_use_its_arrays_again():
    detector = CollisionDetector(DetectorParams())
    position, attitude = np.zeros(3), np.zeros(4)
    events = []
    for t, p, q in zip(STRUCK.t, STRUCK.position, STRUCK.attitude, strict=True):
        position[:], attitude[:] = p, q
        event = detector.update(float(t), position, attitude)
        if event is not None:
            events.append(event)
        position[:], attitude[:] = math.nan, math.nan
    assert_same_events(events)
