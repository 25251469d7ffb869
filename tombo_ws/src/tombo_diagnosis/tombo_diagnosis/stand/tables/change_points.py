"""Whether a run changes midway: a blade chipped, a nodus slipped, a mount come loose.

Thrust by square of speed then steps, and one set of parameters can't be right on both sides. A
step in time can be told from a bend over speed only where speeds are visited again, and from
hysteresis only off the turning points: both are part of what is fitted without a step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_bag.flight import Finding
from tombo_diagnosis.stand.tables.table_reader import StandTable
from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import RPM

_FEWEST = 20
_SIDE = 5
"""Points on either side, at speeds that the other side has as well."""
_LEAST = 0.025
"""Share of thrust."""
_MIN_SIGMAS = 6.5
"""Standard deviations, the best of all places."""
_EXPLAINS = 0.4
"""Share of the squares that may be left: a smooth drift is followed by no single step."""
_INDEPENDENT = 0.2
"""Share of the step (root of its squares) that curve, drift and direction can't stand in for."""


@dataclass(frozen=True)
class Step:
    """A sudden change within a run."""

    at: int
    """First point after it."""
    size: float
    """Share by which the load at equal speed changes."""


def find_step(speed: Array, load: Array, elapsed: Array) -> Step | None:
    """Return the step of a load within a run, or None.

    All are (N,): `speed` [rad/s], `load` thrust or torque (NaN: not measured), and rising
    `elapsed`, time or rows.
    """
    known = np.flatnonzero(np.isfinite(load) & (speed > 0.15 * float(speed.max(initial=0.0))))
    if known.size < _FEWEST:
        return None
    w = speed[known] / float(speed[known].max())
    y, t = load[known], elapsed[known]
    span = float(t[-1] - t[0])
    if not span > 0.0 or not np.any(y):
        return None
    base = _without_step(w, 2.0 * (t - t[0]) / span - 1.0)
    q, _ = np.linalg.qr(base)
    left = y - q @ (q.T @ y)
    best, found = 0.0, None
    free = known.size - base.shape[1] - 1
    before = float(left @ left)
    for at in range(_SIDE, known.size - _SIDE + 1):
        if not _comparable(w, at):
            continue
        step = np.where(np.arange(known.size) >= at, w**2, 0.0)
        own = step - q @ (q.T @ step)
        square = float(own @ own)
        if square < _INDEPENDENT**2 * float(step @ step):
            continue
        size = float(own @ left) / square
        after = before - size**2 * square
        sure = abs(size) * np.sqrt(square / max(after / free, 1e-300))
        # As a share of the load at equal speed before it.
        first = float(np.sum(y[:at] * w[:at] ** 2) / np.sum(w[:at] ** 4))
        share = size / first if first > 0.0 else 0.0
        if sure > max(best, _MIN_SIGMAS) and after < _EXPLAINS * before and abs(share) > _LEAST:
            best, found = sure, Step(int(known[at]), share)
    return found


def _without_step(w: Array, t: Array) -> Array:
    """Return what may vary: a curve over speed, a smooth drift in time, the way up or down."""
    u = w**2
    slope = np.gradient(np.convolve(np.pad(w, 1, mode="edge"), np.ones(3) / 3.0, "valid"))
    way = np.sign(np.where(np.abs(slope) > 0.2 * np.abs(slope).max(initial=0.0), slope, 0.0))
    columns = [np.ones(w.size), w, u, u * w, u**2, t, t * u, t**2 * u, t**3 * u, way * w, way * u]
    return np.column_stack([c for c in columns if np.ptp(c) > 0.0 or c is columns[0]])


def _comparable(w: Array, at: int) -> bool:
    """Return whether both sides of a place have enough points at common speeds."""
    first, second = w[:at], w[at:]
    low, high = max(first.min(), second.min()), min(first.max(), second.max())
    if high - low < 0.25 * float(np.ptp(w)):
        return False
    both = [int(np.count_nonzero((s >= low) & (s <= high))) for s in (first, second)]
    return min(both) >= _SIDE


def without_changed(
    table: StandTable, speed: Array, readings: Array, first: Array
) -> tuple[NDArray[np.bool_], list[Finding]]:
    """Return which points to keep where runs change midway, and say so: the longer side.

    `speed` (N,) [rad/s], `readings` (N, 4); `first` (N,) is the row at which each begins.
    """
    keep = np.ones(speed.size, bool)
    findings: list[Finding] = []
    rows = first.astype(int)
    keys = [table.channels[k][rows] for k in ("conf", "run", "propeller") if k in table.channels]
    group = np.zeros(speed.size, np.int64)
    if keys and speed.size:
        group = np.unique(np.column_stack(keys), axis=0, return_inverse=True)[1].reshape(-1)
    for g in np.unique(group):
        own = np.flatnonzero(group == g)
        for c, name in enumerate(("thrust", "torque")):
            step = find_step(speed[own], readings[own, c], first[own])
            if step is None:
                continue
            after = np.arange(own.size) >= step.at
            lost = after if after.sum() <= own.size / 2 else ~after
            keep[own[lost]] = False
            k = own[step.at]
            side = "higher" if step.size > 0.0 else "lower"
            text = (
                f"from row {rows[k] + 1} on ({speed[k] / RPM:.0f} rpm) {name} is "
                f"{100.0 * abs(step.size):.0f} % {side} at equal speed: propeller or mount "
                f"changed; the shorter part, {lost.sum()} points, is set apart"
            )
            findings.append(Finding("change", "fault", table.name, text, channel=name))
            break
    return keep, findings
