"""Two tests of motion, of a track's axes and of an attitude's form.

A multirotor is pushed along its body z axis. So the tilt that the attitude gives must agree with
the acceleration of the track, and the rates of the attitude with the gyro. Both are computed for
each reading of the columns; the best reading is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.spans import Mask, check_extent, interpolated
from tombo_logs.readers.frames import BODIES, WORLDS, axes_matrix, is_usable

RATE_HZ: Final = 50.0
_WIDTH: Final = 0.12 * RATE_HZ
"""Samples: standard deviation of the Gaussian that all signals pass through."""
_LEAST_SAMPLES: Final = 100
_MOVES: Final = 0.1
"""m/s^2 and rad/s, standard deviation: horizontal acceleration and rates that show anything."""
AGREES: Final = 0.5
"""Correlation from which on a test says something."""
CLOSE: Final = 0.1
"""Difference of two scores that says nothing."""
_USUAL: Final = [("ENU", "FLU"), ("NED", "FRD")]
"""Axes, unless the motion speaks for others."""
WORLD_AXES: Final = {"ENU": WORLDS["ENU"], "NED": WORLDS["NED"], "y up": ("x", "-z", "y")}
BODY_AXES: Final = {
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

    form: str
    """Key of the attitude's form."""
    world: str
    body: str
    tilt: float
    """Correlation of tilt and acceleration, mean of the axes that move; NaN: none does."""
    slope: float
    """Acceleration by the tilt over the track's: 1 where both are in SI."""
    rates: float
    """Correlation of the attitude's rates and the gyro; NaN: nothing turns, or no gyro."""
    gyro_scale: float
    """Size of the gyro's values over the attitude's rates [rad/s]; NaN as `rates`."""

    @property
    def score(self) -> float:
        """Sum of both correlations."""
        return float(np.nansum([self.tilt, self.rates]))


def readings(
    position: Series, attitudes: Mapping[str, Series], gyro: Series | None, accel: Series | None
) -> list[Reading]:
    """Return the readings that gravity allows, best first; usual axes unless others are clear.

    Args:
        position: (N, 3) in the file's axes [m].
        attitudes: form → (N, 4) xyzw, the file's world from its body.
        gyro: (N, 3) in the file's axes and unit.
        accel: (N, 3) in the file's axes, any unit.
    """
    allowed = []
    for form, attitude in attitudes.items():
        t = even_clock([s for s in (position, attitude, gyro) if s is not None])
        if t.size < _LEAST_SAMPLES or is_usable(attitude.values).sum() < 2:
            continue
        turn = _attitude_at(attitude, t)
        agreement = _compare_rates(turn, None if gyro is None else _values_at(gyro, t))
        acceleration = _acceleration_at(position, t)
        for world, axes in WORLD_AXES.items():
            in_world = axes_matrix(axes, world)
            for body, body_axes in BODY_AXES.items():
                up = axes_matrix(body_axes, body)[2]
                thrust = turn.apply(up) @ in_world.T
                if np.median(thrust[:, 2]) < 0.5 or not _points_up(accel, up):
                    continue
                tilt = _compare_tilt(thrust, acceleration @ in_world.T)
                allowed.append(Reading(form, world, body, *tilt, *agreement))
    ranked = sorted(allowed, key=lambda r: (-round(r.score, 2), _rank(r)))
    usual = next((r for r in ranked if _rank(r) < len(_USUAL)), None)
    if usual and not (ranked[0].tilt > AGREES and ranked[0].score > usual.score + CLOSE):
        ranked.remove(usual)
        ranked.insert(0, usual)
    return ranked


def _rank(reading: Reading) -> int:
    axes = (reading.world, reading.body)
    return _USUAL.index(axes) if axes in _USUAL else len(_USUAL)


def _compare_tilt(thrust: Array, acceleration: Array) -> tuple[float, float]:
    """Return correlation and slope of tilt and horizontal acceleration.

    The axes count alike: a quaternion in the wrong order agrees in one axis, with heading 0.
    """
    smooth = gaussian_filter1d(thrust, _WIDTH, axis=0)
    tilt = GRAVITY * smooth[:, :2] / np.maximum(smooth[:, 2:], 0.3)
    size = np.linalg.norm(acceleration, axis=1)
    calm = size < 8.0 * np.median(size) + _MOVES  # without jumps of the track
    tilt, flat = tilt[calm], acceleration[calm, :2]
    moves = flat.std(axis=0) > _MOVES if len(flat) else np.zeros(2, np.bool_)
    if len(flat) < _LEAST_SAMPLES or not moves.any():
        return float("nan"), float("nan")
    slope = float(np.sum(tilt * flat) / np.sum(flat * flat))
    both = [_correlation(tilt[:, k], flat[:, k]) for k in np.flatnonzero(moves)]
    return float(np.mean(both)), slope


