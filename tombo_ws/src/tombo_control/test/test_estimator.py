"""The estimator: late mocap costs no phase, bad samples change nothing, poles as designed."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from control_bench import UPRIGHT, fresh_autopilot
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tombo_control.estimator import correct, predict, store_history, update_body_rates
from tombo_control.params import EstimatorParams
from tombo_dynamics.vehicle import GRAVITY

TICK = 1e-3
PERIOD = 33
"""Ticks between mocap samples, at about 30 Hz."""
E = EstimatorParams()


@dataclass
class Motion:
    """Truth at 1 kHz: position, velocity, attitude, and readings of a perfect IMU."""

    position: np.ndarray
    velocity: np.ndarray
    attitude: np.ndarray
    imu: np.ndarray


def motion(seconds, brisk=1.0):
    """Fly curves of metres per second with tilts of half a radian; `brisk` 0 is a hover."""
    t = np.arange(round(seconds / TICK) + 1) * TICK
    size = brisk * np.array([1.2, 0.9, 0.5])
    w = np.array([1.3, 1.7, 1.1])
    angle = t[:, None] * w
    position = size * np.sin(angle)
    velocity = size * w * np.cos(angle)
    acceleration = -size * w * w * np.sin(angle)
    turns = brisk * np.column_stack([0.8 * np.sin(0.7 * t), 0.5 * np.sin(2.1 * t), 0.4 * t])
    rotation = Rotation.from_euler("xyz", turns)
    rates = (rotation[:-1].inv() * rotation[1:]).as_rotvec() / TICK
    force = rotation.inv().apply(acceleration + np.array([0.0, 0.0, GRAVITY]))
    imu = np.column_stack([np.vstack([rates, rates[-1:]]), force])
    return Motion(position, velocity, rotation.as_quat(), imu)


def estimate(
    truth,
    latency=10,
    seed=0,
    mocap=(0.0, 0.0),
    noise=(0.0, 0.0),
    bias=(0.0, 0.0),
    gap=(0, 0),
    stamped=True,
    a=None,
):
    """Run the estimator along a motion; return it and its position and velocity at each tick.

    Args:
        truth: the motion.
        latency: ticks from capture to arrival.
        seed: of the noise.
        mocap: noise of position [m] and attitude [rad].
        noise: of gyro [rad/s] and accelerometer [m/s^2].
        bias: of the same.
        gap: first and last tick without mocap.
        stamped: False: the estimator takes arrival as the time of capture.
        a: a memory to begin with.
    """
    rng = np.random.default_rng(seed)
    n = truth.position.shape[0]
    imu = truth.imu + np.repeat(bias, 3) + np.repeat(noise, 3) * rng.standard_normal((n, 6))
    if a is None:
        a = fresh_autopilot(position=truth.position[0], attitude=truth.attitude[0])
        a.state.velocity[:] = truth.velocity[0]
    due: dict[int, list[int]] = {}
    for captured in range(0, n, PERIOD):
        if not gap[0] <= captured < gap[1]:
            due.setdefault(captured + latency, []).append(captured)
    shake = rng.standard_normal((n, 6)) * np.repeat(mocap, 3)
    out = np.zeros((n, 6))
    last = 0
    for k in range(n):
        store_history(a.state, a.history, k)
        for captured in due.get(k, []):
            pose = np.empty(7)
            pose[:3] = truth.position[captured] + shake[captured, :3]
            turned = Rotation.from_quat(truth.attitude[captured])
            pose[3:] = (turned * Rotation.from_rotvec(shake[captured, 3:])).as_quat()
            stamp = captured if stamped else k
            assert correct(a, pose[:3], pose[3:], stamp, k, (stamp - last) * TICK, True)
            last = max(last, stamp)
        out[k, :3] = a.state.position
        out[k, 3:] = a.state.velocity
        update_body_rates(a.state, imu[k, :3])
        predict(a.state, imu[k, 3:], True)
    return a, out


def error(truth, out, since=3.0):
    """RMS error of position [m] and velocity [m/s] from `since` [s] on."""
    k = round(since / TICK)
    true = np.column_stack([truth.position, truth.velocity])
    square = ((out - true)[k:] ** 2).mean(axis=0)
    return math.sqrt(square[:3].sum()), math.sqrt(square[3:].sum())


REAL = {"mocap": (0.0007, 0.002), "noise": (0.01, 0.3), "bias": (0.01, 0.1)}
CURVES = motion(8.0)


@pytest.mark.slow
def test_late_samples_cost_no_phase():
    at_once = error(CURVES, estimate(CURVES, latency=0, **REAL)[1])
    assert at_once[0] < 0.002
    for latency in (10, 50, 100):
        late = error(CURVES, estimate(CURVES, latency=latency, **REAL)[1])
        # only the noise since the last sample that is known, not the way flown since
        assert late[0] < at_once[0] + latency * TICK * 2.0 * at_once[1]
        assert late[1] < 1.5 * at_once[1]
    # the same samples taken for fresh ones trail the motion by the latency
    unstamped = error(CURVES, estimate(CURVES, latency=100, stamped=False, **REAL)[1])
    assert unstamped[0] > 10.0 * at_once[0]


def test_converges_from_a_wrong_start_and_finds_the_biases():
    truth = motion(20.0, brisk=0.3)
    a = fresh_autopilot(position=truth.position[0] + [0.3, -0.2, 0.1], attitude=truth.attitude[0])
    a.state.velocity[:] = 1.0, -1.0, 0.5
    bias = (0.05, 0.4)
    a, out = estimate(truth, bias=bias, a=a)
    assert error(truth, out, since=10.0)[0] < 5e-3
    assert np.allclose(a.state.gyro_bias, bias[0], atol=0.01)
    assert np.allclose(a.state.accel_bias, bias[1], atol=0.1)


def test_bridges_a_gap_of_mocap():
    begin, end = 4000, 4300
    _, out = estimate(CURVES, gap=(begin, end), **REAL)
    distance = np.linalg.norm(out[:, :3] - CURVES.position, axis=1)
    assert distance[begin : end + 50].max() < 0.01
    assert distance[end + 1000 :].max() < 0.005


def error_after_a_period(deviation):
    """Error of position, velocity, attitude, gyro and accelerometer bias, one sample later."""
    a = fresh_autopilot(position=deviation[:3])
    a.state.velocity[:] = deviation[3:6]
    a.state.attitude[:] = Rotation.from_rotvec(deviation[6:9]).as_quat()
    a.state.gyro_bias[:] = deviation[9:12]
    a.state.accel_bias[:] = deviation[12:15]
    imu = np.array([0.0, 0.0, 0.0, 0.0, 0.0, GRAVITY])
    for _ in range(PERIOD):
        update_body_rates(a.state, imu[:3])
        predict(a.state, imu[3:], True)
    store_history(a.state, a.history, PERIOD)
    pose = np.append(np.zeros(3), UPRIGHT)
    assert correct(a, pose[:3], pose[3:], PERIOD, PERIOD, PERIOD * TICK, True)
    angle = Rotation.from_quat(a.state.attitude).as_rotvec()
    names = ("gyro_bias", "accel_bias")
    return np.concatenate(
        [a.state.position, a.state.velocity, angle, *(a.state[n] for n in names)]
    )


def test_poles_are_where_the_bandwidths_put_them():
    """Eigenvalues of the error from one sample to the next, by differences of the real code."""
    step = 1e-5
    columns = [
        (error_after_a_period(step * e) - error_after_a_period(-step * e)) / (2.0 * step)
        for e in np.eye(15)
    ]
    measured = np.poly(np.array(columns).T)
    slow = math.exp(-E.attitude_bandwidth * PERIOD * TICK)
    fast = math.exp(-E.position_bandwidth * PERIOD * TICK)
    designed = np.poly([fast] * 9 + [slow] * 6)
    # equal eigenvalues are ill-conditioned, their polynomial is not
    assert np.allclose(measured, designed, rtol=2e-3, atol=1e-4)


POSE = np.array([0.1, 0.2, 10.1, *Rotation.from_euler("xyz", [0.1, 0.2, 0.3]).as_quat()])


def content(memory):
    """Return all fields as text; bytes between them are anything after a copy."""
    return repr(memory.tolist())


def memory_at(now):
    a = fresh_autopilot()
    for k in range(now + 1):
        store_history(a.state, a.history, k)
    return a


@given(st.integers(0, 6), st.sampled_from([math.nan, math.inf, -math.inf]))
def test_a_pose_that_is_not_finite_changes_nothing(place, value):
    a = memory_at(100)
    before = content(a)
    pose = POSE.copy()
    pose[place] = value
    assert not correct(a, pose[:3], pose[3:], 90, 100, 0.033, True)
    assert content(a) == before


def test_biases_stay_within_their_limits():
    truth = motion(6.0, brisk=0.0)
    a, _ = estimate(truth, bias=(2.0, 9.0))
    assert np.abs(a.state.gyro_bias).max() <= E.gyro_bias_max
    assert np.abs(a.state.accel_bias).max() <= E.accel_bias_max


def test_on_the_ground_it_learns_no_velocity_and_no_accelerometer_bias():
    a = memory_at(0)
    imu = np.array([0.0, 0.0, 0.0, 0.5, 0.0, 3.0])
    for k in range(1, 500):
        store_history(a.state, a.history, k)
        if k % PERIOD == 0:
            correct(a, POSE[:3], POSE[3:], k, k, 0.033, False)
        update_body_rates(a.state, imu[:3])
        predict(a.state, imu[3:], False)
    assert (a.state.velocity == 0.0).all()
    assert (a.state.accel_bias == 0.0).all()
    assert np.linalg.norm(a.state.position - POSE[:3]) < 1e-2
