"""The rotor as simulator and controller see it: thrust, torque and the inverse, in one table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.records import Record, field
from tombo_dynamics.vehicle import VehicleParams

_PIECES = 32
_INVERSE_PIECES = 128


class RotorMaps(Record):
    """The table; each piece of a curve has four cubic coefficients, the constant first."""

    step = field("rad/s", "distance of the knots of rotor speed")
    inverse_step = field("s/rad", "1 / step")
    root_step = field("N^0.5", "distance of the knots of the square root of thrust")
    inverse_root_step = field("N^-0.5", "1 / root_step")
    thrust_lowest = field("N", "thrust at idle speed")
    thrust_highest = field("N", "thrust at the highest commanded speed")
    torque_ratio = field("m", "drag torque over thrust in hover")
    thrust = field("N", "thrust over rotor speed", (_PIECES, 4))
    torque = field("N m", "drag torque over rotor speed", (_PIECES, 4))
    speed = field("rad/s", "rotor speed over the square root of thrust", (_INVERSE_PIECES, 4))


@dataclass(frozen=True)
class HoverPoint:
    """What each rotor does in hover."""

    thrust: float
    """[N]"""
    speed: float
    """[rad/s]"""
    torque: float
    """Drag torque [N m]."""

    @property
    def power(self) -> float:
        """Mechanical power of all four rotors [W]."""
        return 4.0 * self.torque * self.speed


def hover_point(maps: RotorMaps, vehicle: VehicleParams) -> HoverPoint:
    """Return the rotors' point in hover, from the table that is flown."""
    thrust = vehicle.hover_thrust()
    speed = float(speed_for_thrust(maps, thrust))
    return HoverPoint(thrust, speed, float(rotor_torque(maps, speed)))


def rotor_maps(thrust_map: Any, vehicle: VehicleParams) -> RotorMaps:
    """Build the table for a vehicle from a propeller's thrust map.

    The highest speed is the lower of the drive's and the map's limit. The map's limit is 0.9 of
    the speed of maximum thrust, beyond which thrust decreases.

    Args:
        thrust_map: object with `omega_max` [rad/s], `thrust(omega)` [N] and `torque(omega)` [N m],
            and perhaps `source`, the parameter that errors name.
        vehicle: the airframe and its drives.

    Raises:
        InputError: the propeller cannot lift the vehicle with 10 % to spare, or idling does.
    """
    top = min(vehicle.rotor_speed_max, float(thrust_map.omega_max))
    knots: Array = np.linspace(0.0, top, _PIECES + 1, dtype=np.float64)
    thrust = PchipInterpolator(knots, thrust_map.thrust(knots))
    torque = PchipInterpolator(knots, thrust_map.torque(knots))
    highest = float(thrust(top))
    hover = vehicle.hover_thrust()
    if highest < 1.1 * hover:
        source = getattr(thrust_map, "source", "propeller.conf")
        raise InputError(
            f"{source}: one propeller gives at most {highest:.2f} N "
            f"({top * 30 / math.pi:.0f} rpm), but vehicle.mass {vehicle.mass:g} kg needs "
            f"{hover:.2f} N each to hover and a tenth more to climb"
        )
    fine: Array = np.linspace(0.0, top, 2049, dtype=np.float64)
    idle = vehicle.rotor_speed_min
    if idle >= top or float(thrust(idle)) >= hover:
        raise InputError(
            f"vehicle.rotor_speed_min: {idle:g} rad/s already lifts the vehicle; accepted: below "
            f"{np.interp(hover, thrust(fine), fine):.0f} rad/s, the speed in hover"
        )
    roots: Array = np.linspace(0.0, math.sqrt(highest), _INVERSE_PIECES + 1, dtype=np.float64)
    speed = PchipInterpolator(roots, PchipInterpolator(np.sqrt(thrust(fine)), fine)(roots))
    table = RotorMaps.new()
    table.step = knots[1]
    table.root_step = roots[1]
    table.inverse_step = 1.0 / knots[1]
    table.inverse_root_step = 1.0 / roots[1]
    table.thrust_lowest = float(thrust(vehicle.rotor_speed_min))
    table.thrust_highest = highest
    table.torque_ratio = float(torque(speed(math.sqrt(hover)))) / hover
    for name, curve in (("thrust", thrust), ("torque", torque), ("speed", speed)):
        table[name] = curve.c[::-1].T
    return table


@compiled
def _piece(pieces: Array, step: float, inverse_step: float, x: float) -> float:
    i = min(max(int(x * inverse_step), 0), pieces.shape[0] - 1)
    d = x - i * step
    # two short chains in place of one long one: they run side by side
    return float(pieces[i, 0] + d * pieces[i, 1] + d * d * (pieces[i, 2] + d * pieces[i, 3]))


@compiled
def rotor_thrust(maps: RotorMaps, speed: float) -> float:
    """Return the thrust [N] of a whole propeller at `speed` [rad/s]."""
    return _piece(maps.thrust, maps.step, maps.inverse_step, speed)


@compiled
def rotor_torque(maps: RotorMaps, speed: float) -> float:
    """Return the drag torque [N m] of a whole propeller at `speed` [rad/s]."""
    return _piece(maps.torque, maps.step, maps.inverse_step, speed)


@compiled
def speed_for_thrust(maps: RotorMaps, thrust: float) -> float:
    """Return the rotor speed [rad/s] that gives `thrust` [N], clamped to the table's range."""
    root = math.sqrt(min(max(thrust, 0.0), maps.thrust_highest))
    return _piece(maps.speed, maps.root_step, maps.inverse_root_step, root)
