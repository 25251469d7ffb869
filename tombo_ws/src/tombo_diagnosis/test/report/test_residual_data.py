"""What of a diagnosis is shown: the right driver, honest intervals, lines with gaps."""

import math

import numpy as np
import pytest
from diagnosis_samples import sample

from tombo_diagnosis.report import residual_data as view
from tombo_diagnosis.wording import interval
from tombo_flight.extended_model import FittedParameter


@pytest.mark.parametrize("verdict", ["named", "unknown"])
def test_the_driver_of_drag_is_the_velocity_along_the_same_axis(verdict):
    """Without a correction the residual itself finds it."""
    pair = view.best_pair(view.by_channel(sample(verdict).residuals))
    assert pair.channel in ("specific_force_x", "specific_force_y")
    assert pair.driver == f"body_velocity_{pair.channel[-1]} [m/s]"


def test_the_interval_of_a_mean_covers_it_though_samples_are_correlated():
    rng = np.random.default_rng(1)
    covered = []
    for _ in range(300):
        slow = np.repeat(rng.standard_normal(40), 100)  # a hundred samples say the same thing
        block = np.repeat(np.arange(40), 100)
        bins = view.binned(np.zeros(4000), slow, block, 1)
        covered.append((bins["mean"].abs() <= bins.half).all())
    assert 0.91 <= np.mean(covered) <= 0.985


def test_blocks_do_not_run_across_flights():
    named = sample()
    pair = view.best_pair(view.by_channel(named.residuals))
    seconds = sum(math.ceil(f.duration_s) for f in named.flights)
    assert pair.samples.block.nunique() == seconds


def test_a_line_ends_before_a_gap():
    t = np.arange(0.0, 10.0, 0.01)
    t[900:] += 5.0
    drawn = view.broken_at_gaps(t, np.ones(t.size))
    assert np.flatnonzero(np.isnan(drawn)).tolist() == [899]


@pytest.mark.parametrize(
    ("fitted", "text"),
    [
        ((0.2831, 0.2761, 0.2903), ("0.283", "0.276", "0.290")),
        ((0.041, -0.018, 0.1), ("0.04", "−0.02", "0.10")),
        ((1234.0, 1100.0, 1400.0), ("1234", "1100", "1400")),
        ((1.5e-7, 1.4e-7, 1.6e-7), ("1.50e−7", "1.40e−7", "1.60e−7")),
        ((2.0, math.nan, math.nan), ("2.00", "–", "–")),
        ((math.nan, math.nan, math.nan), ("–", "–", "–")),
        ((0.0, 0.0, 0.0), ("0", "0", "0")),
    ],
)
def test_values_have_the_digits_that_their_interval_allows(fitted, text):
    value, low, high = fitted
    shown = interval(FittedParameter("a", "1", 0.0, value, low, high))
    assert tuple(s.replace("e−07", "e−7") for s in shown) == text
