"""The innovation trigger: normal flight, detections, and their place."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_bench import flight, watch

from tombo_collision.params import DetectorParams

P = DetectorParams()
STEP = 1.0 / 30.0
AT = 4.0
settled = slice(60, None)
"""Samples of a made-up flight in the air, with the filter settled."""


@pytest.mark.parametrize("velocity", [(0.0, 0.0, 0.0), (0.7, 0.0, 0.0), (-1.0, 0.5, 0.2)])
def test_an_undisturbed_flight_stays_far_below_the_threshold(velocity):
    events, statistic = watch(flight(60.0, velocity))
    assert not events
    assert statistic[settled].max() < 0.3 * P.threshold
    assert 0.2 < statistic[settled].mean() < 6.0


directions = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
sideways = directions.map(lambda v: v * [1.0, 1.0, 0.0]).filter(lambda v: np.linalg.norm(v) > 0.2)


@settings(max_examples=40)
@given(sideways, st.floats(0.8, 3.0), st.integers(0, 100))
def test_a_push_is_found_within_two_samples_and_put_where_it_was(direction, size, seed):
    push = size * direction / np.linalg.norm(direction)
    poses = flight(velocity=(0.7, 0.0, 0.0), seed=seed).pushed(AT, push)
    events, _ = watch(poses)
    assert len(events) == 1
    event = events[0]
    assert AT < event.stamp_s < AT + 2.0 * STEP + 1e-6
    where = np.array([0.7 * (AT - 1.0), 0.0, 2.0])
    assert np.linalg.norm(event.x_c - where) < 0.03 + 0.02 * size
    assert abs(event.contact_time_s - AT) < 1.5 * STEP
    assert event.contact_time_s < event.stamp_s  # between two samples
    assert event.flight_direction @ [1.0, 0.0, 0.0] > math.cos(0.05)
    assert event.trigger == "innovation"


@settings(max_examples=40)
@given(sideways, st.integers(0, 100))
def test_struck_at_rest_the_obstacle_is_where_the_push_comes_from(direction, seed):
    push = 1.5 * direction / np.linalg.norm(direction)
    events, _ = watch(flight(seed=seed).pushed(AT, push))
    assert len(events) == 1
    assert events[0].flight_direction @ push < -1.5 * math.cos(0.2)


@pytest.mark.parametrize("rates", [(0, 0, 3.0), (0, 0, -3.0), (9.0, 0, 0), (0, -9.0, 0)])
def test_a_kick_in_attitude_is_found(rates):
    events, _ = watch(flight().rotate(AT, rates))
    assert len(events) == 1
    assert AT < events[0].stamp_s < AT + 3.0 * STEP


@pytest.mark.parametrize("rate", [15.0, 30.0, 60.0, 100.0, 240.0])
def test_it_is_not_fooled_by_the_rate_of_the_mocap(rate):
    """Rates from two attitudes are the noisier the closer these are."""
    quiet, _ = watch(flight(20.0, (0.7, 0.0, 0.0), rate=rate))
    assert not quiet
    pushed, _ = watch(flight(velocity=(0.7, 0.0, 0.0), rate=rate).pushed(AT, (-1.0, -0.5, 0.0)))
    assert len(pushed) == 1
    assert AT < pushed[0].stamp_s < AT + 0.11
    assert pushed[0].flight_direction[0] > 0.99


def test_nothing_is_said_below_the_arming_height():
    low = flight(start=(0.0, 0.0, 0.18 + 0.7)).pushed(AT, (-2.0, 0.0, 0.0))
    high = flight(start=(0.0, 0.0, 0.18 + 0.9)).pushed(AT, (-2.0, 0.0, 0.0))
    assert not watch(low)[0]
    assert len(watch(high)[0]) == 1


def test_one_event_for_one_strike_and_another_for_the_next():
    twice = flight(10.0).pushed(AT, (-1.0, 0.0, 0.0))
    soon = twice.pushed(AT + 0.5 * P.holdoff, (2.0, 0.0, 0.0))
    later = twice.pushed(AT + 1.5 * P.holdoff, (2.0, 0.0, 0.0))
    assert [e.count for e in watch(soon)[0]] == [1]
    events, _ = watch(later)
    assert [e.count for e in events] == [1, 2]
    # the second event carries the flight between the two
    assert events[1].flight_direction @ [-1.0, 0.0, 0.0] > math.cos(0.05)
    assert events[1].x_c[0] == pytest.approx(-1.5 * P.holdoff, abs=0.05)
