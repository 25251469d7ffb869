"""Uncertainty of the estimate, from its gains and the noise of its innovations.

The observer has fixed gains L and knows no noise beforehand. With M, the covariance of its errors
in units of a pose's noise, each pose gives (Bar-Shalom, Estimation with Applications to Tracking
and Navigation, 5.2: Joseph's form, good for any gain)

    M <- F M F',   s = 1 + M[0, 0],   M <- (I - L H) M (I - L H)' + L L',

where s is the innovation's variance in these units. So the mean of innovation^2 / s is the noise,
and noise times M, carried on to the present, the covariance. An error of the model makes
innovations larger, and the covariance with them. Axes are taken to be alike, and independent.
The gyro's noise, which the rates have as it is, follows from its second differences.
"""

from __future__ import annotations

import math
from typing import Any

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.time_base import TICK_S

_WINDOW_S = 2.0
"""Over which innovations and gyro samples are averaged."""
_DIFFERENCE = 2
"""Samples before the first second difference."""
_DIAGONAL = 7
"""From one element of the diagonal of a 6 x 6 matrix to the next."""


class Uncertainty(Record):
    """Covariances of the estimate's errors, and the noise that they are in units of."""

    place = field("1", "M of position, velocity [1/s], acceleration [1/s^2] of one axis", (3, 3))
    turn = field("1", "M of attitude, gyro bias [1/s] of one axis", (2, 2))
    poses = field("1", "innovations so far", kind=int)
    place_noise = field("m^2", "variance of a pose's position")
    turn_noise = field("rad^2", "variance of a pose's attitude")
    samples = field("1", "of the gyro so far", kind=int)
    gyro = field("rad/s", "the last two samples, the newer one first, body", (2, 3))
    gyro_noise = field("rad^2/s^2", "variance of a sample")


@compiled(inline=False)
def begin_uncertainty(memory: Uncertainty, period: float) -> None:
    """Begin with an estimate from one pose, its velocity from two, `period` [s] apart."""
    for i in range(3):
        for k in range(3):
            memory.place[i, k] = 0.0
    for i in range(2):
        for k in range(2):
            memory.turn[i, k] = 0.0
    memory.place[0, 0] = 1.0
    memory.place[0, 1] = memory.place[1, 0] = 1.0 / period
    memory.place[1, 1] = 2.0 / (period * period)
    memory.turn[0, 0] = 1.0
    memory.poses = 0
    memory.place_noise = 0.0
    memory.turn_noise = 0.0


@compiled(inline=False)
def take_innovation(
    memory: Uncertainty,
    place_gains: tuple[float, float, float],
    turn_gains: tuple[float, float],
    step: float,
    airborne: bool,
    place_square: float,
    turn_square: float,
) -> None:
    """Take the difference of a pose from its prediction.

    Args:
        memory: carried on.
        place_gains: on position, velocity, acceleration: as the observer's.
        turn_gains: on attitude, gyro bias.
        step: since the pose before [s].
        airborne: on the ground velocity and bias are not corrected, and the velocity is zero.
        place_square: mean over the axes of the squared difference [m^2].
        turn_square: the same of the attitude [rad^2].
    """
    place, turn = memory.place, memory.turn
    if not airborne:
        place_gains = (place_gains[0], 0.0, 0.0)
        for i in range(3):
            place[1, i] = place[i, 1] = place[2, i] = place[i, 2] = 0.0
    _predict(place, step)
    _predict(turn, step)
    memory.poses += 1
    share = max(1.0 / memory.poses, 1.0 - math.exp(-step / _WINDOW_S))
    variance = place_square / (1.0 + place[0, 0])
    memory.place_noise += share * (variance - memory.place_noise)
    variance = turn_square / (1.0 + turn[0, 0])
    memory.turn_noise += share * (variance - memory.turn_noise)
    _correct(place, place_gains)
    _correct(turn, turn_gains)


@compiled
def take_gyro(memory: Uncertainty, gyro: Array) -> None:
    """Take a gyro sample (3) [rad/s]; one that is not finite is left out."""
    last = memory.gyro
    square = 0.0
    for i in range(3):
        change = gyro[i] - 2.0 * last[0, i] + last[1, i]
        square += change * change
    if not math.isfinite(square):
        return
    for i in range(3):
        last[1, i] = last[0, i]
        last[0, i] = gyro[i]
    memory.samples += 1
    if memory.samples > _DIFFERENCE:
        share = max(1.0 / (memory.samples - _DIFFERENCE), TICK_S / _WINDOW_S)
        # of white noise the second difference has 1 + 4 + 1 times the variance
        memory.gyro_noise += share * (square / 18.0 - memory.gyro_noise)


@compiled
def _predict(m: Array, step: float) -> None:
    """M <- F M F' over `step` [s]: each state is the integral of the next."""
    n = m.shape[0]
    for _ in range(2):  # F M, transposed; twice gives F M F', as M is symmetric
        for k in range(n):
            if n == 3:
                m[0, k] += step * m[1, k] + 0.5 * step * step * m[2, k]
                m[1, k] += step * m[2, k]
            else:
                m[0, k] += step * m[1, k]
        _transpose(m)


@compiled
def _correct(m: Array, gains: Any) -> None:
    """M <- (I - L H) M (I - L H)' + L L'; H takes the first state."""
    n = m.shape[0]
    for _ in range(2):
        for k in range(n):
            first = m[0, k]
            for i in range(n):
                m[i, k] -= gains[i] * first
        _transpose(m)
    for i in range(n):
        for k in range(n):
            m[i, k] += gains[i] * gains[k]


@compiled
def _transpose(m: Array) -> None:
    for i in range(m.shape[0]):
        for k in range(i):
            m[i, k], m[k, i] = m[k, i], m[i, k]


@compiled(inline=False)
def fill_covariance(memory: Uncertainty, age: float, airborne: bool, out: Any) -> None:
    """Write the covariances of an odometry, `age` [s] after the newest pose.

    Args:
        memory: of the errors; zeros before the first innovation, which messages read as "not
            known".
        age: since the capture of the last pose used [s].
        airborne: on the ground the velocity is known to be zero.
        out: `pose_covariance` and `twist_covariance` (36) are written: variances of x, y, z and of
            the turns about them.
    """
    place, turn, square = memory.place, memory.turn, age * age
    velocity = place[1, 1] + 2.0 * age * place[1, 2] + square * place[2, 2]
    position = place[0, 0]
    if airborne:
        position += age * (2.0 * place[0, 1] + age * (place[1, 1] + place[0, 2]))
        position += age * square * (place[1, 2] + 0.25 * age * place[2, 2])
    else:
        velocity = 0.0
    noise = memory.gyro_noise
    attitude = turn[0, 0] + 2.0 * age * turn[0, 1] + square * turn[1, 1]
    for i in range(3):
        out.pose_covariance[_DIAGONAL * i] = memory.place_noise * position
        out.pose_covariance[_DIAGONAL * (i + 3)] = memory.turn_noise * attitude
        out.twist_covariance[_DIAGONAL * i] = memory.place_noise * velocity
        out.twist_covariance[_DIAGONAL * (i + 3)] = memory.turn_noise * turn[1, 1] + noise
