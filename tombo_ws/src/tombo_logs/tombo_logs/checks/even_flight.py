"""A flight on an even clock: how its channels are resampled, smoothed and differentiated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from tombo_bag.flight import Series
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply, unwrap_quaternions
from tombo_dynamics.vehicle import GRAVITY
from tombo_logs.checks.clocks.stamps import gap_spans
from tombo_logs.checks.spans import Mask, Span, check_extent, inside, interpolated, sample_interval
from tombo_logs.readers.frames import is_usable

# Standard deviations of the Gaussians that channels pass, one for each purpose [s].
POSE_WIDTH: Final = 0.055
"""Poses and IMU: up to about 2.4 Hz, where 30 Hz poses give accelerations."""
IMU_WIDTH: Final = 0.015
"""IMU and rotors against a model: up to about 9 Hz."""
CROSSOVER_WIDTH: Final = 0.1
"""Motion that is quicker is the IMU's, slower motion that of the poses."""
EVENT_WIDTH: Final = 0.02
"""Rates and drives in which events are looked for."""
PUSH_WIDTH: Final = 0.008
"""An accelerometer in which pushes are looked for: they must keep their time."""
INERTIAL_WIDTH: Final = 0.01
"""IMU and commands where poses are missing."""

RATE: Final = 50.0
"""Rate of the clock on which poses and IMU are compared [Hz]."""
INDEPENDENT: Final = RATE * POSE_WIDTH * 2.0 * np.sqrt(np.pi)
"""Rows of that clock for each independent one, behind `POSE_WIDTH`."""
_REACH: Final = 4.0
"""Half length of a Gaussian, in widths."""
_ABSENT: Final = np.zeros((0, 3))
_LEAST_COMPARED: Final = 100
"""Rows."""


@dataclass(frozen=True)
class EvenFlight:
    """Channels of one flight on an even clock."""

    t: Array
    """(N,) s"""
    channels: Mapping[str, Array]
    """Name → (N, k); a channel that the log lacks is absent, or (0, k)."""
    valid: Mask
    """(N,) rows that count."""

    @property
    def step(self) -> float:
        """Period of the clock [s]."""
        return float(self.t[1] - self.t[0])

    @property
    def gyro(self) -> Array:
        """(N, 3) rad/s, or (0, 3)."""
        return self.channels.get("gyro", _ABSENT)

    @property
    def accel(self) -> Array:
        """(N, 3) m/s^2, or (0, 3)."""
        return self.channels.get("accel", _ABSENT)

    @property
    def attitude(self) -> Array:
        """(N, 4) xyzw, map from base_link."""
        return self.channels["attitude"]

    @property
    def up(self) -> Array:
        """(N, 3) body z axis in map."""
        return np.asarray(Rotation.from_quat(self.attitude).apply([0.0, 0.0, 1.0]))

    @property
    def rates(self) -> Array:
        """(N, 3) body rates [rad/s]."""
        return self.channels["rates"]

    @property
    def force_of_poses(self) -> Array:
        """(N, 3) specific force that the poses give, in base_link [m/s^2]."""
        force = self.acceleration + np.array([0.0, 0.0, GRAVITY])
        return np.asarray(Rotation.from_quat(self.attitude).inv().apply(force))

    @property
    def accel_in_map(self) -> Array:
        """(N, 3) the accelerometer's reading, turned into map by the attitude [m/s^2]."""
        return np.asarray(Rotation.from_quat(self.attitude).apply(self.accel))

    def is_compared(self, channel: Array) -> bool:
        """Return whether the log has a channel (N, k), and enough rows to compare it."""
        return bool(channel.size) and np.count_nonzero(self.valid) >= _LEAST_COMPARED

    @property
    def acceleration(self) -> Array:
        """(N, 3) of the position, in map [m/s^2]."""
        return self.channels["acceleration"]


def even_times(begin: float, end: float, rate: float) -> Array:
    """Return times (N,) from `begin` on, before `end` [s], at a rate [Hz].

    Raises:
        InputError: they would be more than those of one flight.
    """
    check_extent(begin, end, rate)
    return np.asarray(begin + np.arange(max(int((end - begin) * rate), 0)) / rate)


def resample(series: Series, t: Array) -> Array:
    """Return values (N, k) at times `t` (N,) of an even clock.

    They are means over a step of the clock where the channel is as fast as that, else they are on
    straight lines. Beside the channel's ends they are the first and the last value.
    """
    stamps, values = series.t, series.values
    lines = interpolated(t, stamps, values)
    if t.size < 2 or stamps.size < 2 or np.median(np.diff(stamps)) >= t[1] - t[0]:
        return lines
    half = 0.5 * float(t[1] - t[0])
    edges = np.concatenate([t - half, [t[-1] + half]])
    area = interpolated(edges, stamps, cumulative_trapezoid(values, stamps, axis=0, initial=0.0))
    covered = np.maximum(np.diff(np.clip(edges, stamps[0], stamps[-1])), 1e-9)
    outside = (t < stamps[0]) | (t > stamps[-1])
    means = np.diff(area, axis=0) / covered[:, None]
    return np.asarray(np.where(outside[:, None], lines, means))


