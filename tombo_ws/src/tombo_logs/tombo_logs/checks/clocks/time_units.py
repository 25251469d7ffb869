"""Stamps in another unit, and channels that share no time with the poses."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.errors import InputError
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
        InputError: one pose comes too soon or too late after the other.
    """
    for name in ("position", "attitude"):
        if name not in series:
            continue
        t = series[name].t
        step = sample_interval(t)
        if t.size < _LEAST or _FASTEST_S <= step <= _SLOWEST_S:
            continue
        raise InputError(
            f"flight '{flight}': {name}: its stamps are {step:.3g} s apart, over "
            f"{t[-1] - t[0]:.3g} s; expected: {_FASTEST_S:g} to {_SLOWEST_S:g} s{_unit(step)}"
        )


def other_times(flight: str, series: Mapping[str, Series]) -> list[Finding]:
    """Report channels whose stamps are not on the poses' clock; they are to be left out."""
    poses = series["position"].t
    begin, end = float(poses[0]), float(poses[-1])
    findings = []
    for name, s in series.items():
        length = float(s.t[-1] - s.t[0])
        ratio = length / max(end - begin, 1e-9)
        common = min(end, float(s.t[-1])) - max(begin, float(s.t[0]))
        why = _factor(ratio)
        if common > 0.0 and not why:
            continue
        text = (
            f"{name}: its stamps run from {s.t[0]:.6g} to {s.t[-1]:.6g} s, those of the poses "
            f"from {begin:.6g} to {end:.6g} s{why or ': no common time'}; left out"
        )
        check = "unit" if why else "stamps"
        findings.append(Finding(check, "fault", flight, text, channel=name))
    return findings


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
