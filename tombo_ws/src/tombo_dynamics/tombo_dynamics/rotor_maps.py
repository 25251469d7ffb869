"""The rotor as simulator and controller see it: thrust, torque and the inverse, in one table.

One flat array, because that is what compiled code takes fastest; `R` says where things are in it.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.vehicle import VehicleParams

Array = NDArray[np.float64]

_PIECES = 32
_INVERSE_PIECES = 128


class _RotorIndex(NamedTuple):
    """Index of each part of the table."""

    inverse_step: int = 0
    """1 / distance of the knots of rotor speed [s/rad]."""
    inverse_root_step: int = 1
    """1 / distance of the knots of the square root of thrust [N^-0.5]."""
    thrust_lowest: int = 2
    """Thrust at idle speed [N]."""
    thrust_highest: int = 3
    """Thrust at the highest commanded speed [N]."""
    torque_ratio: int = 4
    """Drag torque over thrust in hover [m]."""
    step: int = 5
    """Distance of the knots of rotor speed [rad/s]."""
    root_step: int = 6
    """Distance of the knots of the square root of thrust [N^0.5]."""
    thrust: int = 8
    """32 x 4: cubic coefficients of thrust [N] over rotor speed [rad/s], constant first."""
    torque: int = 8 + 4 * _PIECES
    """32 x 4: the same for drag torque [N m]."""
    speed: int = 8 + 8 * _PIECES
    """128 x 4: the same for rotor speed [rad/s] over the square root of thrust [N]."""


R = _RotorIndex()
_SIZE = R.speed + 4 * _INVERSE_PIECES


def rotor_maps(thrust_map: Any, vehicle: VehicleParams) -> Array:
    """Build the table for a vehicle from a propeller's thrust map.

    The highest speed is the lower of the drive's and the map's own limit (0.9 of the speed of
    maximum thrust, beyond which more speed would soon mean less thrust).

    Args:
        thrust_map: object with `omega_max` [rad/s], `thrust(omega)` [N] and `torque(omega)` [N m].
        vehicle: the airframe and its drives.

    Raises:
        InputError: the propeller cannot lift the vehicle with 10 % to spare, or idling does.
    """
    top = min(vehicle.rotor_speed_max, float(thrust_map.omega_max))
    knots = np.linspace(0.0, top, _PIECES + 1)
    thrust = PchipInterpolator(knots, thrust_map.thrust(knots))
    torque = PchipInterpolator(knots, thrust_map.torque(knots))
    highest = float(thrust(top))
    hover = vehicle.hover_thrust()
    if highest < 1.1 * hover:
        raise InputError(
            f"propeller.conf: one propeller gives at most {highest:.2f} N "
            f"({top * 30 / math.pi:.0f} rpm), but vehicle.mass {vehicle.mass:g} kg needs "
            f"{hover:.2f} N each to hover and a tenth more to climb"
        )
    idle = vehicle.rotor_speed_min
    if idle >= top or float(thrust(idle)) >= hover:
        raise InputError(
            f"vehicle.rotor_speed_min: {idle:g} rad/s already lifts the vehicle; accepted: below "
            f"{float(thrust.solve(hover, extrapolate=False)[0]):.0f} rad/s, the speed in hover"
        )
    fine = np.linspace(0.0, top, 2049)
    roots = np.linspace(0.0, math.sqrt(highest), _INVERSE_PIECES + 1)
    speed = PchipInterpolator(roots, PchipInterpolator(np.sqrt(thrust(fine)), fine)(roots))
    table = np.zeros(_SIZE)
    table[R.step] = knots[1]
    table[R.root_step] = roots[1]
    table[R.inverse_step] = 1.0 / knots[1]
    table[R.inverse_root_step] = 1.0 / roots[1]
    table[R.thrust_lowest] = float(thrust(vehicle.rotor_speed_min))
    table[R.thrust_highest] = highest
    table[R.torque_ratio] = float(torque(speed(math.sqrt(hover)))) / hover
    for start, curve in ((R.thrust, thrust), (R.torque, torque), (R.speed, speed)):
        flat = np.ascontiguousarray(curve.c[::-1].T).ravel()
        table[start : start + flat.size] = flat
    return table


@compiled
def _piece(
    table: Array, start: int, pieces: int, step: float, inverse_step: float, x: float
) -> float:
    i = min(max(int(x * inverse_step), 0), pieces - 1)
    d = x - i * step
    k = start + 4 * i
    # two short chains in place of one long one: they run side by side
    return float(table[k] + d * table[k + 1] + d * d * (table[k + 2] + d * table[k + 3]))


@compiled
def rotor_thrust(table: Array, speed: float) -> float:
    """Return the thrust [N] of a whole propeller at `speed` [rad/s]."""
    return _piece(table, R.thrust, _PIECES, table[R.step], table[R.inverse_step], speed)


@compiled
def rotor_torque(table: Array, speed: float) -> float:
    """Return the drag torque [N m] of a whole propeller at `speed` [rad/s]."""
    return _piece(table, R.torque, _PIECES, table[R.step], table[R.inverse_step], speed)


@compiled
def speed_for_thrust(table: Array, thrust: float) -> float:
    """Return the rotor speed [rad/s] that gives `thrust` [N], clamped to the table's range."""
    root = math.sqrt(min(max(thrust, 0.0), table[R.thrust_highest]))
    return _piece(
        table, R.speed, _INVERSE_PIECES, table[R.root_step], table[R.inverse_root_step], root
    )
