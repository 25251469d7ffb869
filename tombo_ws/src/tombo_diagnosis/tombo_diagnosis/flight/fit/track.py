"""A flight log resampled to evenly spaced ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from tombo_bag.flight import Flight, Series
from tombo_diagnosis.flight.fit.filters import (
    Kernel,
    clear_rows,
    gaussian,
    held_means,
    interpolated,
    rows_of,
    tick_means,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_logs.checks.spans import Mask, Span, inside

TICK = 0.004
"""[s]"""
FAST_WIDTH, FAST_SPACING = 0.015, 0.02
"""Kernel of the IMU and the rotors [s]: up to about 9 Hz."""
SLOW_WIDTH, SLOW_SPACING = 0.055, 0.06
"""Kernel of the motion capture [s]: up to about 2.4 Hz, where 30 Hz poses give accelerations."""
_GAP = 0.12
"""s without a pose that a spline bridges."""
_TRANSPORT = 0.001
"""s from the stamp of a command until the motors follow it, as in the simulation."""
SHORTEST_S = 2.0
"""s of undisturbed flight that a diagnosis needs."""


@dataclass(frozen=True)
class Track:
    """One flight, ready to be compared with the model."""

    name: str
    t: Array
    """(N,) ticks [s]."""
    pose_t: Array
    """(M,) stamps of the poses [s]."""
    pose: Array
    """(M, 7) as measured."""
    arrival: Array
    """(M,) latency arrival - stamp [s], or (0,)."""
    accel: Array
    """(N, 3) or (0, 3)."""
    gyro: Array
    """(N, 3) or (0, 3)."""
    command: Array
    """(N, 4) rotor speeds asked for [rad/s]; (0, 4): not known."""
    speed: Array
    """(N, 8) measured rotor speeds and slopes, or (0, 8)."""
    voltage: Array
    """(N, 1) or (0, 1)."""
    fast: Kernel
    slow: Kernel
    fast_rows: Mask
    """Rows of the fast kernel that count."""
    slow_rows: Mask
    pose_rows: Mask
    log: Flight

    @cached_property
    def fast_kernel(self) -> Kernel:
        """The fast kernel's rows that count."""
        return rows_of(self.fast, self.fast_rows)

    @cached_property
    def slow_kernel(self) -> Kernel:
        """The slow kernel's rows that count."""
        return rows_of(self.slow, self.slow_rows)

    def times(self, group: str) -> Array:
        """Return the times of the rows of a group (fast, slow, pose) that count [s]."""
        every = {"fast": self.fast.t, "slow": self.slow.t, "pose": self.pose_t}
        return np.asarray(every[group][getattr(self, f"{group}_rows")])

    def only(self, fast: Mask, slow: Mask, pose: Mask) -> Track:
        """Return the flight with some of the rows that count only."""
        return replace(
            self,
            fast_rows=self.fast_rows & fast,
            slow_rows=self.slow_rows & slow,
            pose_rows=self.pose_rows & pose,
        )

    @property
    def formulation(self) -> str:
        """`imu` or `mocap`."""
        return "imu" if self.accel.size and self.gyro.size else "mocap"

    @property
    def used_s(self) -> float:
        """Time that counts [s]."""
        return float(np.count_nonzero(self.slow_rows)) * SLOW_SPACING

    @property
    def missing(self) -> tuple[str, ...]:
        """Channels that the log does not have."""
        names = {"accel": self.accel, "gyro": self.gyro, "rotor speed": self.speed}
        names |= {"rotor command": self.command, "voltage": self.voltage}
        names |= {"arrival times": self.arrival}
        return tuple(name for name, values in names.items() if not values.size)


