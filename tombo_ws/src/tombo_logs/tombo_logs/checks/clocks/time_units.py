"""Stamps in another unit, and channels that share no time with the poses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_logs.checks.spans import sample_interval

_FASTEST_S, _SLOWEST_S = 2e-4, 0.5
"""s between poses: no motion capture is faster than 5 kHz, and below 2 Hz nothing is diagnosed."""
_ALIKE = 100.0
"""Channels of one flight last equally long up to this factor; another unit makes it 1000."""
_UNIT = "is it ms, us or ns, declared as s?"
_LEAST = 10


def check_pose_rate(flight: str, series: Mapping[str, Series]) -> None:
    """Refuse poses whose stamps can't be seconds.

    Raises:
        RefusedLog: one pose comes too soon or too late after the other.
    """
    for name in sorted({"attitude", "position"} & series.keys(), reverse=True):
        t = series[name].t
        step = sample_interval(t)
        if t.size >= _LEAST and not _FASTEST_S <= step <= _SLOWEST_S:
            text = (
                f"{name}: its stamps are {step:.3g} s apart; expected: {_FASTEST_S:g} to "
                f"{_SLOWEST_S:g} s; {_UNIT}"
            )
            raise RefusedLog(flight, name, text)


def other_units(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels whose stamps are in another unit than the poses'; to be left out."""
    length = max(float(np.ptp(series["position"].t)), 1e-9)
    ratios = {name: float(np.ptp(s.t)) / length for name, s in series.items()}
    wrong = [name for name, ratio in ratios.items() if not 1.0 / _ALIKE < ratio < _ALIKE]
    return [_left_out("unit", flight, name, series, _UNIT) for name in wrong]


def no_common_time(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels of which nothing is from the time of the poses; to be left out."""
    begin, end = series["position"].t[[0, -1]]
    apart = [n for n, s in series.items() if s.t[-1] <= begin or end <= s.t[0]]
    return [_left_out("stamps", flight, n, series, "no common time.") for n in apart]


def _left_out(
    check: str, flight: str, name: str, series: Mapping[str, Series], why: str
) -> Finding:
    (first, last), (begin, end) = (series[n].t[[0, -1]] for n in (name, "position"))
    text = (
        f"{name}: its stamps run from {first:.6g} to {last:.6g} s, those of the poses "
        f"from {begin:.6g} to {end:.6g} s; {why} Left out"
    )
    return Finding(check, "fault", flight, text, channel=name)
