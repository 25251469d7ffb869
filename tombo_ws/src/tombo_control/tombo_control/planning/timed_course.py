"""A course of a file: position and heading over time, as polynomials piece by piece.

Two tables are read. One has samples: `t, x, y, z`, and `vx .. vz`, `ax .. az`, `yaw` where they
are known; between samples are the polynomials of 5th degree that have these values at both ends.
The other has the polynomials themselves, of 7th degree, as crazyswarm2 uploads them.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Sequence
from functools import lru_cache
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.polynomial import polynomial
from scipy.interpolate import CubicSpline

from tombo_control.planning.leg import Leg, Point
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.jit import compiled
from tombo_dynamics.yaml_text import read_text

DEGREE = 7
"""Of a polynomial."""
_TERMS = DEGREE + 1
PIECE_COLUMNS = 2 + 4 * _TERMS
"""Begin and end [s], then the coefficients of x, y, z and yaw, from power 0 on, in the time since
the begin."""
MOST_ROWS = 10_000
"""Rows of a table, at most: 200 s of samples at 50 Hz."""
_POSITION, _VELOCITY = ("x", "y", "z"), ("vx", "vy", "vz")
_ACCELERATION = ("ax", "ay", "az")
_UNITS = {
    "t": "s",
    **dict.fromkeys(_POSITION, "m"),
    **dict.fromkeys(_VELOCITY, "m/s"),
    **dict.fromkeys(_ACCELERATION, "m/s^2"),
    "yaw": "rad",
}
_POLYNOMIALS = (
    "duration",
    *(f"{axis}^{power}" for axis, power in product((*_POSITION, "yaw"), range(_TERMS))),
)
_ACCEPTED = (
    f"a CSV with the columns t [s], x [m], y [m], z [m], and vx [m/s] .. az [m/s^2], yaw [rad], "
    f"or duration, x^0 .. yaw^{DEGREE}, of 1 to {MOST_ROWS} rows"
)
_HEADER_CELL = re.compile(r"([\w^]+)\s*(?:\[([^\]]*)\])?")
_NEXT_STEP_S = 0.02
"""The reference moves on as it is for so long, a period of the mission."""


class CourseReference(NamedTuple):
    """A place of a timed course (map, SI)."""

    position: Point
    velocity: Point
    acceleration: Point
    yaw: float


class TimedCourse(NamedTuple):
    """A table as it was read."""

    pieces: Array
    """(N, 34), see `PIECE_COLUMNS`."""
    rows: tuple[int, ...]
    """The line of the file in which each piece begins, from 1."""
    relative: bool
    """It begins wherever the vehicle hovers, as crazyswarm2 flies it by default."""


def timed_course_text(name: str, given: str) -> str:
    """Return the text of a course's table, checked.

    Args:
        name: what to call it in an error, as mission.course.
        given: the path of a file, or the text, which has several lines.

    Raises:
        InputError: the file can't be read, or is no such table.
    """
    if "\n" not in given.strip():
        given = read_text(Path(given), f"{name}: '{given}'", _ACCEPTED)
    try:
        read_timed_course(given)
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
    return given


@lru_cache(maxsize=8)
def read_timed_course(text: str) -> TimedCourse:
    """Return the course in the text of a table, either kind (map, SI).

    Empty lines, lines that begin with `#`, and commas at the end of a line are skipped. The last
    courses are remembered, since check and plan read the same text.

    Raises:
        InputError: the text is not such a table; names the row or the column.
    """
    lines = [line.rstrip().rstrip(",") for line in text.removeprefix("\ufeff").splitlines()]
    filled = [i for i, line in enumerate(lines, 1) if line and not line.startswith("#")]
    if not 2 <= len(filled) <= MOST_ROWS + 1:
        raise InputError(f"{max(len(filled) - 1, 0)} rows; accepted: {_ACCEPTED}")
    head, *rows = csv.reader(lines[i - 1] for i in filled)
    names = _column_names(head)
    line_numbers = tuple(filled[1:])
    table = np.array(
        [_numbers(i, row, len(names)) for i, row in zip(line_numbers, rows, strict=True)]
    )
    if names == _POLYNOMIALS:
        return TimedCourse(_with_times(table, line_numbers), line_numbers, relative=True)
    columns = dict(zip(names, table.T, strict=True))
    return TimedCourse(_between(columns, line_numbers), line_numbers, relative=False)


def _column_names(head: Sequence[str]) -> tuple[str, ...]:
    """Return the names in a header, whose units are those of `_UNITS` where they stand there."""
    names = []
    for cell in head:
        found = _HEADER_CELL.fullmatch(cell.strip())
        name = found[1].lower() if found else cell
        unit = found[2] if found else None
        if name not in (*_UNITS, *_POLYNOMIALS) or name in names:
            raise InputError(f"column '{cell:.40}'; accepted: {_ACCEPTED}")
        if unit is not None and unit.strip() != _UNITS.get(name, ""):
            raise InputError(f"column '{cell:.40}'; accepted: {name} [{_UNITS.get(name, '')}]")
        names.append(name)
    whole = all(
        set(group) <= set(names) or not set(group) & set(names)
        for group in (_VELOCITY, _ACCELERATION)
    )
    samples = {"t", *_POSITION} <= set(names) <= set(_UNITS)
    if tuple(names) != _POLYNOMIALS and not (samples and whole):
        raise InputError(f"columns {', '.join(names)}; accepted: {_ACCEPTED}")
    return tuple(names)


def _numbers(row: int, cells: Sequence[str], count: int) -> list[float]:
    """Return the `count` numbers in line `row` of the file; refuse others."""
    try:
        numbers = [float(cell) for cell in cells]
    except ValueError:
        numbers = []
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"row {row}: {','.join(cells):.60}; accepted: {count} numbers")
    return numbers


def _with_times(table: Array, rows: Sequence[int]) -> Array:
    """Return pieces (N, 34) of a table (N, 33): duration [s], then coefficients.

    `rows`: the line of the file of each, for errors.
    """
    short = np.flatnonzero(table[:, 0] <= 0.0)
    if short.size:
        row, lasts = rows[short[0]], table[short[0], 0]
        raise InputError(f"row {row}: duration {lasts:g} s; accepted: above 0")
    ends = np.cumsum(table[:, 0])
    return np.column_stack([ends - table[:, 0], ends, table[:, 1:]])


def _between(columns: dict[str, Array], rows: Sequence[int]) -> Array:
    """Return the pieces (N - 1, 34) between N samples.

    Derivatives that the table lacks are those of cubic splines through the samples.

    Args:
        columns: name → (N,), with the units of `_UNITS`.
        rows: the line of the file of each sample, for errors.
    """
    t = columns["t"]
    late = np.flatnonzero(np.diff(t) <= 0.0) + 1
    if late.size:
        raise InputError(
            f"row {rows[late[0]]}: t {t[late[0]]:g} s after {t[late[0] - 1]:g} s; accepted: "
            "times that rise"
        )
    if t.size < 2:
        raise InputError("1 row; accepted: at least 2 samples")
    position = np.column_stack([columns[name] for name in _POSITION])
    velocity, acceleration = (
        np.column_stack([columns[name] for name in group]) if group[0] in columns else None
        for group in (_VELOCITY, _ACCELERATION)
    )
    yaw = np.unwrap(columns.get("yaw", np.zeros(t.size)))
    heading = CubicSpline(t, yaw)
    if velocity is None:
        velocity = CubicSpline(t, position)(t, 1)
    if acceleration is None:
        acceleration = CubicSpline(t, velocity)(t, 1)
    p = np.column_stack([position, yaw])
    v = np.column_stack([velocity, heading(t, 1)])
    a = np.column_stack([acceleration, heading(t, 2)])
    T = np.diff(t)[:, None]
    # the three coefficients that are left, of p(T), v(T), a(T): with tau = t / T in [0, 1]
    dp = p[1:] - p[:-1] - v[:-1] * T - 0.5 * a[:-1] * T**2
    dv = (v[1:] - v[:-1] - a[:-1] * T) * T
    da = (a[1:] - a[:-1]) * T**2
    powers = [
        p[:-1],
        v[:-1],
        0.5 * a[:-1],
        (10.0 * dp - 4.0 * dv + 0.5 * da) / T**3,
        (-15.0 * dp + 7.0 * dv - da) / T**4,
        (6.0 * dp - 3.0 * dv + 0.5 * da) / T**5,
        *np.zeros((2, *p[:-1].shape)),
    ]
    coefficients = np.stack(powers, axis=2).reshape(t.size - 1, -1)
    return np.column_stack([t[:-1] - t[0], t[1:] - t[0], coefficients])


def course_pieces(text: str, height: float) -> Array:
    """Return the pieces (N, 34) of a table that was checked, in map.

    Args:
        text: the table.
        height: of the hover [m]; a relative course begins at (0, 0, height).
    """
    course = read_timed_course(text)
    pieces = course.pieces.copy()
    if course.relative:
        begin = pieces[0, 2 : 2 + 3 * _TERMS : _TERMS].copy()
        for axis, offset in enumerate((0.0, 0.0, height) - begin):
            pieces[:, 2 + axis * _TERMS] += offset
    return pieces


def sampled_course(pieces: Array, step_s: float) -> tuple[Array, Array, Array, Array, Array]:
    """Return piece (N,), times (N,) [s], position, velocity and acceleration (N, 4).

    Samples are `step_s` apart at most, and at both ends of each piece; the fourth column is yaw.
    """
    index, times, values = [], [], []
    for k, (begin, end, *rest) in enumerate(pieces):
        since = np.linspace(0.0, end - begin, 1 + int(np.ceil((end - begin) / step_s)))
        c = np.reshape(rest, (4, _TERMS)).T
        derivatives = [polynomial.polyval(since, polynomial.polyder(c, m)) for m in range(3)]
        index.append(np.full(since.size, k))
        times.append(begin + since)
        values.append(np.stack(derivatives).transpose(0, 2, 1))
    position, velocity, acceleration = np.concatenate(values, axis=1)
    return np.concatenate(index), np.concatenate(times), position, velocity, acceleration


@compiled(inline=False)
def piece_reference(pieces: Array, row: int, time_s: float) -> CourseReference:
    """Return the reference of a piece, `time_s` after the course's begin."""
    since = time_s - pieces[row, 0]
    p, v, a = np.zeros(4), np.zeros(4), np.zeros(4)
    for axis in range(4):
        first = 2 + axis * _TERMS
        for k in range(DEGREE, -1, -1):  # Horner's rule, of the two derivatives as well
            a[axis] = a[axis] * since + 2.0 * v[axis]
            v[axis] = v[axis] * since + p[axis]
            p[axis] = p[axis] * since + pieces[row, first + k]
    return CourseReference((p[0], p[1], p[2]), (v[0], v[1], v[2]), (a[0], a[1], a[2]), p[3])


@compiled(inline=False)
def moving_leg(reference: CourseReference, now_s: float) -> Leg:
    """Return the leg that moves as a reference does now, until the mission's next step."""
    return Leg(
        reference.position,
        reference.velocity,
        now_s,
        now_s + _NEXT_STEP_S,
        0.0,
        reference.yaw,
        0.0,
        0.0,
        0.0,
        0.0,
        reference.acceleration,
    )
