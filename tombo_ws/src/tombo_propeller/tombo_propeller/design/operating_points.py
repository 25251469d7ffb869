"""Hover and highest usable thrust of many propellers on one vehicle, all at once."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import Configuration, evaluate_rows, parameter_row
from tombo_dynamics.propeller.thrust_map import USABLE_SHARE, peak_of_rows
from tombo_dynamics.vehicle import VehicleParams

_CHUNK = 256
"""Rows at a time: a row is repeated for each of its speeds."""
_SECANTS = 8


@dataclass(frozen=True, eq=False)
class FlightPerformance:
    """Where each propeller works, (n,) each; NaN where it can't lift the vehicle."""

    usable_speed: Array
    """0.9 of the speed of maximum thrust or the drive's highest, whichever is lower [rad/s]."""
    usable_thrust: Array
    """Thrust there [N]."""
    motor_limits: NDArray[np.bool_]
    """Whether the motor sets the limit."""
    hover_speed: Array
    """[rad/s]."""
    hover_lift_over_drag: Array
    hover_twist: Array
    """gamma [rad]."""


def flight_performance(
    configurations: Sequence[Configuration], vehicle: VehicleParams, law: str
) -> FlightPerformance:
    """Return where each configuration works on a vehicle.

    Args:
        configurations: n of them.
        vehicle: weight and highest rotor speed.
        law: of the nodus.
    """
    rows = np.array([parameter_row(c, law) for c in configurations])
    parts = [
        _performance(rows[i : i + _CHUNK], vehicle, law) for i in range(0, rows.shape[0], _CHUNK)
    ]
    fields = [np.concatenate(field) for field in zip(*parts, strict=True)]
    return FlightPerformance(*fields)


def _performance(rows: Array, vehicle: VehicleParams, law: str) -> tuple[NDArray[Any], ...]:
    motor = vehicle.rotor_speed_max
    peak, _, _ = peak_of_rows(rows, law, motor / USABLE_SHARE)
    usable = np.fmin(USABLE_SHARE * peak, motor)
    top = evaluate_rows(rows, usable, law).thrust_N
    hover = _speed_for(rows, usable, top, vehicle.hover_thrust(), law)
    lifts = np.isfinite(hover)
    at_hover = evaluate_rows(rows, np.where(lifts, hover, 0.0), law)
    ratio, twist = (
        np.where(lifts, values, np.nan) for values in (at_hover.lift_over_drag, at_hover.gamma_rad)
    )
    return usable, top, usable >= motor, hover, ratio, twist


def _speed_for(rows: Array, top: Array, most: Array, thrust: float, law: str) -> Array:
    """Return the speed (n,) at which each gives `thrust` [N], NaN where it never does.

    Regula falsi (Illinois) on thrust over speed squared: it is nearly constant.
    """
    low, high = np.zeros_like(top), top.copy()
    below, above = np.full_like(top, -thrust), most - thrust
    lifts = above >= 0.0
    side = np.zeros_like(top)
    guess = np.where(lifts, top * np.sqrt(thrust / np.where(most > 0.0, most, 1.0)), 0.0)
    for _ in range(_SECANTS):
        miss = evaluate_rows(rows, np.clip(guess, 0.0, top), law).thrust_N - thrust
        over = miss >= 0.0
        below = np.where(over & (side > 0.0), 0.5 * below, np.where(over, below, miss))
        above = np.where(~over & (side < 0.0), 0.5 * above, np.where(over, miss, above))
        high, low = np.where(over, guess, high), np.where(over, low, guess)
        side = np.where(over, 1.0, -1.0)
        with np.errstate(invalid="ignore", divide="ignore"):
            guess = low + (high - low) * below / (below - above)
        guess = np.where(np.isfinite(guess), guess, high)
    return np.where(lifts, guess, np.nan)
