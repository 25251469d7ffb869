"""Comparison of poses with the IMU: units, frames and stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.even_flight import INDEPENDENT, RATE, EvenFlight
from tombo_logs.checks.spans import Mask, interpolated, peak_offset

_EXCITED = 0.04
"""rad/s: root mean square of a rate that tells anything."""
_MAX_LAG_S = 0.3
_MIRROR_SEEN = 0.8
"""Correlation of gyro and attitude along the direction that turns least, to tell a mirror."""
_DRAG = 0.08
"""m/s^2: standard deviation of drag along an axis below which noise of the sensors hides it."""
_DRAG_WIDTH = 0.15 * RATE
"""Rows: standard deviation of the Gaussian for drag, far above that of the noise of poses."""


@dataclass(frozen=True)
class Alignment:
    """How gyro and rates of the attitude go together: gyro = scale * turn @ rates."""

    scale: float
    turn: Rotation
    mirrored: bool
    """True: the turn is to be followed by a mirror; axes have different handedness."""
    angle: float
    """of the turn [rad]."""
    sigma: float
    """Standard deviation of the angle [rad]."""
    explained: float
    """Share of the gyro's variance that is explained."""


@dataclass(frozen=True)
class TimeOffset:
    """Delay of the motion capture's stamps against the IMU's."""

    lag: float
    """s"""
    sigma: float


def time_offset(motion: EvenFlight) -> TimeOffset | None:
    """Return the lag of best agreement between gyro and rates of the attitude.

    Only sizes are compared where axes may be wrong; None where nothing turns.
    """
    if not motion.is_compared(motion.gyro):
        return None
    usable = motion.valid
    rates = motion.rates - motion.rates[usable].mean(axis=0)
    gyro = motion.gyro - motion.gyro[usable].mean(axis=0)
    if _rms(rates[usable]) < _EXCITED:
        return None
    reach = int(_MAX_LAG_S * RATE)
    shifts = np.arange(-reach, reach + 1)
    match = np.array([_matched(rates, gyro, usable, int(s)) for s in shifts])
    best = int(np.argmax(match))
    if best in (0, match.size - 1) or match[best] < 0.5:
        return None
    lag = (shifts[best] + peak_offset(match, best)) / RATE
    # how sharply a shift shows, against what no shift explains
    fitted = _fit(np.roll(rates, -int(shifts[best]), axis=0)[usable], gyro[usable])
    slope = np.gradient(gyro, 1.0 / RATE, axis=0)[usable]
    noise = _rms(fitted)
    sharp = np.sqrt(np.sum(slope**2) / INDEPENDENT)
    return TimeOffset(float(lag), float(noise / max(sharp, 1e-9)))


def alignment(motion: EvenFlight, lag: float) -> Alignment | None:
    """Return how gyro and rates of the attitude go together once the lag is taken out."""
    if not motion.is_compared(motion.gyro):
        return None
    usable = motion.valid
    t = motion.t
    shifted = interpolated(t + lag, t, motion.rates)
    w, g = _centred(shifted[usable]), _centred(motion.gyro[usable])
    if _rms(w) < _EXCITED:
        return None
    covariance = g.T @ w / len(w)
    u, s, vt = np.linalg.svd(covariance)
    # the common part of both; noise of one alone is not in it
    excited = bool((np.sqrt(s) > _EXCITED / 2.0).all())
    # a mirror shows in the directions that are excited, all three of them
    sign = np.sign(np.linalg.det(u @ vt))
    weakest = s[2] / max(float((g @ u[:, 2]).std() * (w @ vt[2]).std()), 1e-12)
    mirrored = bool(excited and sign < 0.0 and weakest > _MIRROR_SEEN)
    matrix = u @ np.diag([1.0, 1.0, sign]) @ vt
    scale = float(s.sum() / max(np.trace(w.T @ w / len(w)), 1e-12))
    left = g - scale * w @ (u @ vt if mirrored else matrix).T
    turn = Rotation.from_matrix(-u @ vt if mirrored else matrix)
    angle = float(turn.magnitude())
    # the turn about an axis is told by what turns about the two others
    weak = max(float(np.sqrt(s[1:].mean() / max(scale, 1e-9))), 1e-6)
    sigma = _rms(left) / max(scale, 1e-9) / weak * np.sqrt(INDEPENDENT / len(w))
    return Alignment(scale, turn, mirrored, angle, float(sigma), _explained(left, g))


