"""The figures of a loop's time keeping, against numpy."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tombo_dynamics.time_base import LATENESS_MAX_US
from tombo_ros.loop_statistics import LatenessHistogram, LoopStatistics

_durations = st.lists(st.integers(0, 19_000_000), min_size=1, max_size=200)


@pytest.mark.slow
@given(_durations, st.sampled_from([0.01, 0.25, 0.5, 0.9, 0.99, 1.0]))
def test_percentiles_are_numpys_to_the_microsecond(durations: list[int], share: float) -> None:
    histogram = LatenessHistogram()
    for duration in durations:
        histogram.add(duration)
    wanted = np.percentile(np.array(durations) // 1000, 100.0 * share, method="inverted_cdf")
    assert histogram.percentile_us(share) == wanted
    assert histogram.largest_us == pytest.approx(max(durations) * 1e-3)


def test_early_counts_as_zero_and_very_late_as_the_last_bin() -> None:
    histogram = LatenessHistogram()
    histogram.add(-5_000)
    assert histogram.percentile_us(1.0) == 0.0
    histogram.add(3_000_000_000)
    assert histogram.percentile_us(0.5) == 0.0
    assert histogram.percentile_us(1.0) == LATENESS_MAX_US
    assert histogram.largest_us == 3e6


@pytest.mark.slow
@given(st.integers(2, 400), st.integers(100_000, 50_000_000))
def test_the_rate_is_that_of_the_runs(runs: int, period_ns: int) -> None:
    watch = LoopStatistics()
    for k in range(runs):
        watch.ran(10**15 + k * period_ns, 100)
    metrics = watch.metrics()
    assert metrics["runs"] == runs
    assert metrics["rate_hz"] == pytest.approx(1e9 / period_ns, abs=6e-4)


def test_missed_deadlines_add_up() -> None:
    watch = LoopStatistics()
    watch.ran(0, 10)
    watch.ran(4_000_000, 3_000_000, missed=3)
    watch.ran(5_000_000, 10, missed=0)
    assert watch.metrics()["missed"] == 3
    assert watch.metrics()["jitter_max_us"] == 3000.0
