"""Velocity and acceleration of a track, with covariance, from its positions alone.

The model is white jerk. A Kalman filter goes forward and the smoother of Rauch, Tung and Striebel
(1965) goes back; both are filterpy's. Density of the jerk: the likeliest of a few.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from filterpy.common import Q_continuous_white_noise
from filterpy.kalman import KalmanFilter

from tombo_bag.flight import Series, Topic
from tombo_dynamics.arrays import Array
from tombo_logs.checks.spans import thinned

_STEP_S: Final = 0.01
"""Faster positions are averaged to this step: the filter takes 0.1 ms a sample."""
_JERKS: Final = (1.0, 10.0, 100.0, 1e3, 1e4)
"""m^2/s^5: spectral densities of jerk, from a hover to a strike."""
_TRIED: Final = 600
"""Samples on which the density is chosen."""
_LEAST_NOISE: Final = 2e-5
"""m: better than any motion capture."""
_BEGIN: Final = (3.0, 10.0)
"""m/s, m/s^2: standard deviations at the first sample."""
_LONGEST_S: Final = 0.1
"""Gap over which jerk is predicted; over a longer one velocity and acceleration begin again."""
_H: Final = np.array([[1.0, 0.0, 0.0]])


def position_noise(position: Series) -> float:
    """Return the standard deviation of white noise on a track, the mean of the axes [m].

    Third differences leave out what is smooth.
    """
    third = np.diff(_thinned(position)[1], 3, axis=0)
    if not len(third):
        return _LEAST_NOISE
    noise = 1.4826 * np.median(np.abs(third), axis=0) / np.sqrt(20.0)
    return max(float(np.sqrt(np.mean(noise**2))), _LEAST_NOISE)


def _thinned(position: Series) -> tuple[Array, Array]:
    t, places = thinned(position.t, position.values, _STEP_S)
    return (t, places) if t.size > 1 else (position.t, position.values)


def smooth_track(position: Series) -> Topic:
    """Smooth a cleaned track of at least two positions with rising stamps.

    Returns position [m], velocity [m/s] and acceleration [m/s^2] along the axes of map, each
    (N, 3), without gravity: at rest 0; and their covariance (N, 3, 3), alike for the three axes.
    """
    t, places = _thinned(position)
    noise = position_noise(position)
    middle = slice(max((t.size - _TRIED) // 2, 0), (t.size + _TRIED) // 2)
    chosen = max(_JERKS, key=lambda jerk: _filtered(t[middle], places[middle], noise, jerk)[2])
    steps, (means, covariances), _ = _filtered(t, places, noise, chosen)
    moves, noises = (np.array(list(part)) for part in zip(*steps, strict=True))
    kalman: Any = KalmanFilter(dim_x=3, dim_z=1)
    state, covariance, _, _ = kalman.rts_smoother(means, covariances, moves, noises)
    state[:, 0] += places[0]
    motion = {name: state[:, i] for i, name in enumerate(("position", "velocity", "acceleration"))}
    return Topic.of(t, {**motion, "covariance": covariance})


def _filtered(
    t: Array, places: Array, noise: float, jerk: float
) -> tuple[list[tuple[Array, Array]], tuple[Array, Array], float]:
    """Return the model of each step, the filter's estimates, and the log likelihood.

    The filter's means are (N, 3, 3): state, axis; its covariances (N, 3, 3).
    """
    kalman: Any = KalmanFilter(dim_x=3, dim_z=1)
    kalman.x = np.zeros((3, 3))  # a column for each axis: they share covariance and gain
    kalman.P = np.diag([noise**2, _BEGIN[0] ** 2, _BEGIN[1] ** 2])
    kalman.R = np.array([[noise**2]])
    known: dict[float, tuple[Array, Array]] = {}
    steps, means, covariances = [], [], []
    likelihood = 0.0
    for k, step in enumerate(np.diff(t, prepend=t[0]).round(5).tolist()):
        if step not in known:
            known[step] = _model(step, jerk)
        steps.append(known[step])
        if k:
            kalman.predict(F=known[step][0], Q=known[step][1])
            kalman.update((places[k] - places[0])[None], H=_H)
            spread = max(float(kalman.S[0, 0]), noise**2)  # rounding behind gaps of hours
            likelihood -= 1.5 * np.log(spread) + 0.5 * float(np.sum(kalman.y**2)) / spread
        means.append(kalman.x.copy())
        covariances.append(kalman.P.copy())
    return steps, (np.array(means), np.array(covariances)), likelihood


def _model(step: float, jerk: float) -> tuple[Array, Array]:
    """Return transition and process noise over a step [s] of white jerk [m^2/s^5]."""
    move = np.array([[1.0, step, 0.5 * step**2], [0.0, 1.0, step], [0.0, 0.0, 1.0]])
    noise = np.asarray(Q_continuous_white_noise(3, max(step, 1e-6), jerk))
    if step > _LONGEST_S:
        noise = noise + np.diag([(step * _BEGIN[0]) ** 2, _BEGIN[0] ** 2, _BEGIN[1] ** 2])
    return move, noise
