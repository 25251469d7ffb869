"""The innovation trigger: normal flight, detections, and their place."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pose_bench import Poses, flight, watch
from scipy.spatial.transform import Rotation

from core_calls import CollisionDetector
from tombo_collision.params import DetectorParams
from tombo_dynamics.vehicle import GRAVITY

P = DetectorParams()
STEP = 1.0 / 30.0
AT = 4.0
settled = slice(60, None)
"""Samples of a made-up flight in the air, with the filter settled."""


def modelled_flight(params, seed, samples=150):
    """A flight drawn from the filter's own model of a free flight."""
    rng = np.random.default_rng(seed)
    step = 0.033
    acceleration = np.array([params.acceleration_xy] * 2 + [params.acceleration_z])
    turning = np.array([params.tilt_acceleration] * 2 + [params.yaw_acceleration])
    position, velocity, rates = np.array([0.0, 0.0, 2.0]), np.zeros(3), np.zeros(3)
    attitude = Rotation.identity()
    poses = []
    for k in range(samples):
        seen = position + params.position_noise * rng.standard_normal(3)
        poses.append((k * step, seen, attitude.as_quat()))
        rates = rates + turning * step * rng.standard_normal(3)
        before = attitude.as_quat()
        noisy = rates + params.rate_noise * rng.standard_normal(3)
        attitude = attitude * Rotation.from_rotvec(noisy * step)
        z = Rotation.from_quat(before + attitude.as_quat()).apply([0.0, 0.0, 1.0])
        push = GRAVITY * np.array([z[0] / z[2], z[1] / z[2], 0.0])
        push = push + acceleration * rng.standard_normal(3)
        position = position + step * velocity + 0.5 * step**2 * push
        velocity = velocity + step * push
    t, where, how = zip(*poses, strict=True)
    return Poses(np.array(t), np.array(where), np.array(how))


def test_statistic_of_its_own_model_has_six_degrees_of_freedom():
    """A filter that is consistent: mean 6, and 1 % above the 99th percentile of chi2."""
    slow = replace(P, trigger="none", tilt_acceleration=0.2, yaw_acceleration=0.2, rate_noise=0.02)
    seen = np.concatenate(
        [watch(modelled_flight(slow, seed), CollisionDetector(slow))[1][40:] for seed in range(20)]
    )
    assert seen.mean() == pytest.approx(6.0, rel=0.06)
    assert (seen > 16.81).mean() == pytest.approx(0.01, abs=0.007)


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
    events, _ = watch(flight().turned(AT, rates))
    assert len(events) == 1
    assert AT < events[0].stamp_s < AT + 3.0 * STEP


def test_confidence_is_a_share_that_rises_with_the_statistic():
    pairs = []
    for size in np.geomspace(0.3, 4.0, 60):
        for event in watch(flight().pushed(AT, (-size, 0.0, 0.0)))[0][:1]:
            pairs.append((event.statistic, event.confidence))
    pairs.sort()
    statistic, confidence = np.array(pairs).T
    assert len(pairs) > 30
    assert (statistic > P.threshold).all()
    assert (np.diff(confidence) >= 0.0).all()
    assert confidence[0] >= 0.5
    assert confidence[-1] <= 1.0
    assert confidence[-1] > 0.999


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
