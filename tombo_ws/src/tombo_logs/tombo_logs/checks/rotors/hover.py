"""Whether the rotors' speeds can be those of the model's vehicle: its weight from its hover."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_bag.flight import Finding, RefusedLog, Series
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY, VehicleParams
from tombo_logs.checks.spans import Mask
from tombo_logs.checks.unit_mistakes import guess

_MASS_RATIO = (0.6, 1.65)
"""Mass that the rotors' speeds lift over the model's: no error of mass and thrust together that
the diagnosis knows goes beyond."""
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


def mass_lifted(drive: Series, flying: Mask, hover: Hover) -> float | None:
    """Return the mass [kg] that rotors of the model lift at these speeds; None: not known.

    Over a whole flight the mean specific force is that of gravity.
    """
    if np.count_nonzero(flying) < _LEAST:
        return None
    square = float(np.median(np.mean(drive.values[flying] ** 2, axis=1)))
    return hover.mass * square / hover.rotor_speed**2


def check_vehicle(
    flight: str, drives: dict[str, tuple[Series, Mask]], hover: Hover
) -> list[Finding]:
    """Report drives that can't be those of the model's vehicle while another one can.

    Args:
        flight: its name.
        drives: channel -> rotor speeds [rad/s], and which rows count.
        hover: of the model's vehicle.

    Raises:
        RefusedLog: none of them can: another vehicle, or another unit.
    """
    masses = {
        name: mass
        for name, (series, flying) in drives.items()
        if (mass := mass_lifted(series, flying, hover)) is not None
    }
    low, high = _MASS_RATIO
    wrong = {n: m for n, m in masses.items() if not low <= m / hover.mass <= high}
    if not wrong:
        return []
    texts = {name: _text(name, mass, hover) for name, mass in wrong.items()}
    if len(wrong) == len(masses):
        raise RefusedLog(
            flight,
            next(iter(texts)),
            f"{next(iter(texts.values()))}; is this another vehicle than the "
            "model's? Accepted: flights of the model's vehicle, or a log that says its airframe",
        )
    return [
        Finding("vehicle", "fault", flight, f"{text}; left out", channel=name)
        for name, text in texts.items()
    ]


def _text(name: str, mass: float, hover: Hover) -> str:
    ratio = float(np.sqrt(mass / hover.mass))
    return (
        f"{name}: with the propellers of the model ({hover.label}) such speeds carry "
        f"{mass:.2g} kg in flight, not {hover.mass:.2g} kg; it hovers at {hover.rotor_speed:.0f} "
        f"rad/s, here at {ratio * hover.rotor_speed:.0f}{guess(ratio, 'turning')}"
    )
