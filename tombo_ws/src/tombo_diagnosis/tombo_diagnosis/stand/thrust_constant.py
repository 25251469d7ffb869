"""The thrust constant of a plain propeller: k_T with interval, of all runs and of each."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_dynamics.arrays import Array

Numbers = NDArray[np.int64]

_BOOTSTRAP_BLOCKS = 12
_BOOTSTRAP_SAMPLES = 2000


@dataclass(frozen=True)
class ThrustConstant:
    """T = k_T omega^2, of one rotor."""

    k_T: float
    """N s^2"""
    low: float
    """End of the 95 % interval, block bootstrap over the run."""
    high: float
    with_offset: float
    """The same with a free zero."""
    offset_N: float
    exponent: float
    """Power of the speed that fits best, with a zero at standstill."""
    runs: dict[str, float]
    """k_T of each run."""


def thrust_constant(points: OperatingPoints) -> ThrustConstant:
    """Return k_T of a plain propeller's points."""
    setup, y = points.setup, points.readings[:, 0]
    known = np.isfinite(y) & (setup.speed > 0.0)
    x, y, run = setup.speed[known] ** 2, y[known], setup.run[known]
    elapsed = setup.elapsed[known]
    k = float(x @ y) / float(x @ x)
    low, high = _bootstrap(x, y, run, elapsed)
    design = np.column_stack([x, np.ones(x.size)])
    sloped, offset = np.linalg.lstsq(design, y, rcond=None)[0]
    exponent = _exponent(np.sqrt(x), y)
    runs = {
        name: float(x[run == n] @ y[run == n]) / float(x[run == n] @ x[run == n])
        for n, name in enumerate(points.runs)
        if (run == n).any()
    }
    return ThrustConstant(k, low, high, float(sloped), float(offset), exponent, runs)


def _bootstrap(x: Array, y: Array, run: Numbers, elapsed: Array) -> tuple[float, float]:
    """Return the 95 % interval of k by resampling stretches of the runs (fixed seed)."""
    block = np.minimum((elapsed * _BOOTSTRAP_BLOCKS).astype(int), _BOOTSTRAP_BLOCKS - 1)
    number = block + _BOOTSTRAP_BLOCKS * run.astype(int)
    names = np.unique(number)
    top = np.array([x[number == b] @ y[number == b] for b in names])
    bottom = np.array([x[number == b] @ x[number == b] for b in names])
    chosen = np.random.default_rng(0).integers(0, names.size, (_BOOTSTRAP_SAMPLES, names.size))
    drawn = top[chosen].sum(axis=1) / bottom[chosen].sum(axis=1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)


def _exponent(speed: Array, y: Array) -> float:
    good = (y > 0.05 * y.max()) & (speed > 0.0)
    if good.sum() < 3:
        return math.nan
    weight = y[good] / y[good].max()
    return float(np.polyfit(np.log(speed[good]), np.log(y[good]), 1, w=weight)[0])
