"""From a table of a thrust stand to a checked run in SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tombo_bag.flight import Finding
from tombo_diagnosis.stand.tables.mapping import (
    CHANNELS,
    StandMapping,
    infer_mapping,
    load_mapping,
    mapping_for_header,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM, SPEED_LIMIT
from tombo_logs.readers.csv_table import open_table

_SOUND = 340.0
_MACH = 0.95
_SLOWEST = 20.0
"""rad/s: a stand that never turns faster has its unit wrong."""
_PER_ROTOR = ("thrust", "torque", "applied_thrust", "applied_torque", "thrust_sigma")


@dataclass(frozen=True, eq=False)
class StandTable:
    """A run as recorded, in SI units, by rotor."""

    name: str
    source: str
    mapping: StandMapping
    channels: Mapping[str, Array]
    """Name -> (N,); speed is the root of the rotors' mean square, loads are by rotor."""
    rotor_speed: Array
    """(N, rotors measured) rad/s."""
    findings: tuple[Finding, ...]

    @property
    def rows(self) -> int:
        """Number of rows."""
        return int(self.channels["speed"].size)


def read_stand(path: Path, mapping: str | None = None) -> StandTable:
    """Read a table of a thrust stand, CSV or CSV.gz.

    Without the name or file of a mapping it is recognised by the header, or by plain names.

    Raises:
        InputError: empty, no header, columns missing, or values that can't be what they are said
            to be; column, value and what is expected are named.
    """
    given = None if mapping is None else load_mapping(mapping)
    table = open_table(path)
    chosen = given or mapping_for_header(table.columns) or infer_mapping(table.columns, path)
    wanted = [c for channel in chosen.channels.values() for c in channel.columns]
    missing = [c for c in wanted if c not in table.columns]
    if missing or "speed" not in chosen.channels:
        lacking = f"column '{missing[0]}'" if missing else "channel speed in the mapping"
        raise InputError(
            f"'{path}': no {lacking}; accepted: a table with {', '.join(wanted) or 'speed'}; it "
            f"has {', '.join(table.columns)[:200]}"
        )
    numbers, damage = table.numbers(sorted(set(wanted)))
    name = path.name.split(".")[0]
    findings = [Finding("table", "warning", name, d) for d in (*table.damage, *damage)]
    findings += [Finding("table", "info", name, remark) for remark in table.remarks]
    channels: dict[str, Array] = {}
    rotor_speed: Array = np.zeros((0, 0))
    for key, where in chosen.channels.items():
        scale = where.factor(CHANNELS[key], f"{key} of '{path}'")
        columns = np.column_stack([scale * numbers[c] for c in where.columns])
        if key in ("speed", "reference_speed"):
            if key == "speed":
                columns, found = _without_glitches(columns, name, where.columns)
                findings += found
                rotor_speed = columns
            channels[key] = np.sqrt(np.mean(columns**2, axis=1))
        else:
            channels[key] = columns[:, 0] / (chosen.rotors if key in _PER_ROTOR else 1)
    rows = np.isfinite(channels["speed"])
    loads = [channels[c] for c in ("thrust", "torque") if c in channels]
    if not loads:
        raise InputError(f"'{path}': neither thrust nor torque; accepted: one of them at least")
    rows &= np.isfinite(np.column_stack(loads)).any(axis=1)
    if not rows.all():
        text = (
            f"{(~rows).sum()} of {rows.size} rows have no number in speed or loads "
            f"({', '.join(wanted[:6])}) and are left out"
        )
        findings.append(Finding("missing", "warning", name, text))
    if rows.sum() < 3:
        raise InputError(
            f"'{path}': {int(rows.sum())} rows with numbers in speed and a load; accepted: 3 or "
            f"more with {', '.join(wanted)}"
        )
    channels = {key: values[rows] for key, values in channels.items()}
    source = f"{path} ({chosen.name})"
    result = StandTable(name, source, chosen, channels, rotor_speed[rows], tuple(findings))
    _check_plausible(result, path)
    _check_deviations(result, path)
    return result


def _check_deviations(table: StandTable, path: Path) -> None:
    """Refuse standard deviations that are no number, zero or negative."""
    for key in ("thrust_sigma", "torque_sigma"):
        values = table.channels.get(key, np.ones(1))
        bad = np.flatnonzero(~(np.isfinite(values) & (values > 0.0)))
        if bad.size:
            where = table.mapping.channels[key]
            scale = where.factor(CHANNELS[key], key)
            raise InputError(
                f"'{path}': column '{where.columns[0]}' has {values[bad[0]] / scale:g} in row "
                f"{bad[0] + 1}; accepted: numbers above 0, the noise's standard deviation"
            )


