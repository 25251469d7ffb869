"""Operating points of propellers: configurations, or rows, over speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.propeller.laws.parameters import (
    DEFAULT_LAW,
    NO_EQUILIBRIUM,
    OK,
    ROW_SIZE,
    TWIST_OUT_OF_RANGE,
    checked,
    law_number,
    parameter_row,
)
from tombo_dynamics.propeller.laws.points import COLUMNS, solve_points
from tombo_dynamics.propeller.library import known_configuration
from tombo_dynamics.propeller.records import STANDARD, Configuration, Surroundings

RPM = math.pi / 30.0
"""One revolution per minute [rad/s]: 2000 * RPM is what `speed_rad_s` takes."""


@dataclass(frozen=True, eq=False)
class Operation:
    """Operating points; every array has the shape that was asked for."""

    speed_rad_s: Array
    thrust_N: Array
    drag_N: Array
    torque_Nm: Array
    """Not validated: the coefficients know no inflow, so it may be 2 to 3 times too high."""
    alpha_rad: Array
    """Lag of the wing: rotation of the nodus in the disc's plane."""
    beta_rad: Array
    """Flap: out of the disc's plane, upwards."""
    gamma_rad: Array
    """Twist about the span, nose down."""
    lift_over_drag: Array
    valid: NDArray[np.bool_]
    verdict: NDArray[np.int64]
    """0 valid, 1 twisted beyond the coefficients' range, 2 no equilibrium."""

    @property
    def speed_rpm(self) -> Array:
        """Rotor speed [rpm], for tables and figures."""
        return self.speed_rad_s / RPM

    @property
    def power_W(self) -> Array:
        """Shaft power [W], torque times speed; as little validated as the torque is."""
        return self.torque_Nm * self.speed_rad_s

    def __len__(self) -> int:
        """Return the number of points."""
        return self.speed_rad_s.size

    def __repr__(self) -> str:
        """Say what there is, not every number."""
        shape = " x ".join(map(str, self.speed_rad_s.shape)) or "one point"
        return f"{type(self).__name__}({shape}, {int(self.valid.sum())} of {len(self)} valid)"

    def table(self) -> dict[str, NDArray[np.generic]]:
        """Return the points as columns (n,), for `pandas.DataFrame`."""
        return {f.name: getattr(self, f.name).ravel() for f in fields(self)}


SPEED_LIMIT = 18000.0 * RPM
"""Highest speed [rad/s]: as far as the paper's figures go. The tip is then at Mach 0.6."""
_ACCEPTED_SPEEDS = f"accepted: 0 to {SPEED_LIMIT:.1f} rad/s (18000 rpm)"
OUTSIDE = ("error", "mask", "keep")
_REASONS = {
    TWIST_OUT_OF_RANGE: "the twist takes the tip out of the angles of attack that the "
    "coefficients were measured at",
    NO_EQUILIBRIUM: "no equilibrium continues the one at rest",
}


def evaluate(
    configuration: Configuration | int,
    speed_rad_s: ArrayLike,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
    outside: str = "error",
) -> Operation:
    """Return thrust, drag, torque and deformation of propellers at rotor speeds.

    T = rho omega^2 (A_T + cos alpha cos beta f_T(gamma)), drag and torque likewise (paper's Eq. 1
    and 8), with the nodus' angles from the law's equilibrium (`laws`).

    Args:
        configuration: a Configuration, or a number of Table I.
        speed_rad_s: rotor speeds [rad/s] from 0 to SPEED_LIMIT, any shape.
        law: "published", "repaired" or "consistent".
        surroundings: air density and gravity.
        outside: what to do with speeds at which the law is not valid: "error" refuses them, "mask"
            makes the results NaN, "keep" leaves them as the equations give them.

    Raises:
        InputError: unknown law; a speed that is NaN, negative or above SPEED_LIMIT; with
            outside="error", a speed at which the law is not valid: the valid range is named.
    """
    if outside not in OUTSIDE:
        raise unknown_name("outside", outside, OUTSIDE)
    row = parameter_row(configuration, law, surroundings)
    operation = evaluate_rows(row, speed_rad_s, law, "keep" if outside == "error" else outside)
    if outside == "error" and not operation.valid.all():
        raise _not_valid(operation, configuration, row, law)
    return operation


