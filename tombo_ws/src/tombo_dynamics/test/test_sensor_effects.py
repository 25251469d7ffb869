"""Errors of IMU and motion capture: of the frame, the time, the noise, the gaps."""

import math

import numpy as np
import pytest
from one_vehicle import NOISE, Vehicle, measured_pose

from tombo_dynamics.effects.compose import apply_imu, apply_mocap, pack_theta


def imu_readings(effects, noise):
    """Return readings of a sensor that should read zero, a row for each row of normals."""
    v = Vehicle(effects)
    rows = []
    for row in noise:
        v.imu = np.zeros(6)
        apply_imu(v.plant, row, v.theta)
        rows.append(v.imu)
    return np.array(rows)


# --- IMU ------------------------------------------------------------------------------------


def test_noise_has_its_deviation_on_each_axis_and_axes_are_independent():
    noise = np.random.default_rng(0).standard_normal((4000, NOISE))
    rows = imu_readings({"imu_noise": {"gyro": 0.02, "accel": 0.5}}, noise)
    assert rows.std(axis=0) == pytest.approx([0.02] * 3 + [0.5] * 3, rel=0.05)
    assert np.abs(rows.mean(axis=0) / rows.std(axis=0)).max() < 0.06
    between = np.corrcoef(rows.T)[np.triu_indices(6, 1)]
    assert np.abs(between).max() < 0.07
    follow = [np.corrcoef(rows[1:, i], rows[:-1, i])[0, 1] for i in range(6)]
    assert np.abs(follow).max() < 0.07


def test_the_accelerometer_does_not_read_more_than_its_range():
    v = Vehicle({"accel_range": {"limit": 20.0}})
    v.imu = [30.0, -30.0, 1.0, 50.0, -19.0, -20.1]
    apply_imu(v.plant, np.zeros(NOISE), v.theta)
    assert v.imu.tolist() == [30.0, -30.0, 1.0, 20.0, -19.0, -20.0]


@pytest.mark.parametrize("bandwidth", [10.0, 40.0])
def test_a_low_pass_lets_half_of_the_power_through_at_its_bandwidth(bandwidth):
    constant = 1.0 / (2.0 * math.pi * bandwidth)
    v = Vehicle({"imu_low_pass": {"gyro": constant, "accel": 2.0 * constant}})
    t = np.arange(2000) * 1e-3
    rows = []
    for value in np.sin(2.0 * math.pi * bandwidth * t):
        v.imu = np.full(6, value)
        apply_imu(v.plant, np.zeros(NOISE), v.theta)
        rows.append(v.imu)
    power = 2.0 * np.array(rows)[1000:].var(axis=0)
    assert power[:3] == pytest.approx(0.5, rel=0.02)
    assert power[3:] == pytest.approx(0.2, rel=0.02)


def test_imu_vibration_has_the_frequency_and_amplitude_of_each_rotor():
    v = Vehicle({"imu_vibration": {"displacement": 1e-5, "angle": 1e-3}})
    rows = []
    for _ in range(4000):
        v.plant.rotor_speed = [0.0, 300.0, 0.0, 600.0]
        v.imu = np.zeros(6)
        apply_imu(v.plant, np.zeros(NOISE), v.theta)
        rows.append(v.imu)
    lines = np.abs(np.fft.rfft(np.array(rows) * np.hanning(4000)[:, None], axis=0)) / 1000.0
    for speed in (300.0, 600.0):
        line = round(speed / (2.0 * math.pi) * 4.0)
        found = lines[line - 3 : line + 4].max(axis=0)
        assert found[:3] == pytest.approx(1e-3 * speed, rel=0.2)
        assert found[3:] == pytest.approx(1e-5 * speed**2, rel=0.2)
        lines[line - 6 : line + 7] = 0.0
    assert lines.max() < 0.01 * 1e-5 * 600.0**2


# --- time -----------------------------------------------------------------------------------


def test_latency_has_mean_and_jitter_and_is_never_negative():
    rng = np.random.default_rng(4)
    effects = {"mocap_latency": {"delay": 0.03, "jitter": 0.004}}
    pose = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0))
    seen = np.array([
        measured_pose(effects, *pose, row).latency for row in rng.standard_normal((3000, NOISE))
    ])  # fmt: skip
    assert seen.mean() == pytest.approx(0.03, abs=3e-4)
    assert seen.std() == pytest.approx(0.004, rel=0.05)
    hasty = np.zeros(NOISE)
    hasty[6] = -100.0
    assert measured_pose(effects, *pose, hasty).latency == 0.0


# --- gaps -----------------------------------------------------------------------------------

PERIOD = 1.0 / 30.0


def dropped(probability, duration, samples=20_000, seed=5):
    """Return which of many samples at 30 Hz are missing."""
    theta = pack_theta({"mocap_dropouts": {"probability": probability, "duration": duration}})
    v = Vehicle()
    missing = np.zeros(samples, dtype=bool)
    for i, row in enumerate(np.random.default_rng(seed).standard_normal((samples, NOISE))):
        v.plant.mocap.dropped = False
        v.plant.mocap.interval = PERIOD
        apply_mocap(v.plant, row, theta)
        missing[i] = v.plant.mocap.dropped
    return missing


@pytest.mark.slow
@pytest.mark.parametrize("probability, duration", [(0.05, 0.0), (0.02, 0.1), (0.01, 0.4)])
def test_dropouts_are_as_frequent_and_as_long_as_asked_for(probability, duration):
    """A gap of exponential length d swallows 1 / (1 - exp(-T / d)) samples on average."""
    missing = dropped(probability, duration)
    length = 1.0 if duration == 0.0 else 1.0 / (1.0 - math.exp(-PERIOD / duration))
    share = probability * length / (1.0 - probability + probability * length)
    assert missing.mean() == pytest.approx(share, rel=0.2)
    begins = np.count_nonzero(missing[1:] & ~missing[:-1])
    assert missing.sum() / begins == pytest.approx(length / (1.0 - probability), rel=0.2)
