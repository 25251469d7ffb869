"""Whether the rotors' speeds can be those of the model's vehicle: its weight from its hover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY, VehicleParams
from tombo_logs.checks.ground import CUT_BEFORE_TAKE_OFF
from tombo_logs.checks.spans import Mask
from tombo_logs.checks.unit_mistakes import guess

_MASS_RATIO = (0.6, 1.65)
"""Mass that the rotors' speeds lift over the model's: no error of mass and thrust together that
the diagnosis knows goes beyond."""
_STANDING = 0.45
"""Rotor speed over that of the model's hover below which rotors carry no vehicle, whatever it
weighs: they idle or stand."""
_LEAST = 50


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
