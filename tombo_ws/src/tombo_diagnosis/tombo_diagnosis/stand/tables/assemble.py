"""From the tables of a diagnosis to its operating points, with the nominal model's rows."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight import Finding
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.stand.tables.plateaus import Plateaus, plateaus
from tombo_diagnosis.stand.tables.table_reader import StandTable
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import (
    RPM,
    Configuration,
    configuration,
    nodus_moduli,
    parameter_row,
    valid_speed,
)
from tombo_dynamics.propeller.effects import Setup, predict
from tombo_dynamics.vehicle import GRAVITY

_FEWEST = 3
"""Points that are worth a diagnosis."""


@dataclass(frozen=True, eq=False)
class StandData:
    """What is diagnosed."""

    points: OperatingPoints
    runs: tuple[Plateaus, ...]
    findings: tuple[Finding, ...]


def assemble(tables: Sequence[StandTable], conf: int, law: str, plain: bool = False) -> StandData:
    """Join runs.

    Args:
        tables: as recorded.
        conf: configuration of tables that do not say theirs.
        law: of the Tombo propellers.
        plain: hold them against T = k omega^2 instead, whatever the mapping says.

    Raises:
        InputError: unknown configuration or law, models that do not go together, a run given
            twice, an implausible scale, or fewer than three points where the law is valid.
    """
    plains = {plain or t.mapping.model == "plain" for t in tables}
    if len(plains) > 1:
        raise InputError("runs of plain and of Tombo propellers; accepted: one kind at a time")
    plain = plains.pop()
    _refuse_twice(tables)
    parts = [plateaus(t) for t in tables]
    findings = [f for t in tables for f in t.findings] + [f for p in parts for f in p.findings]
    runs: list[str] = []
    propellers: list[str] = []
    rows: list[Array] = []
    moduli: dict[str, float] = {}
    prop: list[Array] = []
    run: list[Array] = []
    loads: dict[str, list[Array]] = {"applied_thrust": [], "applied_torque": []}
    for table, part in zip(tables, parts, strict=True):
        n = part.speed.size
        first = part.first_row.astype(int)
        own_run = table.channels.get("run")
        own_conf = table.channels.get("conf")
        own_prop = table.channels.get("propeller")
        numbers = np.full(n, conf) if own_conf is None else _whole_numbers(own_conf[first], table)
        names = [
            table.name if own_run is None else f"{table.name}, run {own_run[k]:g}" for k in first
        ]
        if own_conf is not None and own_run is None:
            names = [f"{table.name}, Conf. {c}" for c in numbers]
        wings = [
            (f"Conf. {c}" if not plain else table.name)
            + ("" if own_prop is None else f", {own_prop[k]:g}")
            for c, k in zip(numbers, first, strict=True)
        ]
        runs += [x for x in dict.fromkeys(names) if x not in runs]
        propellers += [x for x in dict.fromkeys(wings) if x not in propellers]
        run.append(np.array([runs.index(x) for x in names]))
        prop.append(np.array([propellers.index(x) for x in wings]))
        for name, load in loads.items():
            load.append(np.nan_to_num(table.channels.get(name, np.zeros(table.rows))[first]))
        if own_conf is not None and not plain:
            _check_configurations(numbers, table)
        for c, wing in zip(numbers, wings, strict=True):
            moduli.setdefault(wing, math.nan if plain else stiffness(configuration(int(c))))
        if not plain:
            rows.append(np.stack([parameter_row(configuration(int(c)), law) for c in numbers]))
            findings += _above_valid_speed(table.name, part.speed, numbers, law)
    speed = np.concatenate([p.speed for p in parts])
    readings = np.concatenate([p.readings for p in parts])
    if plain:
        readings[:, 2] = np.nan
    number = np.concatenate(prop).astype(np.int64)
    setup = Setup(
        speed=speed,
        rows=np.concatenate(rows) if rows else _constants(speed, readings, number),
        propeller=number,
        run=np.concatenate(run).astype(np.int64),
        elapsed=np.concatenate([p.elapsed for p in parts]),
        law=law,
        plain=plain,
        applied_thrust=np.concatenate(loads["applied_thrust"]),
        applied_torque=np.concatenate(loads["applied_torque"]),
        largest_thrust=_largest(readings[:, 0], 1.0),
        largest_torque=_largest(readings[:, 1], 0.03),
    )
    points = OperatingPoints(
        setup, readings, np.concatenate([p.sigma for p in parts]), tuple(runs), tuple(propellers),
        np.array([moduli[p] for p in propellers]),
    )  # fmt: skip
    if not plain:
        check_scale(points, tables, [p.speed.size for p in parts])
        _check_enough(points, tables)
    return StandData(points, tuple(parts), tuple(findings))


def _refuse_twice(tables: Sequence[StandTable]) -> None:
    for k, table in enumerate(tables):
        for other in tables[:k]:
            if table.channels.keys() == other.channels.keys() and all(
                np.array_equal(v, other.channels[c], equal_nan=True)
                for c, v in table.channels.items()
            ):
                raise InputError(
                    f"{table.source} holds the same numbers as {other.source}: counted twice they "
                    "look surer than they are; accepted: each run once"
                )


def _check_enough(points: OperatingPoints, tables: Sequence[StandTable]) -> None:
    """Refuse what leaves fewer than three points.

    Raises:
        InputError: so few lie where the law is valid.
    """
    valid = np.isfinite(points.readings) & np.isfinite(predict(points.setup, {}))
    left = int(valid.any(axis=1).sum())
    if left < _FEWEST:
        speed = points.setup.speed / RPM
        span = f"{speed.min():.0f} to {speed.max():.0f} rpm"
        names = ", ".join(t.name for t in tables[:3])
        raise InputError(
            f"{names}: {left} of {points.count} points ({span}) lie where "
            f"law {points.setup.law} is valid; accepted: {_FEWEST} or more: is the speed's unit "
            "right?"
        )


def _whole_numbers(values: Array, table: StandTable) -> NDArray[np.int64]:
    wrong = values[~np.isfinite(values) | (values != np.round(values))]
    if wrong.size:
        column = table.mapping.channels["conf"].columns[0]
        raise InputError(
            f"{table.source}: column '{column}' has {wrong[0]:g}; accepted: whole numbers, a "
            "configuration each"
        )
    return values.astype(np.int64)


def _check_configurations(numbers: NDArray[np.int64], table: StandTable) -> None:
    for c in np.unique(numbers):
        try:
            configuration(int(c))
        except InputError as error:
            column = table.mapping.channels["conf"].columns[0]
            raise InputError(f"{table.source}: column '{column}': {error}") from error


def stiffness(conf: Configuration) -> float:
    """Return the shear modulus of a configuration's nodus [MPa]; NaN: rigid."""
    return math.nan if conf.rigid else nodus_moduli(conf).G_N_MPa


