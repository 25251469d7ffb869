"""Faults of logs, put into healthy flights: what a pre-check has to name, and never as physics.

Each kind has three sizes, small to large, or three variants where it has no size.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Finding, Flight, RefusedLog, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.vehicle import GRAVITY

POSE, IMU = ("position", "attitude"), ("gyro", "accel")
SPEEDS, ROTORS = ("rotor_speed",), ("rotor_speed", "rotor_command", "motor_command")
_COMPARED = ("position", "gyro")
"""Stamps and frames of poses and IMU: what is wrong is told by both."""
SIZES = ("small", "medium", "large")

Change = Callable[[Series, Any, np.random.Generator], Series]


@dataclass(frozen=True)
class LogFault:
    """One kind of fault."""

    name: str
    channels: tuple[str, ...]
    """Channels that it changes."""
    sizes: tuple[Any, ...]
    change: Change
    """(series, size, generator) to the series of the faulty log; the generator starts the same for
    each channel."""
    checks: frozenset[str]
    """Checks whose finding names it."""
    effects: frozenset[str] = frozenset()
    """Effects of the registry that describe it: to name one of them is right, too."""

    def applied(self, log: Flight, size: int, seed: Sequence[int]) -> Flight:
        """Return the log with this fault; `size` counts `sizes` from 0."""
        changed = {
            name: self.change(log.series[name], self.sizes[size], np.random.default_rng(seed))
            for name in self.channels
            if name in log.series
        }
        return log.with_series({**log.series, **changed})

    def named_by(self, findings: Sequence[Finding]) -> bool:
        """Return whether one of these findings names the fault, with its channel."""
        return any(
            f.severity != "info" and f.check in self.checks and self.concerns(f.channel)
            for f in findings
        )

    def named_by_error(self, error: InputError) -> bool:
        """Return whether checks refuse the flight by a channel that it concerns."""
        return isinstance(error, RefusedLog) and self.concerns(error.finding.channel)

    def concerns(self, channel: str) -> bool:
        """Return whether the channel is changed, or compared with one that is."""
        return any(
            channel in kin
            for kin in (POSE, IMU, ROTORS, _COMPARED)
            if set(kin) & set(self.channels)
        )


def of_values(change: Callable[[Array, Any], Array]) -> Change:
    """Return the change of a series that changes its values, by (values, size)."""
    return lambda s, size, rng: replace(s, values=change(s.values, size))


def of_stamps(change: Callable[[Array, Any], Array]) -> Change:
    """Return the change of a series that changes its stamps, by (stamps, size)."""
    return lambda s, size, rng: replace(s, t=change(s.t, size), arrival=None)


def _part(series: Series, rows: Any) -> Series:
    arrival = None if series.arrival is None else series.arrival[rows]
    return Series(series.t[rows], series.values[rows], arrival)


def _one_rotor(series: Series, factor: float, rng: np.random.Generator) -> Series:
    values = series.values.copy()
    values[:, int(rng.integers(4))] *= factor
    return replace(series, values=values)


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


def frozen(series: Series, seconds: float, rng: np.random.Generator) -> Series:
    """Return a series that stands still for some seconds."""
    begin = float(rng.uniform(6.0, 12.0))
    rows = np.arange(series.t.size)
    held = (series.t > begin) & (series.t < begin + seconds)
    rows[held] = np.argmax(held)
    return replace(series, values=series.values[rows])


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


def columns_of(*ways: tuple[Sequence[int], Sequence[float]]) -> tuple[Any, ...]:
    """Return sizes for `MIXED`: the order of the columns, and their signs."""
    return tuple((list(order), np.array(signs)) for order, signs in ways)


def _mixed(values: Array, way: tuple[list[int], Array]) -> Array:
    return np.asarray(values[:, way[0]] * way[1])


def _turn_over(q: Array) -> Array:
    over = Rotation.from_quat(q) * Rotation.from_rotvec([np.pi, 0.0, 0.0])
    return np.asarray(over.as_quat())


def log_fault(
    name: str, channels: Sequence[str], sizes: tuple[Any, ...], change: Change, checks: str,
    effects: str = "",
) -> LogFault:  # fmt: skip
    """Return a kind of fault; names of checks and effects are parted by spaces."""
    return LogFault(
        name, tuple(channels), sizes, change, frozenset(checks.split()),
        frozenset(effects.split()),
    )  # fmt: skip


SCALED = of_values(lambda v, factor: v * factor)
MIXED = of_values(_mixed)
_TIMES = of_stamps(lambda t, factor: t * factor)

FAULTS: tuple[LogFault, ...] = (
    log_fault("one rotor's scale", SPEEDS, (0.85, 0.7, 0.536), _one_rotor, "rpm"),
    log_fault("one rotor reads zero", SPEEDS, (0.05, 0.2, 0.8), _zeros, "rpm"),
    log_fault("one rotor stuck", SPEEDS, (1.0, 4.0, 60.0), _stuck_rotor, "rpm frozen"),
    log_fault("scale of all rotors", SPEEDS, (2.0, 7.0, 9.5493), SCALED, "rpm unit"),
    log_fault(
        "order of rotors", SPEEDS,
        columns_of(([1, 0, 2, 3], [1]), ([0, 2, 1, 3], [1]), ([3, 2, 0, 1], [1])), MIXED, "rpm",
    ),
    log_fault("another vehicle", ROTORS, (0.7, 1.5, 4.0), SCALED, "vehicle"),
    log_fault("IMU clock rate", IMU, (1.0005, 1.001, 1.01), _TIMES, "stamps"),
    log_fault("rotor clock rate", ROTORS, (0.995, 1.01, 1.03), _TIMES, "stamps"),
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
    log_fault(
        "gyro quantised", ("gyro",), (0.05, 0.2, 1.0),
        of_values(lambda v, step: np.round(v / step) * step), "resolution",
    ),
    log_fault(
        "position quantised", ("position",), (0.01, 0.03, 0.1),
        of_values(lambda v, step: np.round(v / step) * step), "resolution duplicate",
    ),
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
