"""A flight from a table (CSV, CSV.gz) and a mapping."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.channels import ALL_CHANNELS
from tombo_bag.columns import stacked_columns
from tombo_bag.flight import Finding, Flight, Series, damage_findings
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_logs.readers.csv_mapping import (
    ATTITUDES,
    ChannelMap,
    LogMapping,
    TimeColumn,
    parse_mapping,
    shipped,
)
from tombo_logs.readers.csv_table import CsvTable, open_table
from tombo_logs.readers.frames import axes_matrix, turn_attitude
from tombo_logs.readers.units import factor

_POSE = ("position", "attitude")
_INERTIAL = ("gyro", "accel", "motor_command")
"""Without poses these say how a vehicle answers its motors."""
_IN_WORLD = (
    *("position", "acceleration", "estimated_position", "estimated_velocity"),
    *("position_setpoint", "velocity_setpoint", "acceleration_setpoint"),
)
_IN_BODY = ("gyro", "accel", "estimated_body_velocity", "rates_setpoint", "torque_setpoint")


def read_csv(path: Path, name: str, mapping: LogMapping | None = None) -> Flight:
    """Read a table, CSV or CSV.gz with a header; without a mapping, by the shipped one that fits.

    Raises:
        InputError: no table, no mapping fits, or columns of position or attitude that it names
            are missing.
    """
    table = open_table(path)
    mapping = mapping or _recognised(table)
    if not any(set(kind) <= set(mapping.channels) for kind in (_POSE[:1], _INERTIAL)):
        raise InputError(
            f"mapping '{mapping.name}' has no channel position; needed: position of the motion "
            "capture, and its attitude for all but --healthy; for `tombo vehicle from-flights` "
            f"{', '.join(_INERTIAL)} will do"
        )
    there = set(table.columns)
    findings = damage_findings(name, path, table.damage)
    findings += [Finding("table", "info", name, f"{path.name}: {text}") for text in table.remarks]
    spelled = {name.lower(): name for name in there}  # versions of a firmware differ in case
    channels = {}
    for key, channel in mapping.channels.items():
        names = [c if c in there else spelled.get(c.lower(), c) for c in channel.columns]
        channel = replace(channel, columns=tuple(names))
        lacking = [c for c in _columns(channel, mapping, there) if c not in there]
        if lacking and key in _POSE:
            raise unknown_name(
                f"column for {key} (mapping '{mapping.name}') in '{path}'", lacking[0], there
            )
        if not lacking:
            channels[key] = channel
        elif any(c in there for c in channel.columns):
            text = f"{key}: columns {', '.join(lacking)} are not in the table: left out"
            findings.append(Finding("missing", "fault", name, text, channel=key))
    wanted = {c for channel in channels.values() for c in _columns(channel, mapping, there)}
    columns, damage = table.numbers(wanted)
    findings += damage_findings(name, path, damage)
    if mapping.time is not None and mapping.time.rate:
        columns[mapping.time.column] = (
            np.arange(len(next(iter(columns.values())))) / mapping.time.rate
        )
    zero = _zero(columns, channels, mapping)
    series = {key: _series(key, c, columns, mapping, zero) for key, c in channels.items()}
    return Flight.measured(
        name=name,
        source=f"{path} (table, mapping '{mapping.name}')",
        series={key: s for key, s in series.items() if s.t.size},
        airframe=mapping.airframe,
        findings=tuple(findings),
        epoch_ns=round(zero * 1e9),
    )


def fitting_mappings(table: CsvTable) -> list[LogMapping]:
    """Return the shipped mappings whose columns a table has."""
    there = set(table.columns)
    return [
        mapping
        for mapping in shipped().values()
        if all(
            set(_columns(mapping.channels[key], mapping, there)) <= there
            for key in (_POSE if "position" in mapping.channels else _INERTIAL)
        )
    ]


def _recognised(table: CsvTable) -> LogMapping:
    if table.mapping:
        return parse_mapping(table.mapping, "export")
    fitting = fitting_mappings(table)
    if len(fitting) == 1:
        return fitting[0]
    names = ", ".join(table.columns[:60]) + (" …" if len(table.columns) > 60 else "")
    raise InputError(
        f"'{table.path}': no mapping given, and none of those shipped ({', '.join(shipped())}) "
        f"fits its columns ({names}); write one as in docs/logs.md and give it with --mapping"
    )


def _columns(channel: ChannelMap, mapping: LogMapping, there: Collection[str]) -> tuple[str, ...]:
    """Return the present columns that a channel needs; a minus is a sign."""
    times = (channel.time or mapping.time, channel.arrival)
    names = (*channel.columns, *(t.column for t in times if t is not None and t.column))
    return tuple(n if n in there or not n.startswith("-") else n[1:] for n in names)


def _zero(
    columns: Mapping[str, Array], channels: Mapping[str, ChannelMap], mapping: LogMapping
) -> float:
    """Return the file's start: the first stamp in it [s]."""
    first = []
    for key, channel in channels.items():
        time = channel.time or mapping.time
        if time is None:
            raise InputError(
                f"mapping '{mapping.name}': {key} has no time; accepted: time for the table or "
                "for the channel"
            )
        stamps = columns[time.column]
        stamps = stamps[np.isfinite(stamps)]
        first.extend(stamps[:1] * factor(time.unit, "s", "time"))
    return min(first, default=0.0)


