"""From the tables of a diagnosis to its operating points, with the nominal model's rows."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tombo_bag.flight import Finding
from tombo_diagnosis.stand.tables.operating_points import OperatingPoints
from tombo_diagnosis.stand.tables.plateaus import LOADS, SIGMAS, plateaus
from tombo_diagnosis.stand.tables.table_reader import StandTable
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM, configuration, parameter_row, valid_speed
from tombo_dynamics.propeller.effects import Setup, predict

_MIN_POINTS = 3
"""Points that are worth a diagnosis."""
_MAX_THRUST_RATIO = 3.0
"""Times the model's thrust, or its inverse, that no propeller of the paper shows."""


def assemble(
    tables: Sequence[StandTable], conf: int, law: str, plain: bool = False
) -> tuple[OperatingPoints, tuple[Finding, ...]]:
    """Return the operating points of runs, and the findings of their tables.

    Args:
        tables: as recorded.
        conf: configuration of tables that do not say theirs.
        law: of the Tombo propellers.
        plain: hold them against T = k omega^2 instead, whatever the mapping says.

    Raises:
        InputError: unknown configuration or law, runs of two models, a run given twice, an
            implausible scale, or fewer than three points where the law is valid.
    """
    plains = {plain or t.mapping.model == "plain" for t in tables}
    if len(plains) > 1:
        raise InputError("runs of plain and of Tombo propellers; accepted: one kind at a time")
    plain = plains.pop()
    _refuse_twice(tables)
    parts = [plateaus(t) for t in tables]
    described = [_described(t, p, conf, plain) for t, (p, _) in zip(tables, parts, strict=True)]
    findings = [f for t in tables for f in t.findings] + [f for _, found in parts for f in found]
    every = pd.concat(described, ignore_index=True)
    readings = np.array(every[list(LOADS)], order="C")
    run, runs = pd.factorize(every.run)
    propeller, propellers = pd.factorize(every.propeller)
    speed = every.speed.to_numpy()
    if plain:
        readings[:, 2] = np.nan
        rows = _constants(speed, readings, propeller)
    else:
        row_of = {c: parameter_row(configuration(c), law) for c in every.conf.unique().tolist()}
        rows = np.stack([row_of[c] for c in every.conf])
        for table, each in zip(tables, described, strict=True):
            findings += _above_valid_speed(table.name, each, law)
    setup = Setup(
        speed=speed,
        rows=rows,
        propeller=propeller.astype(np.int64),
        run=run.astype(np.int64),
        elapsed=every.elapsed.to_numpy(),
        law=law,
        plain=plain,
        applied_thrust=every.applied_thrust.to_numpy(),
        applied_torque=every.applied_torque.to_numpy(),
        largest_thrust=_largest(readings[:, 0], 1.0),
        largest_torque=_largest(readings[:, 1], 0.03),
    )
    sigma = np.array(every[list(SIGMAS)], order="C")
    points = OperatingPoints(setup, readings, sigma, tuple(runs), tuple(propellers))
    if not plain:
        _check_scale(points, tables, np.repeat(np.arange(len(parts)), [len(d) for d in described]))
        _check_enough(points, tables)
    return points, tuple(findings)


def _described(table: StandTable, points: pd.DataFrame, conf: int, plain: bool) -> pd.DataFrame:
    """Return the points of a table with their configuration, names and known loads.

    Raises:
        InputError: a configuration is not a whole number, or not known.
    """
    recorded = pd.DataFrame(dict(table.channels)).iloc[points.row].reset_index(drop=True)
    points["conf"] = (
        _configurations(recorded.conf.to_numpy(), table, plain) if "conf" in recorded else conf
    )
    by_conf = points.conf.map("Conf. {}".format)
    points["run"] = table.name
    if "run" in recorded:
        points["run"] += recorded.run.map(", run {:g}".format)
    elif "conf" in recorded:
        points["run"] += ", " + by_conf
    points["propeller"] = table.name if plain else by_conf
    if "propeller" in recorded:
        points["propeller"] += recorded.propeller.map(", {:g}".format)
    for load in ("applied_thrust", "applied_torque"):
        points[load] = recorded[load].fillna(0.0) if load in recorded else 0.0
    return points


def _refuse_twice(tables: Sequence[StandTable]) -> None:
    for k, table in enumerate(tables):
        for other in tables[:k]:
            if pd.DataFrame(dict(table.channels)).equals(pd.DataFrame(dict(other.channels))):
                raise InputError(
                    f"{table.source} holds the same numbers as {other.source}: counted twice they "
                    "look surer than they are; accepted: each run once"
                )


def _check_enough(points: OperatingPoints, tables: Sequence[StandTable]) -> None:
    valid = np.isfinite(points.readings) & np.isfinite(predict(points.setup, {}))
    left = int(valid.any(axis=1).sum())
    if left < _MIN_POINTS:
        names = ", ".join(t.name for t in tables[:3])
        raise InputError(
            f"{names}: {left} of {points.count} points lie where law {points.setup.law} is valid; "
            f"accepted: {_MIN_POINTS} or more: is the speed's unit right?"
        )


def _configurations(values: Array, table: StandTable, plain: bool) -> NDArray[np.int64]:
    """Return a table's column of configurations, checked; of plain propellers whole numbers."""
    where = f"{table.source}: column '{table.mapping.channels['conf'].columns[0]}'"
    wrong = values[~np.isfinite(values) | (values != np.round(values))]
    if wrong.size:
        raise InputError(
            f"{where} has {wrong[0]:g}; accepted: whole numbers, a configuration each"
        )
    numbers = values.astype(np.int64)
    for c in np.unique(numbers) if not plain else ():
        try:
            configuration(int(c))
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
    return numbers


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


def _above_valid_speed(name: str, points: pd.DataFrame, law: str) -> list[Finding]:
    findings = []
    for c, speed in points.groupby("conf").speed:
        limit = valid_speed(configuration(int(c)), law)
        over = int((speed > limit).sum())
        if over:
            text = (
                f"{over} points of Conf. {c} above {limit / RPM:.0f} rpm, where law {law} ends: "
                "set apart"
            )
            findings.append(Finding("speed", "fault", name, text, channel="speed"))
    return findings


def _check_scale(
    points: OperatingPoints, tables: Sequence[StandTable], number: NDArray[np.intp]
) -> None:
    """Refuse a thrust that is nowhere near the model's; `number` (N,) is each point's table.

    Raises:
        InputError: a table's thrust and its rise are three times the model's or a third of it.
    """
    model, y = predict(points.setup, {})[:, 0], points.readings[:, 0]
    for k, table in enumerate(tables):
        known = np.isfinite(y) & np.isfinite(model) & (number == k)
        x = model[known]
        if not x.any():
            continue
        fast = x > 0.25 * x.max()
        ratios = [float(np.median(y[known][fast] / x[fast]))]
        if x.size >= _MIN_POINTS and np.ptp(x) > 0.5 * np.abs(x).max():  # the zero may be off
            ratios.append(float(np.polyfit(x, y[known], 1)[0]))
        if not any(1.0 / _MAX_THRUST_RATIO < times < _MAX_THRUST_RATIO for times in ratios):
            where = table.mapping.channels["thrust"]
            raise InputError(
                f"{table.source}: column '{where.columns[0]}' as {where.unit} is {ratios[0]:.3g} "
                f"times the model's thrust; accepted: {1.0 / _MAX_THRUST_RATIO:.2g} to "
                f"{_MAX_THRUST_RATIO:g} times: are the units of thrust and speed right, and the "
                "number of rotors on the cell (`rotors` in --mapping)? Another propeller: --plain"
            )
