"""Velocity and acceleration from positions alone are right within their own covariance."""

import numpy as np
import pytest

from tombo_bag.flight import Series
from tombo_diagnosis.track_smoothing import position_noise, smooth_track

NOISE = 0.001


def circle(rate, rng, uneven=0.0):
    """Positions on a circle of 1 m, once round in 3 s, and the acceleration at any time."""
    t = np.arange(0.0, 6.0, 1.0 / rate)
    t = t + uneven / rate * rng.uniform(-0.5, 0.5, t.size)
    w = 2.0 * np.pi / 3.0
    place = np.column_stack([np.cos(w * t), np.sin(w * t), 0.0 * t + 1.0])
    series = Series(t, place + NOISE * rng.standard_normal(place.shape))
    return series, lambda s: -(w**2) * np.column_stack([np.cos(w * s), np.sin(w * s), 0.0 * s])


@pytest.mark.parametrize(("rate", "uneven"), [(50.0, 0.0), (100.0, 0.4), (400.0, 0.0)])
def test_acceleration_of_a_circle_is_right_within_its_covariance(rate, uneven):
    series, true = circle(rate, np.random.default_rng(1), uneven)
    track = smooth_track(series)
    inner = slice(20, -20)
    off = (track["acceleration"].values - true(track.t))[inner]
    deviation = np.sqrt(track["covariance"].values[inner, 2, 2])[:, None]
    assert np.sqrt(np.mean(off**2)) < 0.5
    assert np.mean(np.abs(off) < 2.0 * deviation) > 0.9
    assert track.t.size <= 601  # faster positions are averaged


def test_a_bounce_is_seen_at_its_time():
    t = np.arange(0.0, 3.0, 0.01)
    height = 1.0 + 0.5 * np.abs(t - 1.5)  # it is thrown back with 0.5 m/s
    rng = np.random.default_rng(3)
    place = np.column_stack([0.0 * t, 0.0 * t, height]) + 0.0003 * rng.standard_normal((300, 3))
    track = smooth_track(Series(t, place))
    assert abs(track.t[np.argmax(track["acceleration"].values[:, 2])] - 1.5) < 0.02
    assert track["acceleration"].values[:, 2].max() > 10.0


def test_noise_is_told_from_motion():
    series, _ = circle(100.0, np.random.default_rng(4))
    assert position_noise(series) == pytest.approx(NOISE, rel=0.15)
    assert position_noise(Series(series.t[:2], series.values[:2])) > 0.0