def evaluate_rows(
    rows: ArrayLike, speed_rad_s: ArrayLike, law: str = DEFAULT_LAW, outside: str = "mask"
) -> Operation:
    """Return operating points of many propellers, each given as a row of parameters.

    Args:
        rows: (ROW_SIZE,) or (..., ROW_SIZE), from `parameter_row`, perhaps varied; the leading
            dimensions broadcast with those of the speeds.
        speed_rad_s: rotor speeds [rad/s], broadcast with `rows`.
        law: the law that the rows were made for.
        outside: "mask" or "keep", see `evaluate`.

    Raises:
        InputError: unknown law, rows of another size or not finite, or a speed that is NaN,
            negative or above SPEED_LIMIT.
    """
    if outside not in OUTSIDE[1:]:
        raise unknown_name("outside", outside, OUTSIDE[1:])
    speeds = _checked_speeds(speed_rad_s)
    table = np.asarray(rows, dtype=float)
    if table.ndim == 0 or table.shape[-1] != ROW_SIZE or not np.isfinite(table).all():
        raise InputError(
            f"rows of shape {table.shape}; accepted: finite rows of {ROW_SIZE} numbers as "
            "parameter_row gives them"
        )
    leading = table.shape[:-1]
    try:
        shape = np.broadcast_shapes(leading, speeds.shape)
    except ValueError:
        raise InputError(
            f"rows of shape {table.shape} with speeds of shape {speeds.shape}; accepted: leading "
            "dimensions that broadcast"
        ) from None
    table = table.reshape(-1, ROW_SIZE)
    which = np.broadcast_to(np.arange(table.shape[0]).reshape(leading), shape)
    speeds = np.array(np.broadcast_to(speeds, shape))
    columns: Array = np.empty((speeds.size, COLUMNS))
    solve_points(
        law_number(law), np.ascontiguousarray(table), which.ravel(), speeds.ravel(), columns
    )
    columns = np.ascontiguousarray(columns.T)
    verdict = columns[7].astype(np.int64)
    valid = verdict == OK
    if outside == "mask":
        columns[:7, ~valid] = np.nan
    columns = columns.reshape((COLUMNS, *shape))
    return Operation(
        speed_rad_s=speeds,
        thrust_N=columns[0],
        drag_N=columns[1],
        torque_Nm=columns[2],
        alpha_rad=columns[3],
        beta_rad=columns[4],
        gamma_rad=columns[5],
        lift_over_drag=columns[6],
        valid=valid.reshape(shape),
        verdict=verdict.reshape(shape),
    )


def valid_speed(
    configuration: Configuration | int,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
) -> float:
    """Return the highest speed [rad/s] up to which a law is valid for a configuration.

    SPEED_LIMIT, or the speed at which the twist takes the tip below the lowest measured angle of
    attack of the section coefficients, if that is lower. It is accurate to 1e-9 of its value.

    Raises:
        InputError: unknown law or configuration.
    """
    return _valid_speed(*checked(configuration, law, surroundings))


@lru_cache(maxsize=256)
def _valid_speed(configuration: Configuration, law: str, surroundings: Surroundings) -> float:
    return float(valid_speed_of_rows(parameter_row(configuration, law, surroundings), law))


def valid_speed_of_rows(rows: ArrayLike, law: str) -> Array:
    """Return `valid_speed` [rad/s] of each row (..., ROW_SIZE)."""
    table = np.asarray(rows, dtype=float)
    low, high = np.zeros(table.shape[:-1]), np.full(table.shape[:-1], SPEED_LIMIT)
    whole = np.ones(low.shape, dtype=bool)
    for _ in range(8):
        speeds = np.linspace(low, high, 65, axis=-1)
        bad = ~evaluate_rows(table[..., None, :], speeds, law, "keep").valid
        whole &= ~bad.any(-1)
        if whole.all():
            break
        first = bad.argmax(-1)[..., None]
        before = np.take_along_axis(speeds, np.maximum(first - 1, 0), -1)[..., 0]
        at = np.take_along_axis(speeds, first, -1)[..., 0]
        low, high = np.where(whole, low, before), np.where(whole, high, at)
        if (high - low < 1e-9 * high)[~whole].all():
            break
    return np.where(whole, SPEED_LIMIT, low)


def _not_valid(
    operation: Operation, configuration: Configuration | int, row: Array, law: str
) -> InputError:
    """Build the error for the first point that is not valid."""
    place = np.unravel_index(int(np.argmin(operation.valid)), operation.valid.shape)
    member = known_configuration(configuration)
    worst, limit = float(operation.speed_rad_s[place]), float(valid_speed_of_rows(row, law))
    return InputError(
        f"speed {worst:.6g} rad/s ({worst / RPM:.6g} rpm) is outside the validity of law {law} "
        f"for {member.label}: {_REASONS[int(operation.verdict[place])]}; "
        f"accepted: 0 to {limit:.6g} rad/s ({limit / RPM:.6g} rpm)"
    )


def _checked_speeds(speed_rad_s: ArrayLike) -> Array:
    try:
        speeds = np.asarray(speed_rad_s, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"speed {shown(speed_rad_s)}; {_ACCEPTED_SPEEDS}") from None
    usable = (speeds >= 0.0) & (speeds <= SPEED_LIMIT)
    if not usable.all():
        worst = float(speeds.ravel()[int(np.argmin(usable.ravel()))])
        raise InputError(f"speed {worst:.6g} rad/s ({worst / RPM:.6g} rpm); {_ACCEPTED_SPEEDS}")
    return speeds
