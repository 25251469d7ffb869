"""From recorded rows to operating points: tare, lag of the cell, plateaus, noise."""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from tombo_bag.flight import Finding
from tombo_diagnosis.stand.tables.table_reader import StandTable, is_recording, stands
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import RPM

LOADS = ("thrust", "torque", "beta", "reference_speed")
"""Thrust [N], torque [N m], flap angle [rad], second tachometer [rad/s]."""
SIGMAS = tuple(f"{name}_sigma" for name in LOADS)
_MAX_LAG_SHARE = 0.05
"""Largest lag, as a share of a recording's rows."""
_MIN_PLATEAU_ROWS = 5
"""Rows of a plateau."""
_MIN_OUTLIER_SIGMAS = 6.0
_DEFAULT_NOISE_SHARE = 0.01
"""Noise as a share of a channel's range, if too few points show it."""


def plateaus(table: StandTable) -> tuple[pd.DataFrame, list[Finding]]:
    """Return the operating points of a recording, or the rows of a table that has them already.

    Columns are speed [rad/s], row (where a point begins), elapsed (0 to 1) and the LOADS by rotor.
    Columns SIGMAS have the standard deviations of the loads, in the same units.
    """
    channels = {k: table.channels[k].copy() for k in LOADS if k in table.channels}
    speed = table.channels["speed"]
    findings: list[Finding] = []
    still = stands(speed)
    before = int(still.size if still.all() else np.argmin(still))
    known = "applied_thrust" in table.channels or "applied_torque" in table.channels
    if table.mapping.tare == "start" and before >= 3 and not known:
        for name in ("thrust", "torque"):
            if name in channels:
                channels[name] -= float(np.median(channels[name][:before]))
        text = f"zero is that of {before} rows at standstill"
        findings.append(Finding("tare", "info", table.name, text))
    raw = is_recording(speed)
    lag = _lag(channels, speed) if raw else 0
    if lag:
        text = f"thrust is {lag} rows behind the tachometer; moved back"
        findings.append(Finding("lag", "info", table.name, text, channel="thrust"))
        for name in ("thrust", "torque"):
            if name in channels:
                channels[name] = np.append(channels[name][lag:], np.full(lag, np.nan))
    parts = _stretches(table, speed) if raw else [slice(k, k + 1) for k in range(speed.size)]
    if raw:
        used = sum(p.stop - p.start for p in parts)
        text = f"{len(parts)} points from {used} of {speed.size} rows"
        findings.append(Finding("rows", "info", table.name, text))
    if not parts:
        raise InputError(
            f"'{table.source}': no {_MIN_PLATEAU_ROWS} rows at one command or speed, of "
            f"{speed.size}; accepted: plateaus, or a slow ramp"
        )
    at, readings, sigma, first = _averages(channels, speed, parts)
    keep, outliers = _outliers(at, readings, table.name)
    at, readings, sigma, first = (each[keep] for each in (at, readings, sigma, first))
    sigma = _with_noise(at, readings, sigma, table, raw)
    points = pd.DataFrame(np.hstack([readings, sigma]), columns=[*LOADS, *SIGMAS])
    points["speed"], points["row"], points["elapsed"] = at, first, first / max(speed.size - 1, 1)
    return points, [*findings, *outliers]


def _lag(channels: dict[str, Array], speed: Array) -> int:
    """Return by how many rows the load comes late: where it fits the square of speed best."""
    load = channels.get("thrust", channels.get("torque"))
    if load is None or float(np.ptp(speed)) < 0.2 * float(speed.max()):
        return 0
    known = np.isfinite(load)
    load = np.interp(np.arange(load.size), np.flatnonzero(known), load[known])
    most = int(_MAX_LAG_SHARE * speed.size)
    left = []
    for lag in range(most + 1):
        square = speed[: speed.size - most] ** 2
        shifted = load[lag : lag + square.size]
        design = np.column_stack([square, np.ones(square.size)])
        rest = shifted - design @ np.linalg.lstsq(design, shifted, rcond=None)[0]
        left.append(float(np.mean(rest**2)))
    best = int(np.argmin(left))
    return best if left[best] < 0.9 * left[0] else 0