def tilt_response(motion: EvenFlight) -> tuple[Array, float] | None:
    """Return (2, 2): horizontal acceleration per horizontal lean, over gravity; and its share.

    A multirotor is pushed along its body z: the identity is expected. None without excitation.
    """
    up, acceleration = motion.up[motion.valid], motion.acceleration[motion.valid, :2]
    if len(acceleration) < 100:
        return None
    expected = _centred(_horizontal_over_vertical(up) * GRAVITY)
    acceleration = _centred(acceleration)
    if max(_rms(expected), _rms(acceleration)) < 0.2 or _rms(expected) < 2e-3:
        return None
    response, _, _, _ = np.linalg.lstsq(expected, acceleration, rcond=None)
    return np.asarray(response.T), _explained(acceleration - expected @ response, acceleration)


def drag_correlations(motion: EvenFlight) -> Array | None:
    """Return (2, 2): correlations of the accelerometer's x and y with the poses' specific force.

    Row: axis of the accelerometer, column: body axis. Thrust is along z: the remainder is drag,
    faint and slow, but in both. None without drag.
    """
    if not motion.is_compared(motion.accel):
        return None
    usable = gaussian_filter1d((~motion.valid).astype(np.float64), _DRAG_WIDTH) < 0.01
    slow = [
        gaussian_filter1d(v, _DRAG_WIDTH, axis=0)
        for v in (motion.accel[:, :2], motion.force_of_poses[:, :2])
    ]
    if np.count_nonzero(usable) < 100 or min(v[usable].std(axis=0).min() for v in slow) < _DRAG:
        return None
    accel, expected = (_centred(v[usable]) / np.maximum(v[usable].std(axis=0), 1e-6) for v in slow)
    return np.asarray(accel.T @ expected / len(accel))


def force_response(motion: EvenFlight) -> tuple[Array, float] | None:
    """Return (3, 3): the turn from the accelerometer's reading in map to the track's acceleration.

    Also the share of the track's acceleration that it explains. Drag and wind are in both: no
    turn is expected. None without excitation along two axes.
    """
    if not motion.is_compared(motion.accel):
        return None
    usable = motion.valid
    expected = _centred(motion.accel_in_map[usable])
    acceleration = _centred(motion.acceleration[usable])
    if max(_rms(expected), _rms(acceleration)) < 0.2:
        return None
    u, s, vt = np.linalg.svd(acceleration.T @ expected / len(acceleration))
    if s[1] < 0.2 * s[0]:
        return None
    turn = u @ vt
    if s[2] < 0.2 * s[1]:
        # a plane can be turned over or mirrored: the smaller mistake is the more probable one
        other = u @ np.diag([1.0, 1.0, -1.0]) @ vt
        proper, mirror = (turn, other) if np.linalg.det(turn) > 0.0 else (other, turn)
        turn = mirror if np.trace(mirror) > np.trace(proper) + 1.0 else proper
    return turn, _explained(acceleration - expected @ turn.T, acceleration)


def _matched(rates: Array, gyro: Array, usable: Mask, shift: int) -> float:
    """Return the share of the gyro's variance that rates `shift` steps later explain."""
    both = usable & np.roll(usable, -shift)
    if shift > 0:
        both[-shift:] = False
    elif shift < 0:
        both[:-shift] = False
    g = gyro[both]
    return _explained(_fit(np.roll(rates, -shift, axis=0)[both], g), g)


def _fit(w: Array, g: Array) -> Array:
    """Return the residual of g after a linear map of w."""
    if not len(w):
        return g
    coefficients, _, _, _ = np.linalg.lstsq(w, g, rcond=None)
    return np.asarray(g - w @ coefficients)


def _horizontal_over_vertical(up: Array) -> Array:
    """Return (N, 2): horizontal over vertical part of body z (N, 3)."""
    return np.asarray(up[:, :2] / np.maximum(np.abs(up[:, 2:]), 0.2))


def _centred(values: Array) -> Array:
    return np.asarray(values - values.mean(axis=0))


def _explained(left: Array, whole: Array) -> float:
    return 1.0 - float(np.sum(left**2) / max(np.sum(whole**2), 1e-12))


def _rms(values: Array) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
