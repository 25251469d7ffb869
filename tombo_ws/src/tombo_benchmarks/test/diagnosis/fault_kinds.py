"""Kinds of faults of logs that a pre-check has to name.

Each kind has three sizes, small to large, or three variants where it has no size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_benchmarks.diagnosis.log_faults import (
    IMU,
    MIXED,
    POSE,
    ROTORS,
    SCALED,
    Change,
    LogFault,
    columns_of,
    frozen,
    log_fault,
    of_stamps,
    of_values,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.vehicle import GRAVITY

SPEEDS = ("rotor_speed",)
SIZES = ("small", "medium", "large")


def _part(series: Series, rows: Any) -> Series:
    arrival = None if series.arrival is None else series.arrival[rows]
    return Series(series.t[rows], series.values[rows], arrival)


def _zeros(series: Series, share: float, rng: np.random.Generator) -> Series:
    """Read 0 in runs of 20 samples."""
    values = series.values.copy()
    rotor = int(rng.integers(4))
    lost = np.repeat(rng.random(len(values) // 20 + 1) < share, 20)[: len(values)]
    values[lost, rotor] = 0.0
    return replace(series, values=values)


def _stuck_rotor(series: Series, seconds: float, rng: np.random.Generator) -> Series:
    values = series.values.copy()
    rotor, begin = int(rng.integers(4)), float(rng.uniform(6.0, 12.0))
    rows = (series.t > begin) & (series.t < begin + seconds)
    values[rows, rotor] = values[np.argmax(rows), rotor]
    return replace(series, values=values)


def _stepped_back(series: Series, seconds: float, rng: np.random.Generator) -> Series:
    at = float(rng.uniform(8.0, 16.0))
    return replace(series, t=series.t - np.where(series.t > at, seconds, 0.0), arrival=None)


def _only(keep: Callable[[Array, Any], Any]) -> Change:
    return lambda s, size, rng: _part(s, keep(s.t, size))


def _no_numbers(series: Series, share: float, rng: np.random.Generator) -> Series:
    values = series.values.copy()
    values[: round(share * len(values))] = np.nan
    return replace(series, values=values)


def _held(series: Series, times: int, rng: np.random.Generator) -> Series:
    return replace(series, values=series.values[np.arange(series.t.size) // times * times])


def _clipped(values: Array, share: float) -> Array:
    limit = share * np.percentile(np.abs(values), 99.9)
    return np.asarray(np.clip(values, -limit, limit))


def _bursts(series: Series, share: float, rng: np.random.Generator) -> Series:
    lost = rng.random(int(series.t[-1] / 0.5) + 2) < share
    return _part(series, ~lost[(series.t / 0.5).astype(np.int64).clip(0)])


def _swaps(series: Series, size: float, rng: np.random.Generator) -> Series:
    """Displace the poses for four samples, about every 4 s."""
    values = series.values.copy()
    for begin in np.arange(5.0, series.t[-1] - 3.0, 4.0):
        at = int(np.argmax(series.t > begin + rng.uniform(0.0, 2.0)))
        values[at : at + 4] += size * np.array([0.8, 0.6, 0.0])
    return replace(series, values=values)


def _turn_over(q: Array) -> Array:
    over = Rotation.from_quat(q) * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return np.asarray(over.as_quat())


_TIMES = of_stamps(lambda t, factor: t * factor)

FAULTS: tuple[LogFault, ...] = (
    log_fault("one rotor reads zero", SPEEDS, (0.05, 0.2, 0.8), _zeros, "rpm"),
    log_fault("one rotor stuck", SPEEDS, (1.0, 4.0, 60.0), _stuck_rotor, "rpm frozen"),
    log_fault("scale of all rotors", SPEEDS, (2.0, 7.0, 9.5493), SCALED, "rpm unit"),
    log_fault(
        "order of rotors", SPEEDS,
        columns_of(([1, 0, 2, 3], [1]), ([0, 2, 1, 3], [1]), ([3, 2, 0, 1], [1])), MIXED, "rpm",
    ),
    log_fault("another vehicle", ROTORS, (0.7, 1.5, 4.0), SCALED, "vehicle"),
    log_fault("IMU clock set back", IMU, (0.1, 0.6, 5.0), _stepped_back, "stamps"),
    log_fault("poses' clock set back", POSE, (0.1, 0.6, 5.0), _stepped_back, "stamps"),
    log_fault("IMU time unit", IMU, (1e3, 1e6, 1e9), _TIMES, "stamps unit"),
    log_fault(
        "log's time unit", (*POSE, *IMU, *ROTORS, "voltage"), (1e-3, 1e3, 1e6), _TIMES,
        "stamps unit",
    ),
    log_fault(
        "delay of the poses", POSE, (0.025, 0.06, 0.2), of_stamps(lambda t, late: t + late),
        "stamps", "mocap_stamp_error mocap_latency",
    ),
    log_fault("IMU starts late", IMU, (3.0, 8.0, 20.0), _only(lambda t, late: t > late), "gap"),
    log_fault("rotors end early", ROTORS, (24.0, 18.0, 6.0), _only(lambda t, end: t < end), "gap"),
    log_fault("gyro no numbers", ("gyro",), (0.1, 0.5, 1.0), _no_numbers, "missing gap"),
    log_fault("poses lost in bursts", POSE, (0.1, 0.3, 0.6), _bursts, "gap", "mocap_dropouts"),
    log_fault("poses frozen", POSE, (0.4, 1.5, 5.0), frozen, "frozen"),
    log_fault("poses held", POSE, (2, 4, 8), _held, "duplicate"),
    log_fault("markers swapped", ("position",), (0.05, 0.15, 0.5), _swaps, "jump"),
    log_fault("gyro unit", ("gyro",), (9.5493, 57.296, 57296.0), SCALED, "unit"),
    log_fault("accel unit", ("accel",), (1.0 / GRAVITY, 3.2808, 1e3 / GRAVITY), SCALED, "unit"),
    log_fault(
        "gyro axes", ("gyro",),
        columns_of(([0, 1, 2], [1, 1, -1]), ([1, 0, 2], [1]), ([1, 0, 2], [1, -1, 1])), MIXED,
        "frame",
    ),
    log_fault(
        "accel axes", ("accel",),
        columns_of(([0, 1, 2], [-1, 1, 1]), ([1, 0, 2], [1]), ([0, 1, 2], [1, -1, -1])), MIXED,
        "frame",
    ),
    log_fault("gyro saturated", ("gyro",), (0.7, 0.5, 0.3), of_values(_clipped), "saturation"),
    log_fault("unit of length", ("position",), (3.2808, 100.0, 1000.0), SCALED, "unit"),
    log_fault(
        "world axes", ("position",),
        columns_of(([0, 1, 2], [1, -1, 1]), ([1, 0, 2], [1]), ([1, 0, 2], [1, 1, -1])), MIXED,
        "frame",
    ),
    log_fault(
        "quaternion", ("attitude",),
        (lambda q: q * [-1, -1, -1, 1], lambda q: q[:, [3, 0, 1, 2]], _turn_over),
        of_values(lambda q, change: change(q)), "frame",
    ),
)  # fmt: skip
"""Kinds of faults, each with three sizes."""
