"""Read a thrust or speed trace from a table."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.errors import InputError, unknown_name
from tombo_sysid.csv_table import open_table

Array = NDArray[np.float64]

UNITS = {
    "N": ("thrust [N]", 1.0),
    "mN": ("thrust [N]", 1e-3),
    "gf": ("thrust [N]", 9.80665e-3),
    "kgf": ("thrust [N]", 9.80665),
    "lbf": ("thrust [N]", 4.4482216),
    "rpm": ("speed [rad/s]", math.pi / 30.0),
    "rad/s": ("speed [rad/s]", 1.0),
    "Hz": ("speed [rad/s]", 2.0 * math.pi),
}
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_TIMES = ("time", "t", "time_s", "timestamp", "stamp", "seconds", "time_ms")
_VALUES = ("thrust", "force", "fz", "rpm", "speed", "omega")


@dataclass(frozen=True)
class Trace:
    """Time [s] and thrust [N] or speed [rad/s]."""

    time: Array
    value: Array
    label: str
    column: str
    notes: tuple[str, ...]

    @property
    def is_speed(self) -> bool:
        """Whether it is a speed; thrust goes with its square."""
        return self.label.startswith("speed")


def read_trace(
    path: Path,
    column: str | None = None,
    unit: str | None = None,
    time_column: str | None = None,
    time_unit: str = "s",
    tare: float = 0.0,
) -> Trace:
    """Read a trace; columns that are not named are found by their names.

    Args:
        path: CSV, plain or gzip.
        column: of thrust or speed.
        unit: one of `UNITS`; without it, what the column's name ends in, or N.
        time_column: of time.
        time_unit: one of `TIME_UNITS`.
        tare: what the unloaded cell reads, in the column's unit.

    Raises:
        InputError: no such file, column or unit.
    """
    if time_unit not in TIME_UNITS:
        raise unknown_name("unit of time", time_unit, TIME_UNITS)
    if unit is not None and unit not in UNITS:
        raise unknown_name("unit", unit, UNITS)
    if not math.isfinite(tare):
        raise InputError(f"--tare {tare:g}; accepted: a finite number")
    table = open_table(path)
    when = _column(table.columns, time_column, _TIMES, "time", path)
    what = _column(table.columns, column, _VALUES, "thrust or speed", path)
    if when == what:
        raise InputError(f"'{when}' for time and value both; accepted: two columns")
    numbers, damage = table.numbers({when, what})
    if unit is None:
        unit = _unit_of(what)
    label, factor = UNITS[unit]
    return Trace(
        numbers[when] * TIME_UNITS[time_unit], (numbers[what] - tare) * factor, label, what, damage
    )


def _column(
    columns: tuple[str, ...], name: str | None, usual: tuple[str, ...], what: str, path: Path
) -> str:
    if name is not None:
        if name not in columns:
            raise unknown_name(f"column in '{path}'", name, columns)
        return name
    for word in usual:
        found = [c for c in columns if c.lower() == word or c.lower().startswith(f"{word}_")
                 or c.lower().startswith((f"{word} ", f"{word}["))]  # fmt: skip
        if len(found) == 1:
            return found[0]
    option = "--time-column" if what == "time" else "--column"
    raise InputError(
        f"'{path}' has no one column of {what}; accepted: {option} with one of "
        f"{', '.join(columns)}"
    )


def _unit_of(column: str) -> str:
    lower = column.lower()
    for unit in ("rpm", "kgf", "gf", "mN", "lbf", "Hz"):
        if lower.endswith(unit.lower()) or f"[{unit.lower()}]" in lower:
            return unit
    if lower.startswith(("speed", "omega")) or lower.endswith(("rad/s", "rad_s")):
        return "rad/s"
    return "N"
