"""Thrust and torque over speed as tables, from which the simulator's table is made.

Beyond the speed of maximum thrust more speed means less thrust, and control would reverse; so a
map ends at 0.9 of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.cubic import cubic_table, cubic_values
from tombo_dynamics.propeller.evaluate import evaluate_rows
from tombo_dynamics.propeller.laws.names import DEFAULT_LAW
from tombo_dynamics.propeller.laws.parameters import checked, parameter_row
from tombo_dynamics.propeller.maximum_thrust import peak_of_rows
from tombo_dynamics.propeller.records import STANDARD, Configuration, Surroundings

USABLE_SHARE = 0.9
_CELLS = 48


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
    thrust_coeffs: Array
    """(n, 4) [N], lowest power first, in omega less the cell's lower knot."""
    torque_coeffs: Array
    """(n, 4) [N m], in the same way."""

    def thrust(self, omega: ArrayLike) -> Array:
        """Return thrust [N] at speeds [rad/s]; InputError outside of 0 to omega_max."""
        speeds = self._within_map(omega)
        return cubic_values(self.thrust_coeffs, self.d_omega, speeds)

    def torque(self, omega: ArrayLike) -> Array:
        """Return drag torque [N m] at speeds [rad/s]; InputError outside of 0 to omega_max."""
        speeds = self._within_map(omega)
        return cubic_values(self.torque_coeffs, self.d_omega, speeds)

    def _within_map(self, omega: ArrayLike) -> Array:
        speeds, top = np.asarray(omega, dtype=float), self.omega_max
        inside = (speeds >= 0.0) & (speeds <= top * (1.0 + 1e-12))
        if not inside.all():
            worst = speeds.ravel()[int(np.argmin(inside.ravel()))]
            raise InputError(
                f"speed {worst:.6g} rad/s is outside the thrust map of configuration "
                f"{self.conf}, law {self.law}; accepted: 0 to {top:.6g} rad/s"
            )
        return np.asarray(np.minimum(speeds, top))


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
    return ThrustMap(
        configuration.number, law, omega_mtf, has_maximum, float(omega_max), thrust_max,
        float(knots[1]), thrust_coeffs, torque_coeffs,
    )  # fmt: skip
