"""Motor commands and rotor speeds: saturation, range, scale, and whose vehicle they carry."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY, ROTOR_NAMES, VehicleParams
from tombo_logs.checks.ground import CUT_BEFORE_TAKE_OFF
from tombo_logs.checks.spans import Mask, interpolated
from tombo_logs.readers.units import guess

_SCALES = (0.65, 1.5)
"""Measured over commanded speed, all rotors alike: a battery takes a fifth, a rough map of the
controllers as much; a factor of 2 is counted pulses."""
_SATURATED = 0.01
"""Share of the flight at a limit that is reported."""
_MASS_RATIO = (0.6, 1.65)
"""Mass that the rotors' speeds lift over the model's: no error of mass and thrust together that
the diagnosis knows goes beyond."""
_STANDING = 0.45
"""Rotor speed over that of the model's hover below which rotors carry no vehicle, whatever it
weighs: they idle or stand."""
_LEAST = 50


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


@dataclass(frozen=True)
class Hover:
    """How the model's vehicle hovers."""

    label: str
    mass: float
    """[kg]"""
    rotor_speed: float
    """of each rotor [rad/s]."""


def hover_of(label: str, vehicle: VehicleParams, maps: RotorMaps) -> Hover:
    """Return how a vehicle with these rotors hovers."""
    speed = speed_for_thrust(maps, 0.25 * vehicle.mass * GRAVITY)
    return Hover(label, vehicle.mass, float(speed))


def check_vehicle(
    flight: str, drives: dict[str, tuple[Series, Mask]], hover: Hover, rises: bool
) -> list[Finding]:
    """Report drives that can't be those of the model's vehicle while another one can.

    Over a whole flight the mean specific force is that of gravity.

    Args:
        flight: its name.
        drives: channel -> rotor speeds [rad/s], and which rows count.
        hover: of the model's vehicle.
        rises: whether the track leaves the ground (`ground.rises`).

    Raises:
        RefusedLog: none of them can: it does not fly, or another vehicle, or another unit.
    """
    speeds = {
        name: float(np.sqrt(np.median(np.mean(series.values[flying] ** 2, axis=1))))
        for name, (series, flying) in drives.items()
        if np.count_nonzero(flying) >= _LEAST
    }
    low, high = _MASS_RATIO
    texts = {
        name: f"{name}: with the propellers of the model ({hover.label}) such speeds carry "
        f"{hover.mass * ratio**2:.2g} kg in flight, not {hover.mass:.2g} kg; it hovers at "
        f"{hover.rotor_speed:.0f} rad/s, here at {speed:.0f}{guess(ratio, 'turning')}"
        for name, speed in speeds.items()
        if not low <= (ratio := speed / hover.rotor_speed) ** 2 <= high
    }
    if texts and len(texts) == len(speeds):
        name, text = next(iter(texts.items()))
        why = (
            "is this another vehicle than the model's? Accepted: flights of the model's vehicle, "
            "or a log that says its airframe"
        )
        if not rises and max(speeds.values()) < _STANDING * hover.rotor_speed:
            why = f"it does not fly: z stays where it is; {CUT_BEFORE_TAKE_OFF}"
        raise RefusedLog(flight, name, f"{text}; {why}")
    return [
        Finding("vehicle", "fault", flight, f"{text}; left out", channel=name)
        for name, text in texts.items()
    ]
