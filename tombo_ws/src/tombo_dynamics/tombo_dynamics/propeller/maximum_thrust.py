"""The first maximum of thrust over speed, and the speed for a thrust below it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.propeller.evaluate import OUTSIDE, SPEED_LIMIT, evaluate_rows, points_of_rows
from tombo_dynamics.propeller.laws.names import DEFAULT_LAW
from tombo_dynamics.propeller.laws.parameters import ROW_SIZE
from tombo_dynamics.propeller.parameter_rows import (
    broadcast_error,
    family,
    float_array,
    parameter_rows,
)
from tombo_dynamics.propeller.records import STANDARD, Surroundings

_GRID = 91
_LEVELS = 6
_ROWS_AT_ONCE = 4096
_MOST_STEPS = 100


@dataclass(frozen=True, eq=False)
class Peak:
    """How far thrust rises with speed; every array has the propellers' shape."""

    speed_rad_s: Array
    """omega_mtf, the speed of maximum thrust; where there is none, the end of the rise."""
    thrust_N: Array
    """Thrust there."""
    gamma_rad: Array
    """Twist there."""
    has_maximum: NDArray[np.bool_]
    """False: thrust rises up to 18 000 rpm, or up to where the law stops being valid."""
    valid_further: NDArray[np.bool_]
    """False: the law stops being valid before thrust has a maximum."""


def thrust_peak(
    configurations: Any,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
    **changes: Any,
) -> Peak:
    """Return the first maximum of thrust up to 18 000 rpm of propellers, all that are asked for.

    Beyond it more speed means less thrust, and control would reverse.

    Args:
        configurations: a Configuration, a number of Table I, or an array-like of them.
        law: "published", "repaired" or "consistent".
        surroundings: air density and gravity.
        **changes: quantities that differ from the configurations', see `parameter_rows`.

    Raises:
        InputError: what is not accepted, see `parameter_rows`.
    """
    return peak_of_rows(parameter_rows(configurations, law, surroundings, **changes), law)


def speed_for_thrust(
    configurations: Any,
    thrust_N: ArrayLike,
    law: str = DEFAULT_LAW,
    surroundings: Surroundings = STANDARD,
    outside: str = "error",
    **changes: Any,
) -> Array:
    """Return the lowest rotor speeds [rad/s] that give thrusts [N], to 1e-12 of the thrust.

    Args:
        configurations: a Configuration, a number of Table I, or an array-like of them.
        thrust_N: wanted, from 0 to the maximum; broadcast with configurations and changes.
        law: "published", "repaired" or "consistent".
        surroundings: air density and gravity.
        outside: what to do with thrusts that the propeller can't give: "error" refuses them,
            "mask" makes the speed NaN, "keep" gives the speed of the most thrust.
        **changes: quantities that differ from the configurations', see `parameter_rows`.

    Raises:
        InputError: what is not accepted; with outside="error", a thrust that is out of reach.
    """
    if outside not in OUTSIDE:
        raise unknown_name("outside", outside, OUTSIDE)
    wanted = float_array("thrust", thrust_N, "accepted: thrusts [N]")
    rows = parameter_rows(configurations, law, surroundings, **changes)
    peak = peak_of_rows(rows, law)
    try:
        wanted, top, most = np.broadcast_arrays(wanted, peak.speed_rad_s, peak.thrust_N)
    except ValueError:
        given = {"thrust_N": thrust_N, **changes}
        raise broadcast_error(family(configurations), given) from None
    bad = ~(wanted >= 0.0)
    if bad.any():
        raise InputError(f"thrust {wanted[bad].flat[0]:g} N; accepted: 0 N and above")
    beyond = wanted > most * (1.0 + 1e-12)
    if beyond.any() and outside == "error":
        raise InputError(
            f"thrust {wanted[beyond].flat[0]:.6g} N is more than the propeller gives under law "
            f"{law}; accepted: 0 to {most[beyond].flat[0]:.6g} N"
        )
    which = np.broadcast_to(
        np.arange(peak.speed_rad_s.size).reshape(rows.shape[:-1]), wanted.shape
    )
    flat = rows.reshape(-1, ROW_SIZE)
    speed = _bracketed(flat, which.ravel(), wanted.ravel(), top.ravel(), most.ravel(), law)
    speed = speed.reshape(wanted.shape)
    return np.where(beyond, np.nan, speed) if outside == "mask" else speed


def peak_of_rows(rows: ArrayLike, law: str) -> Peak:
    """Return `thrust_peak` of each row (..., ROW_SIZE)."""
    table = np.asarray(rows, dtype=float)
    flat = table.reshape(-1, ROW_SIZE)
    parts = [
        _peak(flat[start : start + _ROWS_AT_ONCE], law)
        for start in range(0, max(len(flat), 1), _ROWS_AT_ONCE)
    ]
    speed, has_maximum, further = (
        np.concatenate(column).reshape(table.shape[:-1]) for column in zip(*parts, strict=True)
    )
    there = evaluate_rows(table, speed, law, "keep")
    return Peak(speed, there.thrust_N, there.gamma_rad, has_maximum, further)


def _peak(rows: Array, law: str) -> tuple[Array, NDArray[np.bool_], NDArray[np.bool_]]:
    """Return speed, whether it is a maximum, and whether the law is valid beyond, by row."""
    count = len(rows)
    each = np.arange(count)
    low: Array = np.zeros(count)
    high: Array = np.full(count, SPEED_LIMIT)
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
    speed = np.where(steady, SPEED_LIMIT, np.where(ends, speeds[each, peak], top))
    return speed, ~steady & ~ends, steady | ~ends


def _bracketed(
    rows: Array, which: NDArray[np.int64], wanted: Array, top: Array, most: Array, law: str
) -> Array:
    """Return the speeds in [0, top] with those thrusts, which rise from 0 to `most`; all (n,).

    Regula falsi in omega^2, which thrust is nearly linear in, with the Illinois weighting; every
    sixth step is bisection, so that the bracket always shrinks. Above `most` it is `top`.
    """
    active = np.flatnonzero((wanted > 0.0) & (wanted < most))
    found: Array = np.where(wanted >= most, top**2, 0.0)
    propeller, target = which[active], wanted[active]
    low: Array = np.zeros(active.size)
    high: Array = top[active] ** 2
    below, above = -target, most[active] - target
    side: Array = np.zeros(active.size)
    for step in range(1, _MOST_STEPS):
        if not active.size:
            break
        secant = (high - low) / (above - below)
        x = np.where(-below < above, low - below * secant, high - above * secant)
        x = 0.5 * (low + high) if step % 6 == 0 else np.clip(x, low, high)
        f = points_of_rows(rows, propeller, np.sqrt(x), law)[0] - target
        up = f >= 0.0
        again = np.where(up, 1.0, -1.0)
        shrink = np.where(side == again, 0.5, 1.0)
        low, high = np.where(up, low, x), np.where(up, x, high)
        below, above = np.where(up, shrink * below, f), np.where(up, f, shrink * above)
        done = (np.abs(f) <= 1e-12 * target) | (high - low <= 1e-15 * high)
        found[active[done]] = x[done]
        go = ~done
        active, propeller, target, side = active[go], propeller[go], target[go], again[go]
        low, high, below, above = low[go], high[go], below[go], above[go]
    found[active] = high
    return np.asarray(np.sqrt(found))