def _series(
    key: str, channel: ChannelMap, columns: Mapping[str, Array], mapping: LogMapping, zero: float
) -> Series:
    time = channel.time or mapping.time
    assert time is not None  # `_zero` has seen to it
    t = _stamps(columns, time, zero)
    values = stacked_columns(columns, channel.columns, f"mapping '{mapping.name}'")
    # a row without the channel: tables that merge streams leave most cells empty
    rows = np.isfinite(t) & np.isfinite(values).any(axis=1)
    arrival = None if channel.arrival is None else _stamps(columns, channel.arrival, zero)[rows]
    return Series(t[rows], converted(key, channel, mapping, values[rows]), arrival)


def _stamps(columns: Mapping[str, Array], time: TimeColumn, zero: float) -> Array:
    return np.asarray(columns[time.column] * factor(time.unit, "s", "time") - zero)


def converted(key: str, channel: ChannelMap, mapping: LogMapping, values: Array) -> Array:
    """Return (N, width) in the unit and the axes of the channel."""
    world = axes_matrix(mapping.world, "world")
    body = axes_matrix(mapping.body, "body")
    if key in ATTITUDES:
        quaternions = _quaternions(channel, values)
        return unwrap_quaternions(turn_attitude(quaternions, world, body, mapping.turn))
    if channel.range is not None:
        low, high = channel.range
        return np.asarray((values - low) / (high - low))
    values = values * channel.factor(ALL_CHANNELS[key].unit, key)
    if key == "rotor_speed":
        # some logs sign it by the direction of rotation
        return np.asarray(values * np.where(np.nansum(values, axis=0) < 0.0, -1.0, 1.0))
    if key in _IN_WORLD:
        return np.asarray(values @ world.T)
    if key in _IN_BODY:
        if channel.axes is not None:
            return np.asarray(values @ axes_matrix(channel.axes, key).T)
        return np.asarray(values @ body.T)
    return np.asarray(values)


def _quaternions(channel: ChannelMap, values: Array) -> Array:
    if channel.order == "xyzw":
        return values
    if channel.order == "wxyz":
        return values[:, [1, 2, 3, 0]]
    out = np.full((len(values), 4), np.nan)
    usable = np.isfinite(values).all(axis=1)
    if not usable.any():
        return out
    if channel.order == "matrix":
        columns = values[usable].reshape(-1, 3, 3)
        out[usable] = Rotation.from_matrix(columns.transpose(0, 2, 1)).as_quat()
        return out
    angles = values[usable] * factor(channel.unit, "rad", "attitude")
    if channel.order == "rpy":
        angles = angles[:, ::-1]
    out[usable] = Rotation.from_euler("ZYX", angles).as_quat()
    return out
