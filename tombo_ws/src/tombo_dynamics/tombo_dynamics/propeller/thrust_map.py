"""Thrust and torque over speed as tables for the simulator, invertible where control needs it.

Beyond the speed of maximum thrust more speed means less thrust, and control would reverse; so a
map ends at 0.9 of it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller.cubic import cubic_table, cubic_values, inverse_table
from tombo_dynamics.propeller.evaluate import evaluate_rows
from tombo_dynamics.propeller.laws.names import DEFAULT_LAW
from tombo_dynamics.propeller.laws.parameters import checked, parameter_row
from tombo_dynamics.propeller.maximum_thrust import peak_of_rows
from tombo_dynamics.propeller.records import STANDARD, Configuration, Surroundings

USABLE_SHARE = 0.9
_CELLS = 48


@compiled
def map_thrust(coeffs: Array, inverse_step: float, omega: float) -> float:
    """Return the table's value at `omega`, for use inside compiled code.

    Args:
        coeffs: (n, 4) local cubics, lowest power first, in omega less the cell's lower knot.
        inverse_step: 1 / distance of the knots.
        omega: rotor speed [rad/s]; outside of the table its end value, NaN stays NaN.
    """
    cells = coeffs.shape[0]
    place = omega * inverse_step
    if not place > 0.0:
        return float(coeffs[0, 0]) if place <= 0.0 else omega
    i = int(min(place, float(cells - 1)))
    x = min(place - i, 1.0) / inverse_step
    c = coeffs[i]
    return float(c[0] + x * (c[1] + x * (c[2] + x * c[3])))


map_torque = map_thrust
"""The same for the torque's table."""


@compiled
def map_speed(
    speed_coeffs: Array, inverse_root_step: float, thrust_coeffs: Array, inverse_step: float,
    thrust: float,
) -> float:  # fmt: skip
    """Return the rotor speed [rad/s] that gives `thrust` [N], for use inside compiled code.

    The table over sqrt(thrust), then a Newton step on the thrust table. Outside of the map's range
    the speed is 0 or the map's highest; NaN stays NaN.

    Args:
        speed_coeffs: (m, 4) table of speed over sqrt(thrust) [N^0.5].
        inverse_root_step: 1 / distance of its knots.
        thrust_coeffs: (n, 4) table of thrust over speed.
        inverse_step: 1 / distance of its knots.
        thrust: [N].
    """
    if not thrust > 0.0:
        return 0.0 if thrust <= 0.0 else thrust
    top = thrust_coeffs.shape[0] / inverse_step
    place = math.sqrt(thrust) * inverse_root_step
    if place >= speed_coeffs.shape[0]:
        return top
    k = int(place)
    y = (place - k) / inverse_root_step
    d = speed_coeffs[k]
    omega = d[0] + y * (d[1] + y * (d[2] + y * d[3]))
    i = int(min(omega * inverse_step, float(thrust_coeffs.shape[0] - 1)))
    x = omega - i / inverse_step
    c = thrust_coeffs[i]
    slope = c[1] + x * (2.0 * c[2] + 3.0 * x * c[3])
    error = c[0] + x * (c[1] + x * (c[2] + x * c[3])) - thrust
    return float(min(omega - error / slope, top) if slope > 0.0 else omega)


