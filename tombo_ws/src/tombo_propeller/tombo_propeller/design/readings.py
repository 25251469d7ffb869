"""Prediction of collision force, recovery time and noise of a nodus without a reading.

Table III has one reading for each of nine soft propellers. Flap stiffness (its root, its
logarithm), the period of the wing on its nodus, share and diameter of the fibres were tried: none
predicts a reading left out better than the mean of the others, by more than chance. The mean is
the prediction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from tombo_dynamics.propeller import Configuration

FEWEST = 4
"""Readings that a prediction needs."""


@dataclass(frozen=True)
class MeanReading:
    """Mean of the readings of one figure, as the prediction of the next reading."""

    count: int
    mean: float
    """NaN with fewer than FEWEST readings."""
    error: float
    """RMS error of the mean of the others at each reading left out; NaN as the mean."""

    def reach(self, probability: float) -> float:
        """Return the distance from the mean that the next reading keeps with a probability.

        To each side, by Student's t.
        """
        return self.error * float(stats.t.ppf(probability, max(self.count - 1, 1)))


def read(name: str, measured: Sequence[Configuration]) -> MeanReading:
    """Return the mean of a figure over the soft propellers that have a reading of it.

    Args:
        name: `collision_force_N`, `recovery_s` or `noise_dB`.
        measured: configurations; rigid ones and those without such a reading are left out.
    """
    readings = [getattr(c.measured, name, None) for c in measured if c.nodus]
    values = np.array([value for value in readings if value is not None], dtype=float)
    n = values.size
    if n < FEWEST:
        return MeanReading(n, math.nan, math.nan)
    left_out = (values - values.mean()) * n / (n - 1)
    return MeanReading(n, float(values.mean()), math.sqrt(float((left_out**2).mean())))
