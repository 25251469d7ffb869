"""What the motion says of a track's axes and of an attitude's form.

A multirotor is pushed along its body z axis. So the direction of thrust that the attitude gives,
and the one that the track calls for (acceleration and gravity), must agree; and the rates of the
attitude with the gyro. Both are computed for each reading of the columns, and the best is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.spans import check_extent
from tombo_logs.readers.frames import BODIES, WORLDS, axes_matrix, is_usable

_RATE = 50.0
_WIDTH = 0.12
"""Standard deviation of the Gaussian that all sides pass through [s]."""
_SHOWN_LEAN, _SHOWN_RATE = 0.1, 0.1
"""Horizontal acceleration [m/s^2] and rate [rad/s] that show anything (standard deviation)."""
CLEAR_LEAN, CLOSE_SCORE = 0.5, 0.1
"""Correlation of lean and acceleration that says something; difference of scores that does not."""
_USUAL_AXES = {("ENU", "FLU"): 0, ("NED", "FRD"): 1}
"""What axes are unless the motion says otherwise."""
WORLD_AXES: Mapping[str, tuple[str, ...]] = {
    "ENU": WORLDS["ENU"],
    "NED": WORLDS["NED"],
    "y up": ("x", "-z", "y"),
}
BODY_AXES: Mapping[str, tuple[str, ...]] = {
    "FLU": BODIES["FLU"],
    "FRD": BODIES["FRD"],
    "y up": ("x", "-z", "y"),
    "x up": ("z", "-y", "x"),
    "x down": ("z", "y", "-x"),
}
"""Right-handed axes by what points up; where it is not z, forward is a guess."""


@dataclass(frozen=True)
class Reading:
    """One way to read the columns, and how well the motion agrees with it."""

    attitude: str
    """Key of the attitude's form."""
    world: str
    body: str
    lean: float
    """Correlation of thrust direction and acceleration, -1 to 1; NaN: too little of it."""
    slope: float
    """Horizontal thrust by unit weight over acceleration: 1 where both are in SI."""
    rates: float
    """Correlation of the attitude's rates and the gyro."""
    gyro_scale: float
    """Size of the gyro's values over the attitude's rates [rad/s]; NaN: not to be told."""

    @property
    def score(self) -> float:
        """How much speaks for it."""
        return float(np.nansum([self.lean, self.rates]))


def readings(
    position: Series, attitudes: Mapping[str, Series], gyro: Series | None, accel: Series | None
) -> list[Reading]:
    """Return the readings that gravity allows, best first.

    Args:
        position: (N, 3) in the file's axes [m].
        attitudes: form → (N, 4) xyzw, the file's world from its body.
        gyro: (N, 3) in the file's axes and unit.
        accel: (N, 3) in the file's axes, any unit.
    """
    candidates = []
    for form, attitude in attitudes.items():
        ends = [s for s in (position, attitude, gyro) if s is not None]
        t = _even(ends)
        usable = is_usable(attitude.values)
        if t.size < 100 or usable.sum() < 20:
            continue
        turn = Rotation.from_quat(_nearest(attitude, usable, t))
        rates, scale = _rates(turn, None if gyro is None else _sampled(gyro, t))
        curve = gaussian_filter1d(_sampled(position, t), _WIDTH * _RATE, axis=0, order=2)
        acceleration = curve * _RATE**2
        for world, axes in WORLD_AXES.items():
            in_world = axes_matrix(axes, world)
            for body, body_axes in BODY_AXES.items():
                up = axes_matrix(body_axes, body)[2]
                if accel is not None and not _points_up(accel.values, up):
                    continue
                thrust = turn.apply(up) @ in_world.T
                if np.median(thrust[:, 2]) < 0.5:
                    continue
                lean, slope = _lean(thrust, acceleration @ in_world.T)
                candidates.append(Reading(form, world, body, lean, slope, rates, scale))
    ranked = sorted(
        candidates, key=lambda r: (-round(r.score, 2), _USUAL_AXES.get((r.world, r.body), 9))
    )
    usual = next((r for r in ranked if (r.world, r.body) in _USUAL_AXES), None)
    if usual is not None and not _is_clear(ranked[0], usual):
        ranked.remove(usual)
        ranked.insert(0, usual)
    return ranked


def _is_clear(best: Reading, usual: Reading) -> bool:
    """Return whether the motion, and no chance correlation, speaks for other axes."""
    return best.lean > CLEAR_LEAN and best.score > usual.score + CLOSE_SCORE