def _compare_rates(turn: Rotation, gyro: Array | None) -> tuple[float, float]:
    """Return correlation of the attitude's rates and the gyro, and the gyro's size over them."""
    if gyro is None:
        return float("nan"), float("nan")
    rates = gaussian_filter1d(rates_of(turn), _WIDTH, axis=0)
    other = gaussian_filter1d(0.5 * (gyro[1:] + gyro[:-1]), _WIDTH, axis=0)
    speed = np.linalg.norm(rates, axis=1)
    calm: Mask = (speed > 0.0) & (speed < 10.0)
    if calm.sum() < _LEAST_SAMPLES or rates[calm].std() < _MOVES:
        return float("nan"), float("nan")
    scale = float(np.median(np.linalg.norm(other[calm], axis=1) / speed[calm]))
    return _correlation(rates[calm], other[calm]), scale


def compare_acceleration(position: Series, other: Series) -> tuple[float, float]:
    """Return correlation of a series (N, 3) with a track's acceleration, and its size over it.

    Both in the same axes; `position` in m.
    """
    t = even_clock([position, other])
    if t.size < _LEAST_SAMPLES:
        return float("nan"), float("nan")
    track = _acceleration_at(position, t)
    given = gaussian_filter1d(_values_at(other, t), _WIDTH, axis=0)
    moving = np.linalg.norm(track, axis=1) > _MOVES
    if moving.sum() < _LEAST_SAMPLES / 2:
        return float("nan"), float("nan")
    sizes = np.linalg.norm(given[moving], axis=1) / np.linalg.norm(track[moving], axis=1)
    return _correlation(track[moving], given[moving]), float(np.median(sizes))


def even_clock(series: Sequence[Series]) -> Array:
    """Return times [s] at `RATE_HZ` over what all series have."""
    begin, end = max(s.t[0] for s in series), min(s.t[-1] for s in series)
    check_extent(begin, end, RATE_HZ)
    return np.arange(begin, end, 1.0 / RATE_HZ)


def attitude_rates(attitude: Series) -> Series:
    """Return body rates [rad/s] of (N, 4) attitudes, in the axes of their body."""
    t = even_clock([attitude])
    return Series(0.5 * (t[1:] + t[:-1]), rates_of(_attitude_at(attitude, t)))


def rates_of(turn: Rotation) -> Array:
    """Return the rates [rad/s] between attitudes at `RATE_HZ`."""
    return np.asarray((turn[:-1].inv() * turn[1:]).as_rotvec() * RATE_HZ)


def _acceleration_at(position: Series, t: Array) -> Array:
    place = _values_at(position, t)
    return np.asarray(gaussian_filter1d(place, _WIDTH, axis=0, order=2) * RATE_HZ**2)


def _correlation(a: Array, b: Array) -> float:
    a, b = a - a.mean(axis=0), b - b.mean(axis=0)
    return float(np.sum(a * b) / max(np.sqrt(np.sum(a**2) * np.sum(b**2)), 1e-12))


def _points_up(accel: Series | None, up: Array) -> bool:
    """Return whether an accelerometer reads gravity along an axis of the body, or is absent."""
    if accel is None:
        return True
    norm = np.nanmedian(np.linalg.norm(accel.values, axis=1))
    return bool(np.nanmedian(accel.values @ up) > 0.7 * norm)


def _values_at(series: Series, t: Array) -> Array:
    usable = np.isfinite(series.values).all(axis=1)
    return interpolated(t, series.t[usable], series.values[usable])


def _attitude_at(attitude: Series, t: Array) -> Rotation:
    """Return the attitudes nearest in time."""
    usable = is_usable(attitude.values)
    stamps, values = attitude.t[usable], attitude.values[usable]
    right = np.clip(np.searchsorted(stamps, t), 1, stamps.size - 1)
    left_is_nearer = t - stamps[right - 1] < stamps[right] - t
    return Rotation.from_quat(values[np.where(left_is_nearer, right - 1, right)])
