"""Statistics of many flights: counts of outcomes, and the spread of each figure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

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

_SHARES = ("mean", "std", "median", "p05", "p95", "p5", "p50", "max")
Summary = Mapping[str, Any]


def spread(values: Sequence[float | None]) -> dict[str, float | int | None]:
    """Return how the values are spread; flights without the figure (None) are left out.

    Returns:
        count, mean, std (of the sample; None for less than two), median, p05, p95 (percentiles,
        linear between neighbours) and max; p5 and p50 are older names of p05 and median. None
        without any value. Where the values have two modes, the mean may be a value that no flight
        has: median and percentiles are what to quote.
    """
    found = np.array([value for value in values if value is not None], dtype=np.float64)
    if not found.size:
        return {"count": 0, **dict.fromkeys(_SHARES)}
    p05, median, p95 = (round(float(p), 6) for p in np.percentile(found, (5.0, 50.0, 95.0)))
    return {
        "count": int(found.size),
        "mean": round(float(found.mean()), 6),
        "std": round(float(found.std(ddof=1)), 6) if found.size > 1 else None,
        "median": median,
        "p05": p05,
        "p95": p95,
        "p5": p05,
        "p50": median,
        "max": round(float(found.max()), 6),
    }


def share_interval(count: int, of: int) -> tuple[float, float] | None:
    """Return the exact 95 % interval of a share (Clopper and Pearson 1934); None of none."""
    if not of:
        return None
    low, high = exact_interval(count, of)
    return round(low, 6), round(high, 6)


def exact_interval(count: int, of: int) -> tuple[float, float]:
    """Return it with all digits, of one or more."""
    if count in (0, of):  # in closed form, without the tenth of a second that scipy takes to load
        one_sided = -math.expm1(math.log(0.025) / of)
        return (0.0, one_sided) if count == 0 else (1.0 - one_sided, 1.0)
    from scipy.special import betaincinv

    low = float(betaincinv(count, of - count + 1, 0.025))
    return low, float(betaincinv(count + 1, of - count, 0.975))


def aggregate(flights: Sequence[Summary], wall_time_s: float) -> dict[str, Any]:
    """Return the figures of a campaign.

    Args:
        flights: the summaries.
        wall_time_s: from the first start to the last landing, start of the processes included.

    Returns:
        what `flight_statistics` returns, `wall_time_s`, and `real_time_factor`: flight time of
        all over `wall_time_s`.
    """
    return {
        **flight_statistics(flights),
        "wall_time_s": wall_time_s,
        "real_time_factor": _flown_s(flights) / wall_time_s if wall_time_s > 0.0 else None,
    }


def flight_statistics(flights: Sequence[Summary]) -> dict[str, Any]:
    """Return the figures of many flights.

    Args:
        flights: the summaries.

    Returns:
        counts of flights, `crash_rate` and its 95 % interval, `false_alarms` in all of them and an
        hour of flight, `struck_rotor_named`: flights with the reaction's estimate of the rotor
        that has touched, `struck_rotor_right`: the share of these in which it is the true one,
        and the spread of each of `SPREAD_METRICS`. Shares and rates of nothing are None.
    """
    crashed = _count(flights, "crashed")
    alarms = sum(int(flight["false_alarms"]) for flight in flights)
    named = [f for f in flights if f["struck_rotor"] is not None and f["collided"]]
    right = sum(flight["struck_rotor"] == flight["contact_rotor"] for flight in named)
    hours = _flown_s(flights) / 3600.0
    return {
        "flights": len(flights),
        "collided": _count(flights, "collided"),
        "detected": _count(flights, "detected"),
        "crashed": crashed,
        "not_crashed": len(flights) - crashed,
        "crash_rate": _share(crashed, len(flights)),
        "crash_rate_95": share_interval(crashed, len(flights)),
        "recovered": sum(
            not flight["crashed"] and flight["recovery_time_s"] is not None for flight in flights
        ),
        "landed": _count(flights, "landed"),
        "false_alarms": alarms,
        "false_alarms_per_hour": _share(alarms, hours),
        "struck_rotor_named": len(named),
        "struck_rotor_right": _share(right, len(named)),
        **{name: spread([flight[name] for flight in flights]) for name in SPREAD_METRICS},
    }


def _share(count: int, of: float) -> float | None:
    return round(count / of, 6) if of else None


def _flown_s(flights: Sequence[Summary]) -> float:
    return sum(float(flight["duration_s"]) for flight in flights)


def _count(flights: Sequence[Summary], key: str) -> int:
    return sum(bool(flight[key]) for flight in flights)