def _without_glitches(
    speed: Array, name: str, columns: tuple[str, ...]
) -> tuple[Array, list[Finding]]:
    """Put single samples in which one rotor alone is far off back to its neighbours' median."""
    findings: list[Finding] = []
    if speed.shape[0] < 7:
        return speed, findings
    padded = np.pad(speed, ((3, 3), (0, 0)), mode="edge")
    around = np.median(np.lib.stride_tricks.sliding_window_view(padded, 7, axis=0), axis=2)
    far = np.abs(speed - around) > np.maximum(0.05 * around, 10.0)
    fast = around > 0.2 * np.nanmax(around, initial=0.0)
    if speed.shape[1] > 1:
        far &= far.sum(axis=1, keepdims=True) < speed.shape[1]
    else:
        far &= np.abs(speed - around) > 0.3 * around
    bad = far & fast
    if bad.any():
        counts = zip(columns, bad.sum(axis=0), strict=True)
        per = ", ".join(f"{c} {n}" for c, n in counts if n)
        text = f"samples far from their neighbours set apart: {per}"
        findings.append(Finding("speed_glitch", "warning", name, text, channel="speed"))
    return np.where(bad, around, speed), findings


def _check_plausible(table: StandTable, path: Path) -> None:
    """Refuse a tip faster than sound, a rotor that never turns, a wrong sign, a large angle."""
    where, speed = table.mapping.channels, table.channels["speed"]
    column, unit = where["speed"].columns[0], where["speed"].unit
    if (speed < 0.0).any() or (table.rotor_speed < 0.0).any():
        raise InputError(
            f"'{path}': column '{column}' has negative speeds; accepted: 0 and above ({unit})"
        )
    top = float(speed.max())
    if table.mapping.model == "tombo":
        radius, most = 0.1111, SPEED_LIMIT
    else:
        radius = 0.5e-3 * table.mapping.diameter_mm
        most = _MACH * _SOUND / radius if radius else 1.2e4
    if top > most:
        mach = f", tip at Mach {top * radius / _SOUND:.1f}" if radius else ""
        raise InputError(
            f"'{path}': column '{column}' reaches {top / RPM:.0f} rpm as {unit}{mach}; accepted: "
            f"up to {most / RPM:.0f} rpm: is the unit right (rpm, rad/s, Hz), or the pole count?"
        )
    if top < _SLOWEST:
        raise InputError(
            f"'{path}': column '{column}' never passes {top / RPM:.0f} rpm as {unit}; accepted: "
            f"above {_SLOWEST / RPM:.0f} rpm: is the unit right (rpm, rad/s, Hz)?"
        )
    for key in ("thrust", "torque"):
        if key in table.channels:
            _check_sign(table, key, path)
    beta = table.channels.get("beta")
    if beta is not None and np.nanmax(np.abs(beta), initial=0.0) > 0.5 * math.pi:
        c = where["beta"]
        largest = float(np.nanmax(np.abs(beta)))
        raise InputError(
            f"'{path}': column '{c.columns[0]}' reaches {math.degrees(largest):.0f} degrees as "
            f"{c.unit}; accepted: below 90: is the unit right (deg, rad)?"
        )


def _check_sign(table: StandTable, key: str, path: Path) -> None:
    values, square = table.channels[key], table.channels["speed"] ** 2
    known = np.isfinite(values)
    if known.sum() < 3:
        return
    high = square[known] > 0.5 * square[known].max()
    low = square[known] < 0.05 * square[known].max()
    level = float(np.median(values[known][low])) if low.any() else 0.0
    rise = float(np.median(values[known][high])) - level
    if low.all() or high.all():
        rise = float(np.median(values[known]))  # one speed: its sign is all there is
    if rise < 0.0:
        column = table.mapping.channels[key].columns[0]
        raise InputError(
            f"'{path}': column '{column}' falls with speed, to {rise:.3g} "
            f"{'N' if key == 'thrust' else 'N m'} by rotor; accepted: {key} that rises; of a cell "
            "mounted the other way round give `sign: -1` in --mapping"
        )