def _largest(values: Array, default: float) -> float:
    known = np.abs(values[np.isfinite(values)])
    return float(known.max()) if known.size and known.max() > 0.0 else default


def _constants(speed: Array, readings: Array, number: NDArray[np.int64]) -> Array:
    """Return rows (N, 2) of each propeller's k_T and k_Q, least squares through the origin."""
    rows = np.zeros((speed.size, 2))
    for p in np.unique(number):
        for c in (0, 1):
            known = np.isfinite(readings[:, c]) & (number == p)
            square = speed[known] ** 2
            if known.any() and square.any():
                k = float(square @ readings[known, c]) / float(square @ square)
                if not k > 0.0:
                    raise InputError(
                        f"{('thrust', 'torque')[c]} does not rise with speed: {k:.3g} omega^2; "
                        "accepted: runs that reach speeds at which it stands out of the noise"
                    )
                rows[number == p, c] = k
    return rows


def _above_valid_speed(
    name: str, speed: Array, numbers: NDArray[np.int64], law: str
) -> list[Finding]:
    findings = []
    for c in np.unique(numbers):
        limit = valid_speed(configuration(int(c)), law)
        over = int(np.count_nonzero(speed[numbers == c] > limit))
        if over:
            text = (
                f"{over} points of Conf. {c} above {limit / RPM:.0f} rpm, where law {law} ends: "
                "set apart"
            )
            findings.append(Finding("speed", "fault", name, text, channel="speed"))
    return findings


_RATIO = 3.0
"""Times the model's thrust, or its inverse, that no propeller of the paper shows."""
_NEAR = 1.6
_TIMES = {
    "grams read as newtons": 1e3 / GRAVITY,
    "rad/s read as rpm": RPM**-2,
    "rpm read as rad/s": RPM**2,
    "Hz read as rpm": 3600.0,
    "millinewtons read as newtons": 1e3,
    "kilograms read as newtons": 1.0 / GRAVITY,
    "four rotors on one cell (`rotors: 4` in --mapping)": 4.0,
}
"""Mistake of units -> factor by which thrust at equal speed is then too large."""


def check_scale(
    points: OperatingPoints, tables: Sequence[StandTable], sizes: Sequence[int]
) -> None:
    """Refuse a thrust that is nowhere near the model's.

    `points` are those of all tables, one after the other; `sizes` are how many points each has.

    Raises:
        InputError: a table's thrust is three times the model's or a third of it; names column,
            factor and the slips that would do it.
    """
    model = predict(points.setup, {})[:, 0]
    ends = np.cumsum([0, *sizes])
    for table, low, high in zip(tables, ends[:-1], ends[1:], strict=True):
        speed, y = points.setup.speed[low:high], points.readings[low:high, 0]
        fast = np.isfinite(y) & np.isfinite(model[low:high]) & (speed > 0.0)
        fast &= speed > 0.5 * float(speed[fast].max(initial=0.0))
        if not fast.any():
            continue
        times = float(np.median(y[fast] / model[low:high][fast]))
        if any(1.0 / _RATIO < t < _RATIO for t in (times, _rise(y, model[low:high], times))):
            continue
        slips = [
            name
            for name, size in _TIMES.items()
            if times > 0.0 and abs(math.log(times / size)) < math.log(_NEAR)
        ]
        guess = f"as with {' or '.join(slips)}" if slips else "another propeller? (--plain)"
        where = table.mapping.channels["thrust"]
        raise InputError(
            f"{table.source}: column '{where.columns[0]}' as {where.unit} is {times:.3g} times "
            f"the model's thrust, {guess}; accepted: {1.0 / _RATIO:.2g} to {_RATIO:g} times"
        )


def _rise(y: Array, model: Array, times: float) -> float:
    """Return how many times the model's rise with speed a thrust y has; the zero may be off.

    Both are (N,) [N]; `times` is returned where thrust hardly changes.
    """
    known = np.isfinite(y) & np.isfinite(model)
    x = model[known]
    if x.size < 3 or np.ptp(x) < 0.5 * float(np.abs(x).max()):
        return times
    return float(np.polyfit(x, y[known], 1)[0])
