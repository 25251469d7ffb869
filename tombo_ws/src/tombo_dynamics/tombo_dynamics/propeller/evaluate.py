"""Operating points of a propeller: one configuration or many parameter rows, over speeds."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.propeller.laws.names import DEFAULT_LAW, LOST, OK, TWIST, law_number
from tombo_dynamics.propeller.laws.parameters import ROW_SIZE, parameter_row
from tombo_dynamics.propeller.laws.points import COLUMNS, solve_points
from tombo_dynamics.propeller.records import STANDARD, Configuration, Surroundings

Array = NDArray[np.float64]

SPEED_LIMIT = 18000.0 * math.pi / 30.0
"""Highest speed [rad/s]: as far as the paper's figures go. The tip is then at Mach 0.6."""
_OUTSIDE = ("error", "mask", "keep")
_REASONS = {
    TWIST: "the twist takes the tip out of the angles of attack that the coefficients were "
    "measured at",
    LOST: "no equilibrium continues the one at rest",
}


@dataclass(frozen=True, eq=False)
class Operation:
    """Operating points; every array has the shape of the speeds asked for."""

    speed_rad_s: Array
    thrust_N: Array
    drag_N: Array
    torque_Nm: Array
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


def evaluate(
    configuration: Configuration,
    speed_rad_s: ArrayLike,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
    outside: str = "error",
) -> Operation:
    """Return thrust, drag, torque and deformation of a propeller at rotor speeds.

    Args:
        configuration: the propeller, e.g. `configuration(13)`.
        speed_rad_s: rotor speeds [rad/s] from 0 to SPEED_LIMIT, any shape.
        law: "published", "repaired" or "consistent".
        surroundings: air density and gravity.
        outside: what to do with speeds at which the law is not valid: "error" refuses them, "mask"
            makes the results NaN, "keep" leaves them as the equations give them.

    Raises:
        InputError: unknown law; a speed that is NaN, negative or above SPEED_LIMIT; with
            outside="error", a speed at which the law is not valid: the valid range is named.
    """
    if outside not in _OUTSIDE:
        raise unknown_name("outside", outside, _OUTSIDE)
    row = parameter_row(configuration, law, surroundings)
    operation = evaluate_rows(row, speed_rad_s, law, "keep" if outside == "error" else outside)
    if outside == "error" and not operation.valid.all():
        first = int(np.argmin(operation.valid.ravel()))
        worst = float(operation.speed_rad_s.ravel()[first])
        limit = valid_speed(configuration, law, surroundings)
        raise InputError(
            f"speed {worst:.6g} rad/s ({_rpm(worst)} rpm) is outside the validity of law {law} "
            f"for configuration {configuration.number}: "
            f"{_REASONS[int(operation.verdict.ravel()[first])]}; "
            f"accepted: 0 to {limit:.6g} rad/s ({_rpm(limit)} rpm)"
        )
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
    number = law_number(law)
    if outside not in _OUTSIDE[1:]:
        raise unknown_name("outside", outside, _OUTSIDE[1:])
    speeds = _checked_speeds(speed_rad_s)
    table = np.asarray(rows, dtype=float)
    if table.ndim == 0 or table.shape[-1] != ROW_SIZE or not np.isfinite(table).all():
        raise InputError(
            f"rows of shape {table.shape}; accepted: finite rows of {ROW_SIZE} numbers as "
            "parameter_row gives them"
        )
    try:
        shape = np.broadcast_shapes(table.shape[:-1], speeds.shape)
    except ValueError:
        raise InputError(
            f"rows of shape {table.shape} with speeds of shape {speeds.shape}; accepted: leading "
            "dimensions that broadcast"
        ) from None
    flat = np.ascontiguousarray(np.broadcast_to(speeds, shape)).reshape(-1)
    if table.ndim > 1:
        table = np.broadcast_to(table, (*shape, ROW_SIZE))
    out = np.empty((flat.size, COLUMNS))
    solve_points(number, np.ascontiguousarray(table).reshape(-1, ROW_SIZE), flat, out)
    verdict = out[:, 7].astype(np.int64)
    valid = verdict == OK
    if outside == "mask":
        out[~valid, :7] = np.nan
    columns = np.ascontiguousarray(out.T).reshape((COLUMNS, *shape))
    return Operation(
        speed_rad_s=flat.reshape(shape),
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


@lru_cache(maxsize=256)
def valid_speed(
    configuration: Configuration, law: str = DEFAULT_LAW, surroundings: Surroundings = STANDARD
) -> float:
    """Return the highest speed [rad/s] up to which a law is valid for a configuration.

    At most SPEED_LIMIT; below it, where the twist takes the tip below the lowest angle of attack
    at which the section coefficients were measured, to 1e-9 of the speed.

    Raises:
        InputError: unknown law.
    """
    row = parameter_row(configuration, law, surroundings)
    low, high = 0.0, SPEED_LIMIT
    for _ in range(8):
        speeds = np.linspace(low, high, 65)
        bad = np.flatnonzero(~evaluate_rows(row, speeds, law, "keep").valid)
        if not bad.size:
            return float(high)
        if not bad[0]:
            return 0.0
        low, high = float(speeds[bad[0] - 1]), float(speeds[bad[0]])
        if high - low < 1e-9 * high:
            break
    return low


def _checked_speeds(speed_rad_s: ArrayLike) -> Array:
    try:
        speeds = np.asarray(speed_rad_s, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"speed {speed_rad_s!r} is not a number; {_accepted_speeds()}") from None
    usable = (speeds >= 0.0) & (speeds <= SPEED_LIMIT)
    if not usable.all():
        worst = float(speeds.ravel()[int(np.argmin(usable.ravel()))])
        raise InputError(f"speed {worst:.6g} rad/s ({_rpm(worst)} rpm); {_accepted_speeds()}")
    return speeds


def _accepted_speeds() -> str:
    return f"accepted: 0 to {SPEED_LIMIT:.1f} rad/s (18000 rpm)"


def _rpm(speed: float) -> str:
    return f"{speed * 30.0 / math.pi:.6g}"
