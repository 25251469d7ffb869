"""Statistics of many flights: outcomes, crash rates with intervals, spread of figures."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas as pd

SPREAD_METRICS = (
    "detection_latency_s",
    "contact_known_s",
    "max_falling_distance_m",
    "unstable_phase_s",
    "recovery_time_s",
    "strikes",
    "peak_contact_force_n",
    "settled_error_m",
    "max_tilt_rad",
    "hover_rms_m",
    "approach_rms_m",
    "collision_time_s",
    "duration_s",
)
"""Figures of a summary whose spread over the flights is given; SI units as the names say."""
_SHARES = ("mean", "std", "median", "p05", "p95", "max")


def spread(values: pd.Series[Any]) -> dict[str, float | int | None]:
    """Return how (N,) values are spread; flights without the figure are left out.

    Returns:
        count, mean, std (of the sample; None for less than two), median, p05, p95 (percentiles,
        linear between neighbours) and max; None without any value. Where the values have two
        modes, the mean may be a value that no flight has: median and percentiles are what to
        quote.
    """
    there = values.dropna().to_numpy(float)
    if not there.size:
        return {"count": 0, **dict.fromkeys(_SHARES)}
    p05, median, p95 = (round(float(p), 6) for p in np.percentile(there, (5.0, 50.0, 95.0)))
    return {
        "count": int(there.size),
        "mean": round(float(there.mean()), 6),
        "std": round(float(there.std(ddof=1)), 6) if there.size > 1 else None,
        "median": median,
        "p05": p05,
        "p95": p95,
        "max": round(float(there.max()), 6),
    }


def share_interval(count: int, of: int) -> tuple[float, float] | None:
    """Return the exact 95 % interval of a share (Clopper and Pearson 1934); None of none."""
    if not of:
        return None
    if count in (0, of):  # in closed form, without the tenth of a second that scipy takes to load
        one_sided = -math.expm1(math.log(0.025) / of)
        low, high = (0.0, one_sided) if count == 0 else (1.0 - one_sided, 1.0)
    else:
        from scipy.special import betaincinv

        low = float(betaincinv(count, of - count + 1, 0.025))
        high = float(betaincinv(count + 1, of - count, 0.975))
    return round(low, 6), round(high, 6)


def crash_rate(crashed: pd.Series[Any]) -> dict[str, Any]:
    """Return flights, crashed, crash_rate and its 95 % interval of (N,) outcomes."""
    count, of = int(crashed.sum()), int(crashed.size)
    interval = share_interval(count, of)
    return {
        "flights": of,
        "crashed": count,
        "crash_rate": _share(count, of),
        "crash_rate_95": None if interval is None else list(interval),
    }


def flight_statistics(flights: pd.DataFrame) -> dict[str, Any]:
    """Return the figures of many flights.

    Args:
        flights: a row a flight, with the figures of its summary as columns.

    Returns:
        what `crash_rate` returns, counts of outcomes, `false_alarms` in all flights and an hour of
        flight, `struck_rotor_named`: flights with the reaction's estimate of the rotor that has
        touched, `struck_rotor_right`: the share of these in which it is the true one, and the
        spread of each of `SPREAD_METRICS`. Shares and rates of nothing are None.
    """
    crashed = flights["crashed"].astype(bool)
    named = flights["struck_rotor"].notna() & flights["collided"].astype(bool)
    right = (flights["struck_rotor"] == flights["contact_rotor"]) & named
    alarms = int(flights["false_alarms"].sum())
    return {
        **crash_rate(crashed),
        "collided": int(flights["collided"].sum()),
        "detected": int(flights["detected"].sum()),
        "not_crashed": int((~crashed).sum()),
        "recovered": int((flights["recovery_time_s"].notna() & ~crashed).sum()),
        "landed": int(flights["landed"].sum()),
        "false_alarms": alarms,
        "false_alarms_per_hour": _share(alarms, float(flights["duration_s"].sum()) / 3600.0),
        "struck_rotor_named": int(named.sum()),
        "struck_rotor_right": _share(int(right.sum()), int(named.sum())),
        **{name: spread(flights[name]) for name in SPREAD_METRICS},
    }


def _share(count: int, of: float) -> float | None:
    return round(count / of, 6) if of else None


def rank_correlation(x: pd.Series[Any], y: pd.Series[Any]) -> dict[str, Any] | None:
    """Return Spearman's rank correlation of two figures (N,), and its p-value.

    Flights without one of the two are left out; None: fewer than three have both, or one of the
    two is the same in all.
    """
    both = x.notna() & y.notna()
    x, y = x[both].astype(float), y[both].astype(float)
    if len(x) < 3 or x.nunique() < 2 or y.nunique() < 2:
        return None
    from scipy.stats import spearmanr

    result = spearmanr(x, y)
    return {"flights": len(x), "rho": float(result.statistic), "p": float(result.pvalue)}
