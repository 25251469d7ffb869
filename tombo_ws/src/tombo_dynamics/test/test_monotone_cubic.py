"""The monotone cubic against scipy's, which has the same definition."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import PchipInterpolator

from tombo_dynamics.monotone_cubic import MonotoneCubic


@pytest.mark.parametrize("count", [2, 3, 4, 33, 2049])
@pytest.mark.parametrize("kind", ["rising", "any", "flat", "even knots"])
def test_curve_is_that_of_scipy_to_the_last_bit(count: int, kind: str) -> None:
    rng = np.random.default_rng(count)
    knots = np.cumsum(rng.uniform(0.1, 2.0, count))
    values = rng.standard_normal(count)
    if kind == "rising":
        values = np.cumsum(np.abs(values))
    elif kind == "flat":
        values = np.round(values)
    elif kind == "even knots":
        knots = np.linspace(0.0, 700.0, count)
    ours, theirs = MonotoneCubic(knots, values), PchipInterpolator(knots, values)
    assert ours.coefficients[::-1].tobytes() == theirs.c.tobytes()
    x = np.concatenate([knots, rng.uniform(knots[0] - 1.0, knots[-1] + 1.0, 1000)])
    assert ours(x).tobytes() == theirs(x).tobytes()
    assert float(ours(float(x[-1]))) == float(theirs(x[-1]))
