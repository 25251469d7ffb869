"""A flight log resampled to evenly spaced ticks."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import sparse
from scipy.ndimage import gaussian_filter1d

from tombo_bag.flight import Flight, Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError
from tombo_dynamics.rotation import unwrap_quaternions
from tombo_logs.checks.even_flight import IMU_WIDTH, POSE_WIDTH, EvenFlight, held_means, resample
from tombo_logs.checks.spans import Mask, Span, inside, interpolated

_REACH = 4.0
"""Half length of the kernel, in widths."""


@dataclass(frozen=True)
class Kernel:
    """Sparse operators from the ticks of a flight to its rows, a row each `spacing` seconds."""

    t: Array
    """(R,) times of the rows [s]."""
    reach: float
    """Half length of the kernel [s]."""
    smooth: Any
    """(R, N) mean."""
    slope: Any
    """(R, N) first derivative [1/s]."""
    curvature: Any
    """(R, N) second derivative [1/s^2]."""


def gaussian(t: Array, width: float, spacing: float) -> Kernel:
    """Build the kernel over evenly spaced ticks t (N,) [s].

    `width` is the standard deviation of the Gaussian [s], `spacing` the distance of the rows [s],
    rounded to ticks.
    """
    tick = float(t[1] - t[0])
    half = max(2, int(np.ceil(_REACH * width / tick)))
    offsets = np.arange(-half, half + 1)
    tau = offsets * tick
    bell = np.exp(-0.5 * (tau / width) ** 2)
    smooth = bell / bell.sum()
    # Exact on polynomials: the slope of t is 1, the curvature of t^2/2 is 1 and that of 1 is 0.
    slope = bell * tau
    slope /= slope @ tau
    curvature = bell * (tau**2 - width**2)
    curvature -= curvature.sum() / bell.sum() * bell
    curvature /= 0.5 * curvature @ tau**2
    centres = np.arange(half, t.size - half, max(1, round(spacing / tick)))
    columns = (centres[:, None] + offsets[None, :]).ravel()
    starts = np.arange(centres.size + 1) * offsets.size

    def operator(weights: Array) -> Any:
        data = np.tile(weights, centres.size)
        return sparse.csr_matrix((data, columns, starts), shape=(centres.size, t.size))

    return Kernel(t[centres], half * tick, operator(smooth), operator(slope), operator(curvature))


def smoothed(values: Array, width: float) -> Array:
    """Return rows (N, k) smoothed by a Gaussian of `width` rows, a second time what it took away.

    So curved motion keeps its height: polynomials up to the third degree pass unchanged. At the
    ends the rows go on as if turned about the last one.
    """
    reach = min(2 * math.ceil(_REACH * width), values.shape[0] - 1)
    padded = np.pad(values, ((reach, reach), (0, 0)), mode="reflect", reflect_type="odd")
    once = gaussian_filter1d(padded, width, axis=0)
    twice = once + gaussian_filter1d(padded - once, width, axis=0)
    return np.asarray(twice[reach : reach + values.shape[0]])


def clear_rows(kernel: Kernel, invalid: Mask) -> Mask:
    """Return (R,): rows whose kernel touches none of the invalid ticks (N,)."""
    return np.asarray(abs(kernel.smooth) @ invalid.astype(np.float64) == 0.0)


def rows_of(kernel: Kernel, chosen: Mask) -> Kernel:
    """Return the kernel with some of its rows (R,) only."""
    parts = (kernel.smooth[chosen], kernel.slope[chosen], kernel.curvature[chosen])
    return Kernel(kernel.t[chosen], kernel.reach, *parts)


TICK = 0.004
"""[s]"""
FAST_SPACING, SLOW_SPACING = 0.02, 0.06
"""Between rows of the kernel of IMU and rotors, and of that of the motion capture [s]."""
_GAP = 0.12
"""s without a pose that a spline bridges."""
_TRANSPORT = 0.001
"""s from the stamp of a command until the motors follow it, as in the simulation."""
SHORTEST_S = 2.0
"""s of undisturbed flight that a diagnosis needs."""


WIND = "steady_wind"
"""The effect that swings."""


@dataclass(frozen=True)
class Swing:
    """How the air swung along a flight: parameters of `WIND`."""

    east: float
    """Amplitude along map x [m/s]."""
    north: float
    """[m/s]"""
    frequency: float
    """[Hz]"""
    phase: float
    """At the first tick [rad]."""
    deviation: float
    """Standard deviation of the amplitudes [m/s]."""
    frequency_deviation: float
    """Standard deviation [Hz]."""


@dataclass(frozen=True)
class Track(EvenFlight):
    """One flight at ticks, ready to be compared with the model.

    Its channels are accel, gyro, rotor_command (speeds asked for), rotor_speed and voltage.
    """

    name: str
    pose_t: Array
    """(M,) stamps of the poses [s]."""
    pose: Array
    """(M, 7) as measured."""
    arrival: Array
    """(M,) latency arrival - stamp [s], or (0,)."""
    fast: Kernel
    slow: Kernel
    fast_rows: Mask
    """Rows of the fast kernel that count."""
    slow_rows: Mask
    pose_rows: Mask
    log: Flight
    swing: Swing | None = None
    """Of the air, that is simulated along it."""

    @property
    def command(self) -> Array:
        """(N, 4) rotor speeds asked for [rad/s]; (0, 4): not known."""
        return self.channels["rotor_command"]

    @property
    def speed(self) -> Array:
        """(N, 8) measured rotor speeds and slopes, or (0, 8)."""
        return self.channels["rotor_speed"]

    @property
    def voltage(self) -> Array:
        """(N, 1) or (0, 1)."""
        return self.channels["voltage"]

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

    def kernel(self, group: str) -> Kernel:
        """Return the kernel of a group (fast, slow), with its rows that count."""
        return self.fast_kernel if group == "fast" else self.slow_kernel

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
    fast = gaussian(t, IMU_WIDTH, FAST_SPACING)
    slow = gaussian(t, POSE_WIDTH, SLOW_SPACING)
    channels = {}
    for name in ("accel", "gyro", "rotor_speed", "voltage"):
        channels[name], gaps = _sampled(log, name, t)
        invalid |= gaps
    speed = channels["rotor_speed"]
    if speed.size:
        slopes = np.gradient(speed, TICK, axis=0)
        channels["rotor_speed"] = np.column_stack([speed, slopes])
    channels["rotor_command"] = _command(log, t)
    slow_rows = clear_rows(slow, invalid)
    used_s = np.count_nonzero(slow_rows) * SLOW_SPACING
    if used_s < SHORTEST_S:
        raise InputError(
            f"flight '{log.name}': {used_s:.1f} s are left when what is invalid is set apart; "
            f"accepted: at least {SHORTEST_S:g} s"
        )
    counted = np.interp(pose_t, t, invalid.astype(np.float64)) < 0.5
    return Track(
        t, channels, ~invalid, log.name, pose_t, pose, late, fast, slow,
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
    values = resample(Series(stamps, values), t)
    if name == "voltage":
        return values, np.zeros(t.size, np.bool_)
    beside = (t < stamps[0]) | (t > stamps[-1])
    return values, inside(t, _gaps(stamps, longest)) | beside


def _command(log: Flight, t: Array) -> Array:
    stamps, values = _good(log, "rotor_command", 4)
    return held_means(t, stamps + _TRANSPORT, values) if stamps.size else values


def _good(log: Flight, name: str, width: int) -> tuple[Array, Array]:
    """Return the finite samples of a channel whose stamps rise; none of one with too few."""
    series = log.series.get(name)
    if series is None or series.t.size < 10:
        return np.zeros(0), np.zeros((0, width))
    good = np.isfinite(series.values).all(axis=1) & np.isfinite(series.t)
    good[1:] &= np.diff(series.t) > 0.0
    return series.t[good], series.values[good]


def _gaps(stamps: Array, longest: float) -> list[Span]:
    starts = np.flatnonzero(np.diff(stamps) > longest)
    return [(float(stamps[i]), float(stamps[i + 1])) for i in starts]
