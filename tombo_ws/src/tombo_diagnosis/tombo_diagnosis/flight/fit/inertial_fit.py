"""A vehicle from gyro, accelerometer and motor commands alone: no poses are needed.

Thrust of a rotor is offset + gain v + curvature v², where v follows the command as a first-order
lag after a delay. The accelerometer gives the thrust, the gyro's slope the moments of inertia:

    m a_z = Σ thrust,   I dω/dt = arm × thrust + constant

Lag and delay explain thrust, roll and pitch best together. Without the delay, with the lag of
thrust alone and the lower bound of the inertia, it equals the model of Eschmann, Albani and
Loianno, "Data-Driven System Identification of Quadrotors Subject to Motor Delays", 2024.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from scipy.ndimage import binary_erosion
from scipy.signal import lfilter

from tombo_bag.flight import Flight
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import ARM_X, ARM_Y, GRAVITY, DriveParams
from tombo_logs.checks.even_flight import INERTIAL_WIDTH, EvenFlight, smooth
from tombo_logs.checks.spans import interpolated

NEEDED = ("gyro", "accel", "motor_command")
_RATE = 1000.0
_EVERY = 5
"""Rows of the even clock for each that is fitted."""
_CARRIES = 0.5
"""Share of the usual command from which on the vehicle flies."""
_KNOCK = 2.5 * GRAVITY
_APART_S = 0.3
"""Margin of time excluded around spans without flight."""
_LEAST_S = 5.0
_LAGS: Array = np.asarray(np.geomspace(0.02, 0.12, 19), np.float64)
_DELAYS = (0.0, 0.005, 0.01, 0.015)
_HOVER = 0.6
"""Command near hover, at which the error of the thrust is told."""
_PARTS = 8
"""Of a flight, each left out in turn, for the deviations."""


@dataclass(frozen=True)
class InertialFit:
    """Inertial parameters that flights show of a vehicle."""

    drive: DriveParams
    lag: float
    """Time constant of the motors [s]."""
    delay: float
    """Before it [s]."""
    inertia: Array
    """(2,) about x and y [kg m²]."""
    bounds: Array
    """(2, 2) lowest and highest moments of inertia that noise of either side allows."""


def inertial_flight(log: Flight) -> EvenFlight:
    """Return `NEEDED` of a log on a clock of 1 kHz; rows count while it flies, and nothing knocks.

    Raises:
        InputError: a channel is missing, or it flies for less than `_LEAST_S`.
    """
    lacking = [name for name in NEEDED if name not in log.series or log.series[name].t.size < 2]
    if lacking:
        raise InputError(
            f"flight '{log.name}': no {', '.join(lacking)}; without poses needed: "
            f"{', '.join(NEEDED)}"
        )
    series = [log.series[name] for name in NEEDED]
    begin, end = max(s.t[0] for s in series), min(s.t[-1] for s in series)
    if not _LEAST_S <= end - begin <= 3600.0:
        raise InputError(
            f"flight '{log.name}': {max(end - begin, 0.0):.1f} s; accepted: {_LEAST_S:g} s to 1 h"
        )
    t = np.arange(begin, end, 1.0 / _RATE)
    values = (interpolated(t, s.t, s.values) for s in series)
    channels = dict(zip(NEEDED, values, strict=True))
    accel, mean = channels["accel"], channels["motor_command"].mean(axis=1)
    flies = mean > _CARRIES * np.percentile(mean, 80.0)
    flies &= np.linalg.norm(accel, axis=1) < _KNOCK
    good = binary_erosion(flies, np.ones(round(2.0 * _APART_S * _RATE)))
    if np.count_nonzero(good) < _LEAST_S * _RATE:
        raise InputError(
            f"flight '{log.name}': it flies for {np.count_nonzero(good) / _RATE:.1f} s; accepted: "
            f"{_LEAST_S:g} s or more"
        )
    return EvenFlight(t, channels, np.asarray(good))


def fit_inertial(flights: Sequence[EvenFlight], mass: float, arm: float) -> InertialFit:
    """Fit a vehicle of known mass [kg] and arms [m]."""
    best, least = None, np.inf
    for lag, delay in product(_LAGS, _DELAYS):
        fit, left = _fit_at(flights, mass, arm, float(lag), float(delay))
        if left < least:
            best, least = fit, left
    assert best is not None
    return best


def _fit_at(
    flights: Sequence[EvenFlight], mass: float, arm: float, lag: float, delay: float
) -> tuple[InertialFit, float]:
    """Return the fit with a lag and a delay, and the logarithm of its residual."""
    lagged = [_lagged(s.channels["motor_command"], lag, delay) for s in flights]
    rows = [np.flatnonzero(s.valid)[::_EVERY] for s in flights]
    powers = [
        np.column_stack([np.full(len(v), 4.0), v.sum(axis=1), (v**2).sum(axis=1)]) for v in lagged
    ]

    def fitted_rows(values: Iterable[Array], order: int = 0) -> Array:
        smoothed = zip(values, rows, strict=True)
        return np.concatenate([_smooth(v, order)[r] for v, r in smoothed])

    force = mass * fitted_rows(s.accel[:, 2] for s in flights)
    curve, left = _curve(fitted_rows(powers), force)
    drive = DriveParams(gain=float(curve[1]), offset=float(curve[0]), curvature=float(curve[2]))
    bounds = np.zeros((2, 2))
    for axis in range(2):
        x = fitted_rows(_moment(drive, v, arm)[:, axis] for v in lagged)
        y = fitted_rows((s.gyro[:, axis] for s in flights), 1)
        u, v = x - x.mean(), y - y.mean()
        cross = max(float(u @ v), 1e-30)
        bounds[axis] = cross / float(v @ v), float(u @ u) / cross
        left += float(np.log(max(1.0 - cross**2 / float(u @ u) / float(v @ v), 1e-9)))
    inertia = np.sqrt(bounds.prod(axis=1))
    return InertialFit(drive, lag, delay, inertia, bounds), left


def _curve(design: Array, force: Array) -> tuple[Array, float]:
    """Return offset, gain, curvature, and the logarithm of the share that they leave.

    Thrust grows with the command: a slope below zero at command 0 is noise.
    """
    curve = np.linalg.lstsq(design, force, rcond=None)[0]
    if curve[1] < 0.0:
        short = np.linalg.lstsq(design[:, [0, 2]], force, rcond=None)[0]
        curve = np.array([short[0], 0.0, short[1]])
    left = force - design @ curve
    return np.asarray(curve, np.float64), float(np.log(max(left.var() / force.var(), 1e-9)))


def _moment(drive: DriveParams, lagged: Array, arm: float) -> Array:
    """Return (N, 2) moments about x and y [N m]."""
    thrust = drive.thrust(lagged)
    return np.asarray(arm * np.column_stack([thrust @ ARM_Y, -thrust @ ARM_X]))


def _lagged(command: Array, lag: float, delay: float) -> Array:
    late = round(delay * _RATE)
    if late:
        command = np.vstack([np.repeat(command[:1], late, axis=0), command[:-late]])
    keep = float(np.exp(-1.0 / (_RATE * lag)))
    start = (keep * command[0])[None]
    return np.asarray(lfilter([1.0 - keep], [1.0, -keep], command, axis=0, zi=start)[0])


def _smooth(values: Array, order: int = 0) -> Array:
    return smooth(values, INERTIAL_WIDTH, 1.0 / _RATE, order)


def deviations(flights: Sequence[EvenFlight], mass: float, arm: float, fit: InertialFit) -> Array:
    """Return the deviations of thrust and both moments of inertia, as shares (3,).

    By leaving out parts of the flights (jackknife), at the lag and the delay of the fit.
    """
    values = []
    for k in range(_PARTS):
        parts = []
        for s in flights:
            good = s.valid.copy()
            begin, end = np.quantile(np.flatnonzero(good), [k / _PARTS, (k + 1) / _PARTS])
            good[int(begin) : int(end)] = False
            parts.append(replace(s, valid=good))
        part, _ = _fit_at(parts, mass, arm, fit.lag, fit.delay)
        hover = float(part.drive.thrust(np.full((1, 4), _HOVER)).sum())
        values.append([hover, *part.inertia])
    table = np.array(values)
    spread = np.sqrt((_PARTS - 1) * np.mean((table - table.mean(axis=0)) ** 2, axis=0))
    return np.asarray(spread / table.mean(axis=0))
