"""Gain of an extended model: prediction error on held-out data before and after."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from scipy import stats

from tombo_dynamics.arrays import Array
from tombo_flight.extended_model import Gain

_FEW = 3
"""Least number of held-out blocks for an interval."""


def rms(values: Array) -> float:
    """Return the root mean square; NaN of nothing."""
    return float(np.sqrt(np.mean(values**2))) if values.size else math.nan


def gain_of(
    channel: str, unit: str, horizon: str, before: Sequence[float], after: Sequence[float]
) -> Gain:
    """Return a channel's gain; its interval from the logarithms of after over before.

    `before` and `after`: RMS error in each block held out, of the model as it was and extended.
    """
    b, a = np.array(before), np.array(after)
    total_before, total_after = rms(b), rms(a)
    reduction = 1.0 - total_after / total_before if total_before > 0.0 else 0.0
    low = high = math.nan
    if b.size >= _FEW and (b > 0.0).all() and (a > 0.0).all():
        logs = np.log(a / b)
        half = float(stats.t.ppf(0.975, b.size - 1)) * float(logs.std(ddof=1)) / math.sqrt(b.size)
        low = min(1.0 - math.exp(float(logs.mean()) + half), reduction)
        high = max(1.0 - math.exp(float(logs.mean()) - half), reduction)
    return Gain(
        channel, unit, horizon, total_before, total_after, reduction, low, high, int(b.size)
    )
