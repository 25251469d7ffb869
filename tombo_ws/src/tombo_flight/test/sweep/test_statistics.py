"""Rates, intervals and correlations are those of the textbooks' formulas."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from tombo_flight.sweep.statistics import (
    SPREAD_METRICS,
    flight_statistics,
    rank_correlation,
    share_interval,
    spread,
)


def test_spread_of_known_values():
    values = spread(pd.Series([1.0, np.nan, 2.0, 3.0, 4.0, 5.0]))

    assert (values["count"], values["mean"], values["max"]) == (5, 3.0, 5.0)
    assert values["std"] == pytest.approx(math.sqrt(2.5), abs=1e-6)
    assert (values["p05"], values["median"], values["p95"]) == (1.2, 3.0, 4.8)
    assert spread(pd.Series([7.0]))["std"] is None
    assert spread(pd.Series([np.nan])) == {**dict.fromkeys(values), "count": 0}


@pytest.mark.parametrize(
    ("count", "of"), [(0, 30), (30, 30), (1, 30), (14, 300), (299, 300), (3, 100_000)]
)
def test_the_interval_of_a_rate_is_that_of_clopper_and_pearson(count, of):
    exact = stats.binomtest(count, of).proportion_ci(0.95, "exact")
    assert share_interval(count, of) == pytest.approx((exact.low, exact.high), abs=1e-6)
    assert share_interval(0, 0) is None


def test_a_rank_correlation_is_that_of_the_ranks_and_leaves_flights_without_a_figure_out():
    rng = np.random.default_rng(3)
    x = rng.normal(size=200)
    y = np.exp(x + rng.normal(size=200))
    ranks = stats.rankdata(x), stats.rankdata(y)
    both = pd.DataFrame({"x": [*x, np.nan, 1.0], "y": [*y, 1.0, np.nan]})
    found = rank_correlation(both["x"], both["y"])
    assert found["flights"] == 200
    assert found["rho"] == pytest.approx(np.corrcoef(ranks)[0, 1])
    t = found["rho"] * math.sqrt(198.0 / (1.0 - found["rho"] ** 2))
    assert found["p"] == pytest.approx(2.0 * stats.t(198).sf(abs(t)))
    assert rank_correlation(both["x"], 0.0 * both["y"]) is None
    assert rank_correlation(both["x"][:2], both["y"][:2]) is None


def flight(**changes):
    return {
        **dict.fromkeys(SPREAD_METRICS, 1.0), "collided": True, "detected": True, "landed": True,
        "crashed": False, "false_alarms": 0, "struck_rotor": None, "contact_rotor": "front_left",
        **changes,
    }  # fmt: skip


def test_recovery_is_counted_over_flights_that_settled_without_crash():
    flights = [
        flight(),
        flight(recovery_time_s=None),
        flight(crashed=True, landed=False),
        flight(false_alarms=2, detected=False),
    ]

    total = flight_statistics(pd.DataFrame(flights))

    assert (total["flights"], total["crashed"], total["not_crashed"]) == (4, 1, 3)
    assert total["recovered"] == 2
    assert total["crash_rate"] == 0.25
    low, high = total["crash_rate_95"]  # of 1 in 4: the ends at which the count is 2.5 % likely
    assert 1.0 - (1.0 - low) ** 4 == pytest.approx(0.025, abs=1e-4)
    assert (1.0 - high) ** 4 + 4.0 * high * (1.0 - high) ** 3 == pytest.approx(0.025, abs=1e-4)
    assert (total["detected"], total["landed"], total["false_alarms"]) == (3, 3, 2)
    assert total["recovery_time_s"]["count"] == 3


def test_alarms_are_counted_by_the_hour_and_rotors_where_one_was_named():
    named = ("front_left", "front_left", "rear_left", None)
    flights = [flight(struck_rotor=rotor, duration_s=900.0) for rotor in named]
    flights += [
        flight(false_alarms=3, duration_s=1800.0),
        flight(collided=False, contact_rotor=None, struck_rotor="front_left", duration_s=0.0),
    ]

    total = flight_statistics(pd.DataFrame(flights))

    assert total["false_alarms_per_hour"] == 2.0  # 3 in an hour and a half
    assert (total["struck_rotor_named"], total["struck_rotor_right"]) == (3, 0.666667)
    nothing = flight_statistics(pd.DataFrame(flights)[:0])
    assert nothing["false_alarms_per_hour"] is nothing["struck_rotor_right"] is None
    assert nothing["crash_rate"] is nothing["crash_rate_95"] is None
