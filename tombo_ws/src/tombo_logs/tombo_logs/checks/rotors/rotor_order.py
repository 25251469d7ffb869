"""Check of the rotors' order: the commanded torque must agree with the measured rotation."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES, SPIN
from tombo_logs.checks.spans import Span, check_extent, inside, interpolated, thinned

_RATE = 100.0
_WIDTH = 0.03
"""Standard deviation of the Gaussian that both sides pass through [s]."""
_LAGS = range(0, 16, 2)
"""Steps by which the turning follows: drives, links and stamps."""
_DELAYS = range(-30, 41)
"""Steps that are tried for the delay of the answer."""
_SOONEST_S, _LATEST_S = -0.02, 0.16
"""s by which the turning may follow its command: a vehicle that is later hardly flies, and none
turns before it is told to."""
_CLEAR, _BETTER = 0.8, 0.4
"""Sum of three correlations that tells an order, and by how much it must beat ours."""
_MIX = np.array([ARM_Y, -ARM_X, -SPIN])
"""Rows: moments of a rotor's thrust and torque about body x, y and z."""
_ORDERS = tuple(permutations(range(4)))


def rotor_order(
    flight: str, channel: str, drive: Series, gyro: Series, exclude: list[Span]
) -> list[Finding]:
    """Report when another order of the rotors explains the gyro, and ours does not."""
    by_lag = order_scores(drive, gyro, exclude, _LAGS, _ORDERS)
    if not len(by_lag):
        return []
    scores = dict(zip(_ORDERS, np.max(by_lag, axis=0).tolist(), strict=True))
    best = max(scores, key=lambda order: scores[order])
    if scores[best] < max(_CLEAR, scores[_ORDERS[0]] + _BETTER):
        return []
    order = ", ".join(ROTOR_NAMES[best.index(i)] for i in range(4))
    text = (
        f"{channel}: what it commands turns the vehicle otherwise; its columns fit as {order}; "
        f"expected: {', '.join(ROTOR_NAMES)}; left out"
    )
    return [Finding("rpm", "fault", flight, text, channel=channel)]


def command_delay(
    flight: str, channel: str, drive: Series, gyro: Series, exclude: list[Span]
) -> list[Finding]:
    """Report commands whose stamps contradict when the vehicle turns."""
    scores = order_scores(drive, gyro, exclude, _DELAYS, (_ORDERS[0],))
    if not len(scores):
        return []
    best = int(np.argmax(scores[:, 0]))
    delay = _DELAYS[best] / _RATE
    edge = best in (0, len(scores) - 1)
    if scores[best, 0] < _CLEAR or edge or _SOONEST_S <= delay <= _LATEST_S:
        return []
    text = (
        f"{channel}: the vehicle turns {1e3 * abs(delay):.0f} ms "
        f"{'after' if delay > 0.0 else 'before'} what its stamps say is commanded; expected: "
        f"{1e3 * max(_SOONEST_S, 0.0):.0f} to {1e3 * _LATEST_S:.0f} ms after"
    )
    return [Finding("stamps", "warning", flight, text, channel=channel)]


def order_scores(
    drive: Series,
    gyro: Series,
    exclude: list[Span],
    lags: Sequence[int],
    orders: Sequence[tuple[int, ...]],
) -> Array:
    """Return how well torque and rotation agree, at most 3: (lags, orders); too short: nothing.

    `lags`: steps of 10 ms by which the rotation follows.
    """
    begin, end = max(drive.t[0], gyro.t[0]), min(drive.t[-1], gyro.t[-1])
    check_extent(begin, end, _RATE)
    t = np.arange(begin, end, 1.0 / _RATE)
    if t.size < 300:
        return np.zeros((0, 0))
    sigma = _WIDTH * _RATE
    thrust = gaussian_filter1d(_sampled(drive, t) ** 2, sigma, axis=0)
    turning = gaussian_filter1d(_sampled(gyro, t), sigma, axis=0, order=1) * _RATE
    usable = gaussian_filter1d(inside(t, exclude).astype(np.float64), sigma) < 1e-9
    usable[: max(*lags, 0)] = False
    usable[t.size + min(*lags, 0) :] = False
    if np.count_nonzero(usable) < 300:
        return np.zeros((0, 0))
    return np.array(
        [_scores(np.roll(thrust, lag, 0)[usable], turning[usable], orders) for lag in lags]
    )


def _scores(thrust: Array, turning: Array, orders: Sequence[tuple[int, ...]]) -> Array:
    """Return (orders,): how well the three axes go together with the turning."""
    u = thrust - thrust.mean(axis=0)
    a = turning - turning.mean(axis=0)
    auto, cross = u.T @ u, u.T @ a
    size = np.sqrt(np.maximum(np.sum(a**2, axis=0), 1e-12))
    result = np.zeros(len(orders))
    for i, order in enumerate(orders):
        rows = list(order)
        spread = np.sqrt(
            np.maximum(np.einsum("ki,ij,kj->k", _MIX, auto[np.ix_(rows, rows)], _MIX), 1e-12)
        )
        result[i] = float(np.sum(np.einsum("ki,ik->k", _MIX, cross[rows]) / spread / size))
    return result


def _sampled(series: Series, t: Array) -> Array:
    """Return values at `t`, means over 10 ms where there are many."""
    return interpolated(t, *thinned(series.t, series.values, 1.0 / _RATE))