def track_acceleration(position: Series, other: Series) -> tuple[float, float]:
    """Return correlation of a series with the track's acceleration, and its size over that.

    Args:
        position: (N, 3) [m].
        other: (N, 3) in the same axes, any unit.
    """
    t = _even([position, other])
    if t.size < 100:
        return float("nan"), float("nan")
    width = _WIDTH * _RATE
    track = gaussian_filter1d(_sampled(position, t), width, axis=0, order=2) * _RATE**2
    given = gaussian_filter1d(_sampled(other, t), width, axis=0)
    size = np.linalg.norm(given, axis=1) / np.maximum(np.linalg.norm(track, axis=1), 1e-9)
    moving = np.linalg.norm(track, axis=1) > _SHOWN_LEAN
    if moving.sum() < 50:
        return float("nan"), float("nan")
    return _correlation(track[moving], given[moving]), float(np.median(size[moving]))


def _even(series: Sequence[Series]) -> Array:
    """Return the times of an even clock over what all series have."""
    begin, end = max(s.t[0] for s in series), min(s.t[-1] for s in series)
    check_extent(begin, end, _RATE)
    return np.arange(begin, end, 1.0 / _RATE)


def attitude_rates(attitude: Series) -> Series:
    """Return body rates [rad/s] of (N, 4) attitudes, in the axes of their body."""
    usable = is_usable(attitude.values)
    t = _even([attitude])
    turn = Rotation.from_quat(_nearest(attitude, usable, t))
    return Series(0.5 * (t[1:] + t[:-1]), (turn[:-1].inv() * turn[1:]).as_rotvec() * _RATE)


def _lean(thrust: Array, acceleration: Array) -> tuple[float, float]:
    """Return correlation and slope of horizontal thrust, by unit weight, and acceleration."""
    smooth = gaussian_filter1d(thrust, _WIDTH * _RATE, axis=0)
    tilt = GRAVITY * smooth[:, :2] / np.maximum(smooth[:, 2:], 0.3)
    size = np.linalg.norm(acceleration, axis=1)
    calm = size < 8.0 * np.median(size) + _SHOWN_LEAN  # no jumps of the track
    if calm.sum() < 100 or acceleration[calm, :2].std() < _SHOWN_LEAN:
        return float("nan"), float("nan")
    flat = acceleration[calm, :2]
    slope = float(np.sum(tilt[calm] * flat) / np.sum(flat * flat))
    return _correlation(tilt[calm], flat), slope


def _rates(turn: Rotation, gyro: Array | None) -> tuple[float, float]:
    if gyro is None:
        return float("nan"), float("nan")
    step = (turn[:-1].inv() * turn[1:]).as_rotvec() * _RATE
    smoothed = gaussian_filter1d(step, _WIDTH * _RATE, axis=0)
    other = gaussian_filter1d(0.5 * (gyro[1:] + gyro[:-1]), _WIDTH * _RATE, axis=0)
    speed = np.linalg.norm(smoothed, axis=1)
    calm = (speed > 0.0) & (speed < 10.0)
    if calm.sum() < 100 or smoothed[calm].std() < _SHOWN_RATE:
        return float("nan"), float("nan")
    size = np.median(np.linalg.norm(other[calm], axis=1) / speed[calm])
    return _correlation(smoothed[calm], other[calm]), float(size)


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return float(np.sum(a * b) / max(np.sqrt(np.sum(a**2) * np.sum(b**2)), 1e-12))


def _points_up(accel: Array, up: Array) -> bool:
    """Return whether an accelerometer reads gravity along an axis of the body."""
    norm = np.nanmedian(np.linalg.norm(accel, axis=1))
    return bool(np.nanmedian(accel @ up) > 0.7 * norm)


def _sampled(series: Series, t: Array) -> Array:
    usable = np.isfinite(series.values).all(axis=1)
    return np.column_stack([np.interp(t, series.t[usable], c) for c in series.values[usable].T])


def _nearest(attitude: Series, usable: NDArray[np.bool_], t: Array) -> Array:
    stamps, values = attitude.t[usable], attitude.values[usable]
    right = np.clip(np.searchsorted(stamps, t), 1, stamps.size - 1)
    left_is_nearer = t - stamps[right - 1] < stamps[right] - t
    return np.asarray(values[np.where(left_is_nearer, right - 1, right)])
