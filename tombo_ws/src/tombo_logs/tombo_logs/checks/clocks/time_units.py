"""Stamps in another unit, and channels that share no time with the poses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_logs.checks.spans import sample_interval

_FASTEST_S, _SLOWEST_S = 2e-4, 0.5
"""s between poses: no motion capture is faster than 5 kHz, and below 2 Hz nothing is diagnosed."""
_UNITS = {1e3: "ms", 1e6: "us", 1e9: "ns"}
_ALIKE = 3.0
"""Channels of one flight last equally long up to this factor."""
_LEAST = 10


def check_pose_rate(flight: str, series: Mapping[str, Series]) -> None:
    """Refuse poses whose stamps can't be seconds.

    Raises:
        RefusedLog: one pose comes too soon or too late after the other.
    """
    for name in ("position", "attitude"):
        if name not in series:
            continue
        t = series[name].t
        step = sample_interval(t)
        if t.size < _LEAST or _FASTEST_S <= step <= _SLOWEST_S:
            continue
        raise RefusedLog(
            flight,
            name,
            f"{name}: its stamps are {step:.3g} s apart, over "
            f"{t[-1] - t[0]:.3g} s; expected: {_FASTEST_S:g} to {_SLOWEST_S:g} s{_unit(step)}",
        )


def other_units(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels whose stamps are in another unit than the poses'; to be left out."""
    length = float(np.ptp(series["position"].t))
    whys = {n: _factor(float(np.ptp(s.t)) / max(length, 1e-9)) for n, s in series.items()}
    return [_left_out("unit", flight, n, series, why) for n, why in whys.items() if why]


def no_common_time(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels of which nothing is from the time of the poses; to be left out."""
    begin, end = series["position"].t[[0, -1]]
    apart = [n for n, s in series.items() if s.t[-1] <= begin or end <= s.t[0]]
    return [_left_out("stamps", flight, n, series, ": no common time") for n in apart]


def _left_out(
    check: str, flight: str, name: str, series: Mapping[str, Series], why: str
) -> Finding:
    spans = [series[n].t[[0, -1]] for n in (name, "position")]
    (first, last), (begin, end) = spans
    text = (
        f"{name}: its stamps run from {first:.6g} to {last:.6g} s, those of the poses "
        f"from {begin:.6g} to {end:.6g} s{why}; left out"
    )
    return Finding(check, "fault", flight, text, channel=name)


def _factor(ratio: float) -> str:
    """Return which mistake of units makes a channel last `ratio` times as long, or nothing."""
    for factor, unit in _UNITS.items():
        if factor / _ALIKE < ratio < factor * _ALIKE:
            return f": {unit} declared as s?"
        if 1.0 / _ALIKE < ratio * factor < _ALIKE and factor < 1e6:
            return f": s declared as {unit}?"
    return ""


def _unit(step: float) -> str:
    if step < _FASTEST_S:
        return "; s declared as ms?"
    for factor, unit in _UNITS.items():
        if np.sqrt(_FASTEST_S * 1e-3) < step / factor < 0.3:
            return f"; {unit} declared as s?"
    return ""