@dataclass(frozen=True, eq=False)
class ThrustMap:
    """Thrust and torque of one propeller over speed, as local cubics; read only, do not write."""

    conf: int
    law: str
    omega_mtf: float
    """Speed of maximum thrust [rad/s]; where there is none, the end of the range searched."""
    has_maximum: bool
    """Whether thrust has a maximum up to 18 000 rpm; the law consistent and a rigid propeller
    have none, and then omega_mtf is 18 000 rpm."""
    omega_max: float
    """Highest speed of the map [rad/s], 0.9 omega_mtf: thrust rises all the way up to it."""
    thrust_max: float
    """Thrust at omega_max [N]."""
    d_omega: float
    """Distance of the knots [rad/s]."""
    d_root: float
    """Distance of the knots of `speed_coeffs` [N^0.5]."""
    thrust_coeffs: Array
    """(n, 4) [N], for `map_thrust`."""
    torque_coeffs: Array
    """(n, 4) [N m], for `map_torque`."""
    speed_coeffs: Array
    """(m, 4) [rad/s] over sqrt(thrust), for `map_speed`."""

    def thrust(self, omega: ArrayLike) -> Array:
        """Return thrust [N] at speeds [rad/s]; InputError outside of 0 to omega_max."""
        speeds = self._within("speed", omega, self.omega_max, "rad/s")
        return cubic_values(self.thrust_coeffs, self.d_omega, speeds)

    def torque(self, omega: ArrayLike) -> Array:
        """Return drag torque [N m] at speeds [rad/s]; InputError outside of 0 to omega_max."""
        speeds = self._within("speed", omega, self.omega_max, "rad/s")
        return cubic_values(self.torque_coeffs, self.d_omega, speeds)

    def speed_for_thrust(self, thrust: ArrayLike) -> Array:
        """Return speeds [rad/s] that give thrusts [N]; InputError outside of 0 to thrust_max."""
        wanted = self._within("thrust", thrust, self.thrust_max, "N")
        table = (self.speed_coeffs, 1.0 / self.d_root, self.thrust_coeffs, 1.0 / self.d_omega)
        speeds = [map_speed(*table, float(t)) for t in wanted.ravel()]
        return np.asarray(speeds).reshape(wanted.shape)

    def _within(self, name: str, values: ArrayLike, top: float, unit: str) -> Array:
        checked = np.asarray(values, dtype=float)
        inside = (checked >= 0.0) & (checked <= top * (1.0 + 1e-12))
        if not inside.all():
            worst = checked.ravel()[int(np.argmin(inside.ravel()))]
            raise InputError(
                f"{name} {worst:.6g} {unit} is outside the thrust map of configuration "
                f"{self.conf}, law {self.law}; accepted: 0 to {top:.6g} {unit}"
            )
        return np.asarray(np.minimum(checked, top))


def speed_of_maximum_thrust(
    configuration: Configuration | int,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
) -> tuple[float, bool]:
    """Return omega_mtf [rad/s] and whether thrust has a maximum there.

    The first maximum up to 18 000 rpm; without one, 18 000 rpm and False.

    Raises:
        InputError: unknown law or configuration, or the law stops being valid before thrust has a
            maximum.
    """
    return _speed_of_maximum_thrust(*checked(configuration, law, surroundings))


@lru_cache(maxsize=64)
def _speed_of_maximum_thrust(
    configuration: Configuration, law: str, surroundings: Surroundings
) -> tuple[float, bool]:
    peak = peak_of_rows(parameter_row(configuration, law, surroundings), law)
    if not peak.valid_further:
        raise InputError(
            f"law {law} stops being valid for {configuration.label} at "
            f"{float(peak.speed_rad_s):.4g} rad/s before thrust has a maximum; accepted: a "
            "configuration with a valid maximum or none below 18000 rpm"
        )
    return float(peak.speed_rad_s), bool(peak.has_maximum)


def thrust_map(
    configuration: Configuration | int,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
) -> ThrustMap:
    """Return the thrust map of a propeller up to 0.9 of its speed of maximum thrust.

    Raises:
        InputError: unknown law or configuration, or a propeller without a usable range.
    """
    return _thrust_map(*checked(configuration, law, surroundings))


@lru_cache(maxsize=64)
def _thrust_map(configuration: Configuration, law: str, surroundings: Surroundings) -> ThrustMap:
    omega_mtf, has_maximum = speed_of_maximum_thrust(configuration, law, surroundings)
    omega_max = USABLE_SHARE * omega_mtf
    knots = np.linspace(0.0, omega_max, _CELLS + 1, dtype=np.float64)
    nudge = 0.02 * knots[1]
    points = evaluate_rows(
        parameter_row(configuration, law, surroundings),
        np.abs(np.concatenate([knots, knots - nudge, knots + nudge])),
        law,
    )
    value = np.stack([points.thrust_N, points.torque_Nm]).reshape(2, 3, -1)
    slope = (value[:, 2] - value[:, 1]) / (2.0 * nudge)
    thrust_coeffs = cubic_table(knots[1], value[0, 0], slope[0])
    torque_coeffs = cubic_table(knots[1], value[1, 0], slope[1])
    thrust_max = float(value[0, 0, -1])
    d_root, speed_coeffs = inverse_table(knots, thrust_coeffs, thrust_max)
    return ThrustMap(
        configuration.number, law, omega_mtf, has_maximum, float(omega_max), thrust_max,
        float(knots[1]), d_root, thrust_coeffs, torque_coeffs, speed_coeffs,
    )  # fmt: skip
