"""The first maximum of thrust over speed, and the thrust map.

A thrust map has thrust and torque over speed as tables, from which the simulator's table is made.
Beyond the speed of maximum thrust more speed means less thrust, and control would reverse; so a
map ends at 0.9 of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.evaluate import SPEED_LIMIT, evaluate_rows
from tombo_dynamics.propeller.laws.parameters import DEFAULT_LAW, checked, parameter_row
from tombo_dynamics.propeller.records import STANDARD, Configuration, Surroundings


def cubic_table(step: float, value: Array, slope: Array) -> Array:
    """Return local cubics (n, 4), lowest power first, through n + 1 equidistant knots.

    Slopes that would let a cubic turn back between rising knots are lowered to Fritsch and
    Carlson's limit, three times the secants' slope; elsewhere they are kept as they are.

    Args:
        step: distance of the knots.
        value: (n + 1,) values at the knots.
        slope: (n + 1,) slopes at the knots.
    """
    secant = np.diff(value) / step
    steepest = 3.0 * np.minimum(np.append(secant, np.inf), np.insert(secant, 0, np.inf))
    bounded = np.where(steepest > 0.0, np.clip(slope, 0.0, np.maximum(steepest, 0.0)), slope)
    left, right = bounded[:-1], bounded[1:]
    second = (3.0 * secant - 2.0 * left - right) / step
    third = (left + right - 2.0 * secant) / step**2
    return np.ascontiguousarray(np.stack([value[:-1], left, second, third], axis=1))


def cubic_values(coeffs: Array, step: float, x: Array) -> Array:
    """Return the table's values at `x`, any shape, from 0 to n step."""
    i = np.minimum((x / step).astype(np.int64), coeffs.shape[0] - 1)
    y = x - i * step
    c = coeffs[i]
    return np.asarray(c[..., 0] + y * (c[..., 1] + y * (c[..., 2] + y * c[..., 3])))


_GRID = 91
_LEVELS = 6
_ROWS_AT_ONCE = 4096


def peak_of_rows(
    rows: Array, law: str, highest: float = SPEED_LIMIT
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the first maximum of thrust over speed of each row (n, ROW_SIZE).

    Args:
        rows: of the propellers.
        law: the law that the rows were made for.
        highest: upper limit of the search [rad/s].

    Returns:
        speed (n) [rad/s], without a maximum that at the end of the rise; whether it is a maximum;
        and whether the law is valid beyond.
    """
    parts = [
        _peak(rows[start : start + _ROWS_AT_ONCE], law, highest)
        for start in range(0, len(rows), _ROWS_AT_ONCE)
    ]
    speed, has_maximum, further = (np.concatenate(column) for column in zip(*parts, strict=True))
    return speed, has_maximum, further


def _peak(
    rows: Array, law: str, highest: float
) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    count = len(rows)
    each = np.arange(count)
    low: Array = np.zeros(count)
    high: Array = np.full(count, highest)
    steady, ends = np.zeros(count, dtype=bool), np.zeros(count, dtype=bool)
    for level in range(_LEVELS):
        speeds = np.linspace(low, high, _GRID, axis=-1)
        points = evaluate_rows(rows[:, None, :], speeds, law, "mask")
        falls = ~(np.diff(points.thrust_N, axis=-1) > 0.0)
        peak = np.where(falls.any(-1), falls.argmax(-1), _GRID - 1)
        if level == 0:
            steady = peak == _GRID - 1
        ends = ~points.valid[each, np.minimum(peak + 1, _GRID - 1)]
        peak = np.clip(peak, 1, _GRID - 2)
        left, right = speeds[each, peak - 1], speeds[each, peak + 1]
        # Finer than that, differences are rounding; a grid that is kept gives the same again.
        fine = steady | (~ends & (right - left < 1e-3 * right))
        if fine.all():
            break
        low, high = np.where(fine, low, left), np.where(fine, high, right)
    t = np.stack([points.thrust_N[each, peak + i] for i in (-1, 0, 1)])
    with np.errstate(invalid="ignore", divide="ignore"):
        vertex = 0.5 * (t[0] - t[2]) / (t[0] - 2.0 * t[1] + t[2])
    top = speeds[each, peak] + vertex * (speeds[:, 1] - speeds[:, 0])
    speed = np.where(steady, highest, np.where(ends, speeds[each, peak], top))
    return speed, ~steady & ~ends, steady | ~ends


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
    row = parameter_row(configuration, law, surroundings)
    (speed,), (has_maximum,), (further,) = peak_of_rows(row[None], law)
    if not further:
        raise InputError(
            f"law {law} stops being valid for {configuration.label} at "
            f"{float(speed):.4g} rad/s before thrust has a maximum; accepted: a "
            "configuration with a valid maximum or none below 18000 rpm"
        )
    return float(speed), bool(has_maximum)


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