def track_of(log: Flight) -> Track:
    """Resample a log to ticks.

    Raises:
        InputError: no poses, or less than two seconds of undisturbed flight.
    """
    for name in ("position", "attitude"):
        if name not in log.series:
            raise InputError(
                f"flight '{log.name}': no channel '{name}'; accepted: a log with poses of the "
                "motion capture (position and attitude)"
            )
    pose_t, pose, late = _poses(log.series["position"], log.series["attitude"])
    if pose_t.size < 10:
        raise InputError(f"flight '{log.name}': {pose_t.size} usable poses; accepted: at least 10")
    begin, end = pose_t[0], pose_t[-1]
    count = int((end - begin) / TICK)
    if count * TICK < SHORTEST_S:
        raise InputError(
            f"flight '{log.name}': its poses span {count * TICK:.2f} s; accepted: at least "
            f"{SHORTEST_S:g} s of flight"
        )
    t = begin + TICK * np.arange(count)
    invalid = inside(t, [*_gaps(pose_t, _GAP), *log.exclude])
    fast = gaussian(t, FAST_WIDTH, FAST_SPACING)
    slow = gaussian(t, SLOW_WIDTH, SLOW_SPACING)
    accel, gaps_a = _sampled(log, "accel", t)
    gyro, gaps_g = _sampled(log, "gyro", t)
    speed, gaps_s = _sampled(log, "rotor_speed", t)
    if speed.size:
        speed = np.column_stack([speed, np.gradient(speed, TICK, axis=0)])
    voltage, _ = _sampled(log, "voltage", t)
    command = _command(log, t)
    invalid |= gaps_a | gaps_g | gaps_s
    slow_rows = clear_rows(slow, invalid)
    used_s = np.count_nonzero(slow_rows) * SLOW_SPACING
    if used_s < SHORTEST_S:
        raise InputError(
            f"flight '{log.name}': {used_s:.1f} s are left when what is invalid is set apart; "
            f"accepted: at least {SHORTEST_S:g} s"
        )
    counted = np.interp(pose_t, t, invalid.astype(np.float64)) < 0.5
    return Track(
        log.name, t, pose_t, pose, late, accel, gyro, command, speed, voltage, fast, slow,
        clear_rows(fast, invalid), slow_rows, counted, log,
    )  # fmt: skip


def _poses(position: Series, attitude: Series) -> tuple[Array, Array, Array]:
    """Return stamps, poses and latencies of finite poses, stamps rising, signs of q continuous."""
    same = position.t.size == attitude.t.size and np.array_equal(position.t, attitude.t)
    turn = attitude.values if same else interpolated(position.t, attitude.t, attitude.values)
    pose = np.column_stack([position.values, turn])
    good = np.isfinite(pose).all(axis=1) & np.isfinite(position.t)
    highest = np.maximum.accumulate(np.where(good, position.t, -math.inf))
    good[1:] &= position.t[1:] > highest[:-1] + 1e-6
    pose_t = position.t[good]
    pose = pose[good]
    lengths = np.linalg.norm(pose[:, 3:], axis=1)
    pose[:, 3:] /= np.maximum(lengths, 1e-9)[:, None]
    pose[:, 3:] = unwrap_quaternions(pose[:, 3:])
    late: Array = np.zeros(0)
    if position.arrival is not None:
        late = position.arrival[good] - pose_t
        if not np.isfinite(late).all():
            late = np.zeros(0)
    return pose_t, pose, late


def _sampled(log: Flight, name: str, t: Array) -> tuple[Array, Mask]:
    """Return a channel at the ticks, (N, k) or (0, k), and the ticks in its gaps."""
    width = {"voltage": 1, "rotor_speed": 4}.get(name, 3)
    stamps, values = _good(log, name, width)
    if stamps.size < 10:
        return np.zeros((0, width)), np.zeros(t.size, np.bool_)
    longest = max(0.05, 5.0 * float(np.median(np.diff(stamps))))
    invalid = inside(t, _gaps(stamps, longest))
    if name != "voltage":
        invalid |= (t < stamps[0]) | (t > stamps[-1])
    return tick_means(stamps, values, t), invalid


def _command(log: Flight, t: Array) -> Array:
    stamps, values = _good(log, "rotor_command", 4)
    return held_means(stamps + _TRANSPORT, values, t) if stamps.size else values


def _good(log: Flight, name: str, width: int) -> tuple[Array, Array]:
    """Return the finite samples of a channel whose stamps rise; none of one with too few."""
    series = log.series.get(name)
    if series is None or series.t.size < 10:
        return np.zeros(0), np.zeros((0, width))
    good = np.isfinite(series.values).all(axis=1) & np.isfinite(series.t)
    good[1:] &= np.diff(series.t) > 0.0
    return series.t[good], series.values[good]


def _gaps(stamps: Array, longest: float) -> list[Span]:
    found = np.flatnonzero(np.diff(stamps) > longest)
    return [(float(stamps[i]), float(stamps[i + 1])) for i in found]
