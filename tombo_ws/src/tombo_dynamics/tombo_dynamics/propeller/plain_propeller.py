"""A propeller that is known by two coefficients or a measured curve, whatever it is made of."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.params import check_number

Curve = tuple[tuple[float, float, float], ...]
"""Rows of speed [rad/s], thrust [N], drag torque [N m]; all of them rise."""
_COLUMNS = (
    ("speed", "rad/s", (1.0, 10_000.0)),
    ("thrust", "N", (1e-6, 1000.0)),
    ("torque", "N m", (1e-9, 100.0)),
)
_FEWEST, _MOST = 2, 10_000


def read_curve(name: str, value: object) -> Curve | None:
    """Return a curve from plain lists; the row at rest, all zeros, may be there.

    Raises:
        InputError: no rows of three numbers, too few, or not rising.
    """
    if value is None or value == "":
        return None
    accepted = f"accepted: at least {_FEWEST} rows of [rad/s, N, N m], all rising"
    if not isinstance(value, list | tuple) or len(value) > _MOST:
        raise InputError(f"{name}: {shown(value)}; {accepted}")
    rows: list[tuple[float, float, float]] = []
    for i, row in enumerate(value):
        if not isinstance(row, list | tuple) or len(row) != len(_COLUMNS):
            raise InputError(f"{name}[{i}]: {shown(row)}; {accepted}")
        if i == 0 and all(x == 0 for x in row):
            continue
        speed, thrust, torque = (
            check_number(f"{name}[{i}].{column}", x, unit, bounds)
            for x, (column, unit, bounds) in zip(row, _COLUMNS, strict=True)
        )
        rows.append((speed, thrust, torque))
    if len(rows) < _FEWEST:
        raise InputError(f"{name}: {len(rows)} rows; {accepted}")
    for i, (last, row) in enumerate(itertools.pairwise(rows)):
        if not all(after > before for before, after in zip(last, row, strict=True)):
            raise InputError(
                f"{name}[{i + 1}]: {shown(list(row))} after {shown(list(last))}; {accepted}"
            )
    return tuple(rows)


@dataclass(frozen=True)
class PlainPropeller:
    """Thrust k_T omega^2 and drag torque k_Q omega^2, or both from a curve."""

    k_thrust: float
    """[N s^2/rad^2]"""
    k_torque: float
    """[N m s^2/rad^2]"""
    curve: Curve | None = None

    @property
    def omega_max(self) -> float:
        """Highest speed that is known [rad/s]: the curve's last, else without limit."""
        return math.inf if self.curve is None else self.curve[-1][0]

    @property
    def source(self) -> str:
        """The parameter that its thrust is from, as errors name it."""
        return "propeller.k_thrust" if self.curve is None else "propeller.curve"

    def thrust(self, omega: ArrayLike) -> Array:
        """Return thrust [N] at speeds [rad/s] from 0 to omega_max."""
        return self._of(omega, self.k_thrust, 1)

    def torque(self, omega: ArrayLike) -> Array:
        """Return drag torque [N m] at speeds [rad/s] from 0 to omega_max."""
        return self._of(omega, self.k_torque, 2)

    def speed_for(self, thrust: float) -> float:
        """Return the speed [rad/s] that gives a thrust [N]; beyond the curve, as at its end."""
        if self.curve is None:
            return math.sqrt(thrust / self.k_thrust)
        table = np.array(self.curve)
        roots = np.sqrt(table[:, 1])
        return float(np.interp(math.sqrt(thrust), roots, table[:, 0]))

    def _of(self, omega: ArrayLike, coefficient: float, column: int) -> Array:
        speed = np.asarray(omega, dtype=float)
        if self.curve is None:
            return np.asarray(coefficient * speed**2)
        table = np.array(self.curve)
        # The coefficient changes slowly with speed: it is interpolated, and held below the curve.
        shares = PchipInterpolator(table[:, 0], table[:, column] / table[:, 0] ** 2)
        return np.asarray(shares(np.clip(speed, table[0, 0], table[-1, 0])) * speed**2)
