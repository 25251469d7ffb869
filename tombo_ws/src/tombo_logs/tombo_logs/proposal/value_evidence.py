"""What the values of a column say of its unit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.readers.units import UNITS

_USUAL_STEP = 0.01
"""s between samples of a log, in the middle of what there is."""
_FULL_SCALES = ((0.0, 1.0), (0.0, 100.0), (0.0, 255.0), (1000.0, 2000.0), (0.0, 65535.0))
"""What stands for 0 and 1 of a motor: shares, percent, bytes, pulses in us, Crazyflie's PWM."""


@dataclass(frozen=True)
class Guess:
    """A unit, why it is taken, and what is doubtful about it."""

    unit: str
    why: str
    doubt: str = ""


def time_unit(stamps: Array, named: str) -> Guess | None:
    """Return the unit of a column of times from its usual step; None: it does not rise."""
    stamps = stamps[np.isfinite(stamps)]
    steps = np.diff(stamps)
    if steps.size < 9 or np.mean(steps < 0.0) > 0.05 or not (steps > 0.0).any():
        return None
    step = float(np.median(steps[steps > 0.0]))
    distance = {u: abs(np.log10(step * f / _USUAL_STEP)) for u, f in UNITS["s"].items()}
    best = min((u for u in distance if u != "min"), key=lambda u: distance[u])
    unit = named if named in UNITS["s"] else best
    rate = 1.0 / (step * UNITS["s"][unit])
    why = f"median step {step:.6g}: {rate:.4g} rows/s"
    doubt = ""
    if not 2.0 < rate < 5000.0:
        doubt = f"{rate:.3g} rows/s is unusual; in {best} it would be usual"
    return Guess(unit, why, doubt)


def accel_unit(values: Array, named: str) -> Guess | None:
    """Return the unit of an accelerometer from gravity; None: gravity is not in it."""
    norm = float(np.nanmedian(np.linalg.norm(values, axis=1)))
    if np.linalg.norm(np.nanmedian(values, axis=0)) < 0.6 * norm:
        return None  # gravity has one direction in a vehicle that is mostly upright
    for unit, weight in (("m/s^2", GRAVITY), ("g", 1.0), ("mg", 1000.0)):
        if 0.8 * weight < norm < 1.25 * weight:
            why = f"median size {norm:.4g}: gravity in {unit}"
            other = named in UNITS["m/s^2"] and named != unit
            doubt = f"the name says {named}" if other else ""
            return Guess(unit, why, doubt)
    return None


def gyro_unit(scale: float, values: Array, named: str) -> Guess:
    """Return the unit of a gyro, from its size against the attitude's rates where they tell."""
    named = {"rad": "rad/s", "deg": "deg/s"}.get(named, named)
    if np.isfinite(scale) and scale > 0.0:
        units = ("rad/s", "deg/s", "mrad/s")
        best = min(units, key=lambda u: abs(np.log(scale * UNITS["rad/s"][u])))
        off = scale * UNITS["rad/s"][best]
        why = f"{scale:.3g} times the rates of the attitude"
        doubt = "" if 0.7 < off < 1.4 else f"{off:.2g} times what {best} would give"
        if named and named != best:
            doubt = f"the name says {named}"
        return Guess(best, why, doubt)
    if named in UNITS["rad/s"]:
        return Guess(named, "as named")
    high = float(np.nanpercentile(np.abs(values), 99))
    unit = "deg/s" if high > 15.0 else "rad/s"
    return Guess(unit, f"99 % of the values are below {high:.3g}", "too little motion to tell")


def angle_unit(values: Array, named: str) -> Guess | None:
    """Return the unit of angles; None: the values alone don't tell."""
    high = float(np.nanpercentile(np.abs(values), 99.5))
    if named in UNITS["rad"]:
        return Guess(named, "as named", f"up to {high:.3g}" if named == "rad" and high > 7 else "")
    return Guess("deg", f"values up to {high:.3g}") if high > 6.4 else None


def motor_scale(values: Array) -> tuple[float, float] | None:
    """Return what stands for 0 and for 1 of motor commands; None: these are none.

    Nearly all values must lie in between, or at least most: the end of a log may be damaged.
    """
    finite = values[np.isfinite(values)]
    running = finite[finite > 1e-3 * np.max(finite, initial=0.0)]
    if not running.size:
        return None
    middle = float(np.median(running))
    for share in (0.985, 0.7):
        for bottom, top in _FULL_SCALES:
            span = top - bottom
            inside = (finite > bottom - 0.12 * span) & (finite < bottom + 1.05 * span)
            if inside.mean() >= share and 0.1 < (middle - bottom) / span <= 1.0:
                return bottom, top
    return None


def speed_unit(values: Array, named: str, words: tuple[str, ...]) -> Guess:
    """Return the unit of rotor speeds."""
    if named in UNITS["rad/s"]:
        return Guess(named, "as named")
    if "rpm" in words:
        return Guess("rpm", "as named")
    high = float(np.nanpercentile(np.abs(values), 95))
    unit = "rpm" if high > 3000.0 else "rad/s"
    return Guess(unit, f"95 % are below {high:.4g}", "rpm and rad/s are told by size alone")


def voltage_unit(values: Array, named: str) -> Guess:
    """Return the unit of a supply voltage."""
    middle = float(np.nanmedian(values))
    unit = named if named in UNITS["V"] else ("mV" if middle > 200.0 else "V")
    volts = middle * UNITS["V"][unit]
    doubt = "" if 2.5 < volts < 60.0 else f"{volts:.3g} V is no usual battery"
    return Guess(unit, f"median {middle:.4g}", doubt)
