"""Check of the rotors' order: the commanded torque must agree with the measured rotation."""

from __future__ import annotations

from itertools import permutations

import numpy as np
from scipy.ndimage import gaussian_filter1d

from tombo_bag.flight import Finding, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import ARM_X, ARM_Y, ROTOR_NAMES, SPIN
from tombo_logs.checks.spans import Span, block_means, check_extent, inside, sample_interval

_RATE = 100.0
_WIDTH = 0.03
"""Standard deviation of the Gaussian that both sides pass through [s]."""
_LAGS = range(0, 16, 2)
"""Steps by which the turning follows: drives, links and stamps."""
_CLEAR, _BETTER = 0.8, 0.4
"""Sum of three correlations that tells an order, and by how much it must beat ours."""
_MIX = np.array([ARM_Y, -ARM_X, -SPIN])
"""Rows: what a rotor's thrust and torque do about body x, y and z."""
_ORDERS = tuple(permutations(range(4)))


def rotor_order(
    flight: str, channel: str, drive: Series, gyro: Series, exclude: list[Span]
) -> list[Finding]:
    """Report when another order of the rotors explains the gyro, and ours does not."""
    scores = order_scores(drive, gyro, exclude)
    best = max(scores, key=lambda order: scores[order], default=_ORDERS[0])
    if not scores or scores[best] < _CLEAR or scores[best] < scores[_ORDERS[0]] + _BETTER:
        return []
    order = ", ".join(ROTOR_NAMES[best.index(i)] for i in range(4))
    text = (
        f"{channel}: what it commands turns the vehicle otherwise; its columns fit as {order}; "
        f"expected: {', '.join(ROTOR_NAMES)}; left out"
    )
    return [Finding("rpm", "fault", flight, text, channel=channel)]


def clear_order(drive: Series, gyro: Series) -> tuple[int, ...] | None:
    """Return which column of `drive` each of our rotors is, where the motion tells it clearly."""
    scores = order_scores(drive, gyro, [])
    best, *others = sorted(scores, key=lambda order: -scores[order]) or [_ORDERS[0]]
    clear = others and scores[best] >= max(_CLEAR, scores[others[0]] + 0.5 * _BETTER)
    return best if clear else None


def order_scores(drive: Series, gyro: Series, exclude: list[Span]) -> dict[tuple[int, ...], float]:
    """Return for each order how well torque and rotation agree, at most 3; too short: nothing."""
    begin, end = max(drive.t[0], gyro.t[0]), min(drive.t[-1], gyro.t[-1])
    check_extent(begin, end, _RATE)
    t = np.arange(begin, end, 1.0 / _RATE)
    if t.size < 300:
        return {}
    sigma = _WIDTH * _RATE
    thrust = gaussian_filter1d(_sampled(drive, t) ** 2, sigma, axis=0)
    turning = gaussian_filter1d(_sampled(gyro, t), sigma, axis=0, order=1) * _RATE
    good = gaussian_filter1d(inside(t, exclude).astype(np.float64), sigma) < 1e-9
    good[: max(_LAGS)] = False
    if np.count_nonzero(good) < 300:
        return {}
    scores = np.max([_scores(np.roll(thrust, lag, 0)[good], turning[good]) for lag in _LAGS], 0)
    return dict(zip(_ORDERS, scores.tolist(), strict=True))


def _scores(thrust: Array, turning: Array) -> Array:
    """Return (24,): for each order, how well the three axes go together with the turning."""
    u = thrust - thrust.mean(axis=0)
    a = turning - turning.mean(axis=0)
    own, cross = u.T @ u, u.T @ a
    size = np.sqrt(np.maximum(np.sum(a**2, axis=0), 1e-12))
    result = np.zeros(len(_ORDERS))
    for i, order in enumerate(_ORDERS):
        rows = list(order)
        spread = np.sqrt(
            np.maximum(np.einsum("ki,ij,kj->k", _MIX, own[np.ix_(rows, rows)], _MIX), 1e-12)
        )
        result[i] = float(np.sum(np.einsum("ki,ik->k", _MIX, cross[rows]) / spread / size))
    return result


def _sampled(series: Series, t: Array) -> Array:
    """Return values at `t`, means over 10 ms where there are many."""
    every = max(round(1.0 / _RATE / max(sample_interval(series.t), 1e-6)), 1)
    stamps = block_means(series.t, every)
    columns = (block_means(c, every) for c in series.values.T)
    return np.column_stack([np.interp(t, stamps, c) for c in columns])
