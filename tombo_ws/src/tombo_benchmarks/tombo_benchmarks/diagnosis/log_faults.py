"""Faults of logs, put into healthy flights: a pre-check must name them, never as physics."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from tombo_bag.flight import Finding, Flight, RefusedLog, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError

POSE, IMU = ("position", "attitude"), ("gyro", "accel")
ROTORS = ("rotor_speed", "rotor_command", "motor_command")
_COMPARED = ("position", "gyro")
"""Stamps and frames of poses and IMU: a difference can be a fault of either."""

Change = Callable[[Series, Any, np.random.Generator], Series]


@dataclass(frozen=True)
class LogFault:
    """One kind of fault."""

    name: str
    channels: tuple[str, ...]
    """Channels that it changes."""
    size: Any
    change: Change
    """(series, size, generator) to the series of the faulty log; the generator starts the same for
    each channel."""
    checks: frozenset[str]
    """Checks whose finding names it."""
    effects: frozenset[str] = frozenset()
    """Effects of the registry that describe it: to name one of them is right, too."""

    def applied(self, log: Flight, seed: Sequence[int]) -> Flight:
        """Return the log with this fault."""
        changed = {
            name: self.change(log.series[name], self.size, np.random.default_rng(seed))
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


def frozen(series: Series, seconds: float, rng: np.random.Generator) -> Series:
    """Return a series that stands still for some seconds."""
    begin = float(rng.uniform(6.0, 12.0))
    rows = np.arange(series.t.size)
    held = (series.t > begin) & (series.t < begin + seconds)
    rows[held] = np.argmax(held)
    return replace(series, values=series.values[rows])


def columns(order: Sequence[int], signs: Sequence[float]) -> tuple[list[int], Array]:
    """Return the size of a fault `MIXED`: the order of the columns, and their signs."""
    return list(order), np.array(signs)


def _mixed(values: Array, way: tuple[list[int], Array]) -> Array:
    return np.asarray(values[:, way[0]] * way[1])


def log_fault(
    name: str, channels: Sequence[str], size: Any, change: Change, checks: str,
    effects: str = "",
) -> LogFault:  # fmt: skip
    """Return a kind of fault; names of checks and effects are parted by spaces."""
    return LogFault(
        name, tuple(channels), size, change, frozenset(checks.split()),
        frozenset(effects.split()),
    )  # fmt: skip


SCALED = of_values(lambda v, factor: v * factor)
MIXED = of_values(_mixed)