def _stretches(table: StandTable, speed: Array) -> list[slice]:
    """Return the rows of each point: plateaus of command or speed, and pieces of ramps.

    The rows in which a plateau settles are left out. A command that changes from row to row is a
    ramp, which is cut into pieces.
    """
    size = max(10, speed.size // 200)
    command = table.channels.get("command")
    ramps = command is not None and np.unique(command).size > 3
    if command is not None and ramps:
        edges = np.flatnonzero(np.diff(command) != 0.0) + 1
    else:
        smooth = np.convolve(speed, np.ones(5) / 5.0, "same")
        moving = np.abs(np.gradient(smooth)) > 0.004 * float(speed.max())
        edges = np.flatnonzero(np.diff(moving.astype(int)) != 0) + 1
        every = np.arange(size, speed.size, size)
        edges = np.union1d(edges, every) if edges.size < 8 else edges
    parts: list[slice] = []
    taken = 0
    for a, b in pairwise([0, *edges.tolist(), speed.size]):
        settle = (b - a) // 2 if b - a > 20 else (b - a) // 4
        if b - a - settle >= _MIN_PLATEAU_ROWS:
            parts += _pieces(taken, a, size) if ramps else []
            parts.append(slice(a + settle, b))
            taken = b
    return parts + (_pieces(taken, speed.size, size) if ramps else [])


def _pieces(first: int, last: int, size: int) -> list[slice]:
    return [slice(k, k + size) for k in range(first, last - size + 1, size)]


def _averages(
    channels: dict[str, Array], speed: Array, parts: list[slice]
) -> tuple[Array, Array, Array, Array]:
    at = np.array([math.sqrt(float(np.mean(speed[p] ** 2))) for p in parts])
    readings = np.full((len(parts), 4), np.nan)
    sigma = np.zeros((len(parts), 4))
    for c, name in enumerate(LOADS):
        if name not in channels:
            continue
        for k, p in enumerate(parts):
            values = channels[name][p]
            values = values[np.isfinite(values)]
            if values.size:
                readings[k, c] = values.mean()
                fresh = 1 + int(np.count_nonzero(np.diff(values)))
                sigma[k, c] = float(values.std()) / math.sqrt(fresh)
    return at, readings, sigma, np.array([p.start for p in parts])


def _off_neighbours(x: Array, y: Array) -> Array:
    """Return how far each point lies off the line through its neighbours in time; ends are 0."""
    off = np.zeros(y.size)
    if y.size > 2:
        span = x[2:] - x[:-2]
        share = np.divide(
            x[1:-1] - x[:-2], span, out=np.full(span.size, 0.5), where=np.abs(span) > 1e-9
        )
        inside = (share > -0.1) & (share < 1.1)
        off[1:-1] = np.where(inside, y[1:-1] - (1.0 - share) * y[:-2] - share * y[2:], 0.0)
    return off


def _peaks(off: Array, odd: Array, far: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the worst of each few neighbours that are far off: an outlier moves theirs as well.

    Where two are equally far off each other the odd one counts.
    """
    peak = np.zeros(off.size, bool)
    for k in np.lexsort((-odd, -np.round(off / max(float(off.max()), 1e-300), 3))):
        if far[k] and not peak[max(k - 1, 0) : k + 2].any():
            peak[k] = True
    return peak


def _outliers(speed: Array, readings: Array, name: str) -> tuple[NDArray[np.bool_], list[Finding]]:
    """Exclude single points far off their neighbours, in whichever load."""
    keep = np.asarray(np.isfinite(readings[:, :2]).any(axis=1))
    findings = []
    for c in (0, 1):
        y = readings[:, c]
        known = np.flatnonzero(np.isfinite(y))
        if known.size < 12:
            continue
        off = np.abs(_off_neighbours(speed[known] ** 2, y[known]))
        usual = 1.4826 * float(np.median(off[1:-1]))
        far = off > max(_MIN_OUTLIER_SIGMAS * usual, 0.02 * float(np.abs(y[known]).max()))
        ratio = y[known] / np.maximum(speed[known], 1e-9) ** 2
        peak = _peaks(off, np.abs(ratio - np.median(ratio)), far)
        if peak.any() and peak.sum() <= 0.05 * known.size + 1:
            keep[known[peak]] = False
            at = ", ".join(f"{v / RPM:.0f}" for v in speed[known[peak]][:5])
            text = f"{LOADS[c]} far off its neighbours at {at} rpm; set apart"
            findings.append(Finding("outlier", "fault", name, text, channel=LOADS[c]))
    return keep, findings


def _with_noise(
    speed: Array, readings: Array, sigma: Array, table: StandTable, raw: bool
) -> Array:
    """Return the noise: as said in the table, else within plateaus and between neighbours."""
    out = sigma.copy()
    turning = ~stands(speed)
    for c, stated_in in enumerate(SIGMAS):
        y = readings[:, c]
        known = np.isfinite(y) & turning
        largest = float(np.abs(y[np.isfinite(y)]).max(initial=0.0))
        stated = table.channels.get(stated_in)
        if stated is not None and not raw and stated.size == y.size and np.all(stated > 0.0):
            out[:, c] = stated
            continue
        usual = _DEFAULT_NOISE_SHARE * largest
        if known.sum() >= 8:
            off = _off_neighbours(speed[known] ** 2, y[known])
            off = np.abs(off[off != 0.0])
            if off.size >= 5:
                usual = max(1.4826 * float(np.median(off)) / math.sqrt(1.5), 1e-4 * largest)
        out[:, c] = np.maximum(out[:, c], usual)
    return np.maximum(out, 1e-12)
