"""Turned by hand, the poses must say what the gyro says; other answers are named."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tombo_dynamics.rotation import conjugate, quaternion_multiply, rotate_vector
from tombo_px4.bridge.axes_proof import judge_hand_motion
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.checklist import Checklist
from tombo_px4.link.messages import VehicleImu

NOW = 1_763_700_000_000_000_000
MS = 1_000_000
UP = np.array([0.0, 0.0, 9.81])


@functools.cache
def hand(axes=(1.0, 0.7, 0.8), speed=1.5, seconds=8.0):
    """Attitudes and body rates at 1 kHz of a vehicle that is turned to and fro."""
    t = np.arange(0.0, seconds, 1e-3)
    rates = speed * np.stack(
        [
            axes[0] * np.sin(2.1 * t),
            axes[1] * np.sin(1.7 * t + 1.0),
            axes[2] * np.sin(1.3 * t + 2.0),
        ],
        axis=1,
    )
    q = np.array([0.0, 0.0, 0.3, 0.954])
    attitudes = []
    for w in rates:
        angle = np.linalg.norm(w) * 1e-3
        axis = w / max(np.linalg.norm(w), 1e-12)
        q = quaternion_multiply(q, np.append(np.sin(angle / 2) * axis, np.cos(angle / 2)))
        attitudes.append(q)
    return np.array(attitudes), rates


def specific_force(attitude):
    """The specific force of a vehicle that is turned on the spot, base_link."""
    return rotate_vector(conjugate(attitude), UP)


def checklist_of(motion, as_mocap=lambda q: q, delay_s=0.0, noise=0.002, rate=50):
    """The samples of a motion: poses, stamped `delay_s` late, and a gyro at 100 Hz."""
    attitudes, rates = motion
    rng = np.random.default_rng(2)
    checklist = Checklist(BridgeParams())
    begin = NOW - len(rates) * MS
    for k in range(0, len(rates), 10):
        gyro, force = rates[k] + rng.normal(0, 0.01, 3), specific_force(attitudes[k])
        at = begin + k * MS
        checklist.take_imu(VehicleImu(at, at, at, gyro, force), None, False)
    for k in range(0, len(rates), 1000 // rate):
        q = as_mocap(attitudes[k])
        shaken = quaternion_multiply(q, np.append(rng.normal(0, 0.5 * noise, 3), 1.0))
        stamp = begin + k * MS + round(delay_s * 1e9)
        if stamp <= NOW:
            checklist.poses.add(stamp, stamp, np.zeros(3), shaken / np.linalg.norm(shaken))
    return checklist


def verdict_of(*args, **options):
    checklist = checklist_of(*args, **options)
    return judge_hand_motion(checklist.poses.since(0), checklist.imu.since(0), 0.17)


@pytest.mark.slow
@settings(max_examples=15)
@given(st.floats(-0.04, 0.25), st.sampled_from([30, 50, 100]))
def test_the_delay_of_the_stamps_is_measured(delay, rate):
    verdict = verdict_of(hand(), delay_s=delay, rate=1000 // (1000 // rate))
    assert verdict.mistake == ""
    assert verdict.delay_s == pytest.approx(delay, abs=0.008)


@pytest.mark.parametrize("axes", [(1.0, 0, 0), (0, 1.0, 0), (0, 0, 1.0)])
def test_turning_about_one_axis_proves_nothing(axes):
    verdict = verdict_of(hand(axes), lambda q: q * [1, 1, -1, 1])
    assert not verdict.mistake and not verdict.proven


@pytest.mark.parametrize(
    ("as_mocap", "words"),
    [
        (lambda q: q * [1, 1, -1, 1], "otherwise than PX4's gyro"),
        (conjugate, "otherwise than PX4's gyro"),
        (lambda q: np.roll(q, 1), "otherwise than PX4's gyro"),
        (
            lambda q: quaternion_multiply(q, np.array([0.0, 0.0, 0.5**0.5, 0.5**0.5])),
            "turned by 90 deg about (0.0, 0.0, 1.0)",
        ),
        (
            lambda q: quaternion_multiply(q, np.array([-(0.5**0.5), 0.0, 0.0, 0.5**0.5])),
            "turned by 90 deg about (-1.0, 0.0, 0.0)",
        ),
    ],
)
def test_wrong_attitudes_are_named(as_mocap, words):
    assert words in verdict_of(hand(), as_mocap).mistake


@pytest.mark.parametrize("motion", [hand(speed=0.02), hand(seconds=0.6)])
def test_without_turning_there_is_no_verdict(motion):
    assert verdict_of(motion) is None


@pytest.mark.slow
def test_poses_of_something_else_are_named_without_certainty():
    other, _ = hand((0.3, 1.0, -0.5))
    _, rates = hand()
    verdict = verdict_of((other[::-1], rates))
    assert "otherwise than PX4's gyro" in verdict.mistake and not verdict.sure
