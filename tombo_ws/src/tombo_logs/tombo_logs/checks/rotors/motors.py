"""Rotor speeds against commands, and saturation."""

from __future__ import annotations

import numpy as np

from tombo_bag.flight import Finding, Series
from tombo_dynamics.vehicle import ROTOR_NAMES
from tombo_logs.checks.spans import Mask, interpolated
from tombo_logs.checks.unit_mistakes import guess

_SCALES = (0.65, 1.5)
"""Measured over commanded speed, all rotors alike: a battery takes a fifth, a rough map of the
controllers as much; a factor of 2 is counted pulses."""
_SATURATED = 0.01
"""Share of the flight at a limit that is reported."""


def saturation(flight: str, channel: str, command: Series, flying: Mask) -> list[Finding]:
    """Report how long each motor was at its upper limit."""
    values = command.values[flying]
    if len(values) < 50:
        return []
    top = 1.0 if channel == "motor_command" else float(values.max())
    at = values >= top - 1e-4 * max(abs(top), 1e-9)
    if channel != "motor_command" and np.count_nonzero(at) < 20:
        return []  # a largest value is a limit only if it repeats
    shares = at.mean(axis=0)
    if shares.max() < _SATURATED:
        return []
    motors = ", ".join(
        f"{name} {100 * s:.0f} %" for name, s in zip(ROTOR_NAMES, shares, strict=True) if s > 0.002
    )
    text = (
        f"{channel}: at its upper limit for a part of the flight ({motors}); thrust does not "
        "follow the controller there"
    )
    return [Finding("saturation", "warning", flight, text, channel=channel)]


def range_of(flight: str, command: Series, flying: Mask) -> list[Finding]:
    """Report when a motor command is not between 0 and 1 in flight."""
    values = command.values[flying]
    if not len(values):
        return []
    low, high = float(np.min(values)), float(np.max(values))
    if low > -0.02 and high < 1.02:
        return []
    text = (
        f"motor_command: values from {low:.3g} to {high:.3g}; expected: 0 to 1 (in a mapping: "
        "range); left out"
    )
    return [Finding("unit", "fault", flight, text, channel="motor_command")]


def speed_against_command(
    flight: str, speed: Series, command: Series, flying: Mask
) -> list[Finding]:
    """Report when measured rotor speeds contradict the command; `flying`: rows (N,) of `speed`."""
    rows = flying & (speed.t >= command.t[0]) & (speed.t <= command.t[-1])
    if np.count_nonzero(rows) < 50:
        return []
    asked = interpolated(speed.t[rows], command.t, command.values)
    got = speed.values[rows]
    usual = np.median(asked, axis=0)
    ratio = np.median(got, axis=0) / np.maximum(usual, 1e-9)
    findings = []
    middle = float(np.median(ratio))
    if not _SCALES[0] < middle < _SCALES[1]:
        why = guess(middle, "turning", "rotor")
        text = f"{middle:.3g} times what is asked for; expected: about 1{why}; left out"
        return [_rpm(flight, "fault", text)]
    if not 0.8 < middle < 1.25:
        text = f"{middle:.2f} times what is asked for; expected: about 1"
        findings.append(_rpm(flight, "warning", text))
    return findings


def _rpm(flight: str, severity: str, text: str) -> Finding:
    return Finding("rpm", severity, flight, f"rotor_speed: {text}", channel="rotor_speed")
