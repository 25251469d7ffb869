"""Read a trace of a rotor, thrust or speed over time, from a table."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from pathlib import Path

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_logs.readers.csv_table import open_table

_TIMES = ("time", "t", "timestamp", "stamp", "seconds")
_THRUSTS, _SPEEDS = ("thrust", "force", "fz"), ("rpm", "speed", "omega")
"""First words of columns' names, in the order in which they are looked for."""
_TIME_UNIT = re.compile(r"[_ \[(](ms|us|µs)[\])]?$")
"""End of a name as time_ms or time [ms]; without it times are seconds."""
_SECONDS = {"ms": 1e-3, "us": 1e-6, "µs": 1e-6}


@dataclass(frozen=True)
class RotorTrace:
    """Thrust or speed of a rotor over time, N samples as the file has them."""

    time: Array
    """(N,) [s]"""
    value: Array
    """(N,) the column minus the tare, in the column's own unit."""
    column: str
    """Name of the column."""
    is_speed: bool
    """Whether it is a speed; thrust goes with its square."""
    notes: tuple[str, ...]
    """Damage of the file, a line each."""


def read_trace(
    path: Path, column: str | None = None, time_column: str | None = None, tare: float = 0.0
) -> RotorTrace:
    """Read a trace; columns that are not named are found by their names.

    Args:
        path: CSV, plain or gzip.
        column: of thrust or speed; it is a speed if its name says rpm, speed or omega.
        time_column: of time, in seconds, or in the unit that ends its name, as in time_ms.
        tare: reading of the unloaded cell, in the column's unit.

    Raises:
        InputError: no such file or column, no or several columns that fit, or a tare of NaN.
    """
    if not math.isfinite(tare):
        raise InputError(f"--tare {tare:g}; accepted: a finite number")
    table = open_table(path)
    times = _column(table.columns, time_column, _TIMES, "time", path)
    values = _column(table.columns, column, (*_THRUSTS, *_SPEEDS), "thrust or speed", path)
    if times == values:
        raise InputError(f"'{times}' for time and value both; accepted: two columns")
    numbers, damage = table.numbers({times, values})
    unit = _TIME_UNIT.search(times.lower())
    seconds = numbers[times] * (_SECONDS[unit[1]] if unit else 1.0)
    is_speed = any(word in values.lower() for word in _SPEEDS)
    return RotorTrace(seconds, numbers[values] - tare, values, is_speed, damage)


def _column(
    columns: tuple[str, ...], name: str | None, usual: tuple[str, ...], what: str, path: Path
) -> str:
    """Return the name of a column: the given one, or the one that begins with a usual word.

    `what`: the quantity, for errors.
    """
    if name is not None:
        if name not in columns:
            raise unknown_name(f"column in '{path}'", name, columns)
        return name
    for word in usual:
        named = [c for c in columns if re.match(rf"{word}($|[_ \[(])", c.lower())]
        if len(named) == 1:
            return named[0]
    option = "--time-column" if what == "time" else "--column"
    raise InputError(
        f"'{path}' has no one column of {what}; accepted: {option} with one of "
        f"{', '.join(columns)}"
    )
