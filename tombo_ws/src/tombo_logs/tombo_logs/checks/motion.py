"""The motion by poses and by IMU, smoothed alike on one even clock, for comparison."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply, unwrap_quaternions
from tombo_logs.checks.clocks.gaps import gap_spans
from tombo_logs.checks.spans import Mask, Span, check_extent, inside, interpolated
from tombo_logs.readers.frames import is_usable

RATE = 50.0
"""Hz of the even clock."""
WIDTH = 0.055
"""Standard deviation of the Gaussian that all pass through [s]."""
_REACH = 4.0 * WIDTH
INDEPENDENT = RATE * WIDTH * 2.0 * np.sqrt(np.pi)
"""Rows of the even clock for each independent one, behind the Gaussian."""


@dataclass(frozen=True)
class Motion:
    """Motion by poses and by IMU at even times; only rows with `good` are valid."""

    t: Array
    """(N,) s"""
    rates: Array
    """(N, 3) body rates of the attitude [rad/s]."""
    acceleration: Array
    """(N, 3) of the position [m/s^2]."""
    up: Array
    """(N, 3) body z axis in map."""
    attitude: Array
    """(N, 4)"""
    good: Mask
    gyro: Array
    """(N, 3) or (0, 3)."""
    accel: Array
    """(N, 3) or (0, 3)."""


def motion_of(
    position: Series, attitude: Series, gyro: Series | None, accel: Series | None,
    exclude: list[Span],
) -> Motion:  # fmt: skip
    """Resample cleaned poses and IMU to one clock."""
    begin = max(position.t[0], attitude.t[0])
    end = min(position.t[-1], attitude.t[-1])
    check_extent(begin, end, RATE)
    count = max(int((end - begin) * RATE), 0)
    t = begin + np.arange(count) / RATE
    empty = np.zeros((0, 3))
    if count < 25:
        return Motion(t[:0], empty, empty, empty, np.zeros((0, 4)), t[:0] > 0, empty, empty)
    invalid = inside(t, exclude)
    for series in (position, attitude, gyro, accel):
        if series is not None:
            invalid |= inside(t, gap_spans(series.t))
            invalid |= (t < series.t[0]) | (t > series.t[-1])
    q = unit_rows(_sampled(turns_of(attitude), t))
    sigma = WIDTH * RATE
    smooth = unit_rows(gaussian_filter1d(q, sigma, axis=0))
    slope = gaussian_filter1d(q, sigma, axis=0, order=1) * RATE
    turn = Rotation.from_quat(smooth)
    near = gaussian_filter1d(invalid.astype(np.float64), sigma, truncate=4.0) > 1e-9
    near |= (t < t[0] + _REACH) | (t > t[-1] - _REACH)
    return Motion(
        t,
        body_rates(smooth, slope),
        accelerations(position, t),
        turn.apply([0.0, 0.0, 1.0]),
        smooth,
        ~near,
        empty if gyro is None else resampled(gyro, t),
        empty if accel is None else resampled(accel, t),
    )


def turns_of(attitude: Series) -> Series:
    """Return the attitudes that can be used, with the sign of the one before."""
    usable = is_usable(attitude.values)
    return Series(attitude.t[usable], unwrap_quaternions(attitude.values[usable]))


def body_rates(q: Array, slope: Array) -> Array:
    """Return (N, 3) [rad/s] of attitudes (N, 4) and their derivative."""
    return np.asarray(2.0 * quaternion_multiply(conjugate(q), slope)[:, :3])


def unit_rows(q: Array) -> Array:
    """Return rows of norm 1."""
    return np.asarray(q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-9))


def accelerations(position: Series, t: Array) -> Array:
    """Return the smoothed acceleration of a track at times `t` of the even clock, (N, 3)."""
    smooth = gaussian_filter1d(_sampled(position, t), WIDTH * RATE, axis=0, order=2)
    return np.asarray(smooth * RATE**2)


def _sampled(series: Series, t: Array) -> Array:
    """Return values at `t`: means over a step of `t` where there are many, else straight lines."""
    stamps, values = series.t, series.values
    if stamps.size < 2 or np.median(np.diff(stamps)) > 0.5 / RATE:
        return interpolated(t, stamps, values)
    edges = np.concatenate([t - 0.5 / RATE, t[-1:] + 0.5 / RATE])
    area = cumulative_trapezoid(values, stamps, axis=0, initial=0.0)
    held = np.diff(np.clip(edges, stamps[0], stamps[-1]))
    means = np.diff(interpolated(edges, stamps, area), axis=0)
    return np.asarray(means / np.maximum(held, 1e-9)[:, None])


def resampled(series: Series, t: Array) -> Array:
    """Return a channel at times `t` of the even clock, behind the same Gaussian, (N, k)."""
    return np.asarray(gaussian_filter1d(_sampled(series, t), WIDTH * RATE, axis=0))


def in_body(rates: Series, attitude: Series) -> Series:
    """Return rates about the axes of map (N, 3) about those of the body."""
    turns = turns_of(attitude)
    q = unit_rows(interpolated(rates.t, turns.t, turns.values))
    values = np.asarray(Rotation.from_quat(q).inv().apply(rates.values))
    return Series(rates.t, values, rates.arrival)