def held_values(t: Array, stamps: Array, values: Array) -> Array:
    """Return (N, k): at times `t` (N,) the last of values (M, k), each from its stamp (M,) on."""
    rows = np.clip(np.searchsorted(stamps, t, side="right") - 1, 0, stamps.size - 1)
    return np.asarray(values[rows])


def held_means(t: Array, stamps: Array, values: Array) -> Array:
    """Return (N, k): means from each time of an even clock to the next of values that hold.

    `stamps` (M,) rise, `values` are (M, k).
    """
    step = float(t[1] - t[0])
    edges = np.concatenate([t, [t[-1] + step]])
    areas = np.vstack(
        [np.zeros(values.shape[1]), np.cumsum(values[:-1] * np.diff(stamps)[:, None], 0)]
    )
    row = np.clip(np.searchsorted(stamps, edges, side="right") - 1, 0, stamps.size - 1)
    area = areas[row] + values[row] * (edges - stamps[row])[:, None]
    return np.asarray(np.diff(area, axis=0) / step)


def smooth(values: Array, width: float, step: float, order: int = 0) -> Array:
    """Return rows (N, ...) each `step` [s] behind a Gaussian, or their derivative of an order.

    `width`: standard deviation of the Gaussian [s].
    """
    passed = gaussian_filter1d(values, width / step, axis=0, order=order)
    return np.asarray(passed / step**order)


def clear_of(invalid: Mask, width: float, step: float) -> Mask:
    """Return rows that no invalid row reaches through a Gaussian, nor an end of the clock."""
    reached = smooth(invalid.astype(np.float64), width, step) > 1e-9
    reach = int(np.ceil(_REACH * width / step))
    reached[:reach] = reached[invalid.size - reach :] = True
    return np.asarray(~reached)


def known_at(series: Series, t: Array, within: float) -> Mask:
    """Return the times (N,) that have a sample within a time [s], or within two usual steps."""
    after = np.clip(np.searchsorted(series.t, t), 1, series.t.size - 1)
    near = np.minimum(np.abs(series.t[after] - t), np.abs(t - series.t[after - 1]))
    return np.asarray(near < max(within, 2.0 * sample_interval(series.t)))


def usable_turns(attitude: Series) -> Series:
    """Return the attitudes that can be used, with the sign of the one before."""
    turns = attitude.at(is_usable(attitude.values))
    return replace(turns, values=unwrap_quaternions(turns.values))


def unit_rows(q: Array) -> Array:
    """Return rows of norm 1."""
    return np.asarray(q / np.maximum(np.linalg.norm(q, axis=1, keepdims=True), 1e-9))


def turns_at(attitude: Series, t: Array) -> Rotation:
    """Return the attitudes at times (N,), of usable ones (`usable_turns`)."""
    return Rotation.from_quat(unit_rows(interpolated(t, attitude.t, attitude.values)))


def body_rates(q: Array, slope: Array) -> Array:
    """Return (N, 3) [rad/s] of attitudes (N, 4) and their derivative."""
    return np.asarray(2.0 * quaternion_multiply(conjugate(q), slope)[:, :3])


def accelerations(position: Series, t: Array) -> Array:
    """Return the acceleration of a track (N, 3) at times of an even clock, behind `POSE_WIDTH`."""
    return smooth(resample(position, t), POSE_WIDTH, float(t[1] - t[0]), order=2)


def beside_poses(series: Series, t: Array) -> Array:
    """Return a channel (N, k) at times of an even clock, behind the Gaussian of the poses."""
    return smooth(resample(series, t), POSE_WIDTH, float(t[1] - t[0]))


def poses_and_imu(
    position: Series, attitude: Series, gyro: Series | None, accel: Series | None,
    exclude: list[Span],
) -> EvenFlight:  # fmt: skip
    """Lay cleaned poses and IMU on one clock of `RATE`, smoothed alike, for comparison.

    Rates are those of the attitude. A row is valid where no gap, no excluded span and no end of a
    channel is within the reach of the Gaussian.
    """
    begin = max(position.t[0], attitude.t[0])
    t = even_times(begin, min(position.t[-1], attitude.t[-1]), RATE)
    if t.size < 25:
        none = dict.fromkeys(("rates", "acceleration", "gyro", "accel"), _ABSENT)
        return EvenFlight(t[:0], {**none, "attitude": np.zeros((0, 4))}, t[:0] > 0.0)
    invalid = inside(t, exclude)
    for series in (position, attitude, gyro, accel):
        if series is not None:
            invalid |= inside(t, gap_spans(series.t))
            invalid |= (t < series.t[0]) | (t > series.t[-1])
    q = unit_rows(resample(usable_turns(attitude), t))
    turned = unit_rows(smooth(q, POSE_WIDTH, 1.0 / RATE))
    channels = {
        "attitude": turned,
        "rates": body_rates(turned, smooth(q, POSE_WIDTH, 1.0 / RATE, order=1)),
        "acceleration": accelerations(position, t),
    }
    imu = {"gyro": gyro, "accel": accel}
    channels |= {name: beside_poses(each, t) for name, each in imu.items() if each is not None}
    return EvenFlight(t, channels, clear_of(invalid, POSE_WIDTH, 1.0 / RATE))
