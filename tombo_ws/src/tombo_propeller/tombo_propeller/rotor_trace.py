"""Read a thrust or speed trace from a table."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_logs.readers.csv_table import open_table

THRUST, SPEED = "thrust", "speed"
UNITS = {
    **dict.fromkeys(("N", "mN", "gf", "kgf", "lbf"), THRUST),
    **dict.fromkeys(("rpm", "rad/s", "Hz"), SPEED),
}
"""Quantity of a unit. Recovery is a share of the level, so values stay in theirs."""
TIME_UNITS = {"s": 1.0, "ms": 1e-3, "us": 1e-6}
_SPELLED = {
    **{unit.lower(): unit for unit in UNITS},
    **{"g": "gf", "kg": "kgf", "lb": "lbf", "rad_s": "rad/s", "rads": "rad/s"},
}
_SPELLED_TIMES = {**{unit: unit for unit in TIME_UNITS}, "seconds": "s", "sec": "s", "µs": "us"}
_TIMES = ("time", "t", "time_s", "timestamp", "stamp", "seconds", "time_ms")
_THRUSTS, _SPEEDS = ("thrust", "force", "fz"), ("rpm", "speed", "omega")


@dataclass(frozen=True)
class RotorTrace:
    """Time [s] and thrust or speed, less the tare, in `unit`."""

    time: Array
    value: Array
    unit: str
    """One of `UNITS`."""
    column: str
    notes: tuple[str, ...]

    @property
    def kind(self) -> str:
        """`thrust` or `speed`."""
        return UNITS[self.unit]

    @property
    def is_speed(self) -> bool:
        """Whether it is a speed; thrust goes with its square."""
        return self.kind == SPEED


def read_trace(
    path: Path,
    column: str | None = None,
    unit: str | None = None,
    time_column: str | None = None,
    time_unit: str | None = None,
    tare: float = 0.0,
) -> RotorTrace:
    """Read a trace; columns that are not named are found by their names.

    Args:
        path: CSV, plain or gzip.
        column: of thrust or speed.
        unit: one of `UNITS`; without it the one in the column's name, or N, or rad/s for a speed.
        time_column: of time.
        time_unit: one of `TIME_UNITS`; without it the one in the column's name, or s.
        tare: reading of the unloaded cell, in the column's unit.

    Raises:
        InputError: no such file, column or unit, or a unit that the column's name contradicts.
    """
    if time_unit is not None and time_unit not in TIME_UNITS:
        raise unknown_name("unit of time", time_unit, TIME_UNITS)
    if unit is not None and unit not in UNITS:
        raise unknown_name("unit", unit, UNITS)
    if not math.isfinite(tare):
        raise InputError(f"--tare {tare:g}; accepted: a finite number")
    table = open_table(path)
    when = _column(table.columns, time_column, _TIMES, "time", path)
    what = _column(table.columns, column, (*_THRUSTS, *_SPEEDS), "thrust or speed", path)
    if when == what:
        raise InputError(f"'{when}' for time and value both; accepted: two columns")
    numbers, damage = table.numbers({when, what})
    seconds = TIME_UNITS[_unit("--time-unit", when, time_unit, _SPELLED_TIMES) or "s"]
    unit = _value_unit(what, unit)
    return RotorTrace(numbers[when] * seconds, numbers[what] - tare, unit, what, damage)


def _column(
    columns: tuple[str, ...], name: str | None, usual: tuple[str, ...], what: str, path: Path
) -> str:
    if name is not None:
        if name not in columns:
            raise unknown_name(f"column in '{path}'", name, columns)
        return name
    for word in usual:
        named = [c for c in columns if c.lower() == word or c.lower().startswith(f"{word}_")
                 or c.lower().startswith((f"{word} ", f"{word}["))]  # fmt: skip
        if len(named) == 1:
            return named[0]
    option = "--time-column" if what == "time" else "--column"
    raise InputError(
        f"'{path}' has no one column of {what}; accepted: {option} with one of "
        f"{', '.join(columns)}"
    )


def _unit(option: str, column: str, given: str | None, spelled: Mapping[str, str]) -> str | None:
    """Return the unit of a column: as its name has it, or as given; None: neither says one.

    Raises:
        InputError: the name says another unit than the given one.
    """
    named = _named(column, spelled)
    if None not in (named, given) and given != named:
        raise InputError(
            f"{option} {given} for a column '{column}', whose name says {named}; accepted: "
            f"{named}, or another name"
        )
    return given or named


def _value_unit(column: str, given: str | None) -> str:
    """Return the unit of thrust or speed, by default the SI unit of the kind in the name."""
    unit = _unit("--unit", column, given, _SPELLED)
    begins = column.lower().startswith
    kind = THRUST if begins(_THRUSTS) else SPEED if begins(_SPEEDS) else None
    if unit is None:
        return "rad/s" if kind == SPEED else "N"
    if kind not in (None, UNITS[unit]):
        units = ", ".join(u for u in UNITS if UNITS[u] == kind)
        raise InputError(
            f"--unit {unit} for a column '{column}', whose name says {kind}; accepted: {units}"
        )
    return unit


def _named(column: str, spelled: Mapping[str, str]) -> str | None:
    """Return the unit that a column's name ends in, as in thrust_N, thrust [N] or motorRPM."""
    lower = column.lower().replace("rad_s", "rad/s").strip()
    words = [word for word in re.split(r"[^a-zµ/]+", lower) if word]
    for word in words[:0:-1]:
        if word in spelled:
            return spelled[word]
    ends = [unit for unit in spelled if len(unit) > 1 and lower.endswith(unit)]
    return spelled[max(ends, key=len)] if ends and spelled is _SPELLED else None
