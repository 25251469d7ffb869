"""Motion of the poses against the motion that PX4's gyro and accelerometer imply.

Both are compared over spans. A rotation is the integral of the gyro over a span. The second
difference of positions over a span is the acceleration, weighted by a triangle: no velocity is
needed, and no integration drifts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply

GRID_S = 0.02
"""Step of the grid on which second differences are taken [s]."""
SHORT_HALF = 8
"""Half a span, in steps of the grid: 0.16 s."""
LONG_HALF = 20
"""Half a long span, 0.4 s: a slow drift shows there."""
_MAX_POSE_GAP_S = 0.1
"""Spans with a longer gap between two poses are left out [s]."""
_ROTATION_SPAN_NS = 90_000_000
"""Rotations are compared over this time; between two frames the noise of poses is larger."""
_MAX_ROTATION_GAP_NS = 250_000_000
_MIN_SPANS = 20
_EARLIEST_S, _LATEST_S, _COARSE_S, _FINE_S = -0.06, 0.3, 0.03, 0.005
"""Delays of the stamps that are tried [s]."""


def second_differences(
    times: Array, position: Array, felt_times: Array, acceleration: Array, half: int = SHORT_HALF
) -> tuple[Array, Array]:
    """Return second differences of positions, measured and by the accelerations.

    Args:
        times: (N) of the positions [s], growing.
        position: (N, 3) [m].
        felt_times: (K) of the accelerations [s], growing.
        acceleration: (K, 3) [m/s^2], in the same frame.
        half: steps of 0.02 s in half a span.

    Returns:
        (M, 3) and (M, 3) [m], over spans without a gap.
    """
    grid = np.arange(times[-1], max(times[0], felt_times[0]), -GRID_S)[::-1]
    if len(grid) <= 2 * half:
        return np.zeros((0, 3)), np.zeros((0, 3))
    place = np.stack([np.interp(grid, times, p) for p in position.T], axis=1)
    push = _cell_means(grid, felt_times, acceleration)
    weights = half - np.abs(np.arange(-half + 1, half))
    seen = place[2 * half :] - 2.0 * place[half:-half] + place[: -2 * half]
    felt = np.stack([np.convolve(a[1:-1], weights, "valid") for a in push.T], axis=1)
    felt *= GRID_S**2
    after = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    gaps = (times[after] - times[after - 1] > _MAX_POSE_GAP_S).astype(float)
    whole = np.convolve(gaps, np.ones(2 * half + 1), "valid") < 0.5
    return seen[whole], felt[whole]


def _cell_means(grid: Array, times: Array, values: Array) -> Array:
    """Return the means (M, 3) of values over the cells around the points of a grid."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(times)[:, None]
    whole = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    begin = np.maximum(grid - 0.5 * GRID_S, times[0])
    end = np.minimum(grid + 0.5 * GRID_S, times[-1])
    both = [np.interp(end, times, w) - np.interp(begin, times, w) for w in whole.T]
    mean: Array = np.stack(both, axis=1) / np.maximum(end - begin, 1e-3)[:, None]
    return mean


TurnSpans = tuple[Array, Array, Array]
"""Begin (M) and end (M) [s] of short spans, and how far the poses turn in them (M, 3) [rad]."""


def rotation_spans(stamps: Array, attitude: Array, begin_ns: int) -> TurnSpans:
    """Return the rotations between poses a span apart.

    Args:
        stamps: (N) of the poses [ns], growing.
        attitude: (N, 4) xyzw.
        begin_ns: zero of the times that are returned.
    """
    early = np.searchsorted(stamps, stamps - _ROTATION_SPAN_NS, side="right") - 1
    late = np.arange(len(stamps))
    apart = stamps - stamps[np.maximum(early, 0)]
    use = (early >= 0) & (apart >= _ROTATION_SPAN_NS) & (apart <= _MAX_ROTATION_GAP_NS)
    early, late = early[use], late[use]
    turn = quaternion_multiply(conjugate(attitude[early]), attitude[late])
    turn = np.where(turn[:, 3:] < 0.0, -turn, turn)
    sine = np.linalg.norm(turn[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, turn[:, 3:])
    vector = turn[:, :3] * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0)
    seconds = (stamps - begin_ns) * 1e-9
    return seconds[early], seconds[late], vector


def integrate(times: Array, rates: Array) -> Array:
    """Return the integral (N, 3) [rad] of body rates (N, 3) [rad/s] at times (N) [s]."""
    parts = 0.5 * (rates[1:] + rates[:-1]) * np.diff(times)[:, None]
    return np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])


class AxesFit(NamedTuple):
    """How rotations of the poses follow from those of the gyro: `seen = axes @ felt`."""

    left: float
    """Share of the turning that stays unexplained."""
    delay_s: float
    axes: Array
    felt: Array
    """(M, 3) of the gyro [rad]."""
    seen: Array
    """(M, 3) of the poses [rad]."""


_NO_FIT = AxesFit(math.inf, 0.0, np.eye(3), np.zeros((0, 3)), np.zeros((0, 3)))


def fit_axes(
    imu_stamps: Array, rates: Array, stamps: Array, attitude: Array, any_axes: bool
) -> AxesFit:
    """Return the delay and the axes by which the gyro explains most of the poses' rotations.

    Args:
        imu_stamps: (K) of the gyro [ns], growing.
        rates: (K, 3) [rad/s].
        stamps: (N) of the poses [ns], growing.
        attitude: (N, 4) xyzw.
        any_axes: any rotation between the axes is looked for, which takes turns about each axis;
            else the axes are the autopilot's.
    """
    begin_ns = imu_stamps[0]
    times = (imu_stamps - begin_ns) * 1e-9
    turned = integrate(times, rates)
    spans = rotation_spans(stamps, attitude, begin_ns)
    best = _NO_FIT
    delays: list[float] = np.arange(_EARLIEST_S, _LATEST_S, _COARSE_S).tolist()
    for step in (_COARSE_S, _FINE_S):
        fits = [_fit_at(times, turned, spans, any_axes, delay) for delay in delays]
        best = min([best, *fits], key=lambda fit: fit.left)
        delays = (best.delay_s + np.arange(-step, step, _FINE_S)).tolist()
    return best


def _fit_at(
    times: Array, turned: Array, spans: TurnSpans, any_axes: bool, delay: float
) -> AxesFit:
    first, last, turn = spans[0] - delay, spans[1] - delay, spans[2]
    inside = (first >= times[0]) & (last <= times[-1])
    if inside.sum() < _MIN_SPANS:
        return _NO_FIT
    first, last, seen = first[inside], last[inside], turn[inside]
    felt = np.stack([np.interp(last, times, w) - np.interp(first, times, w) for w in turned.T], 1)
    total = float((felt**2).sum())
    if total <= 0.0:
        return _NO_FIT
    # the sum of squares of `seen - felt @ axes.T`, from one 3x3 matrix
    common, matrix = float((seen**2).sum()) + total, seen.T @ felt
    axes: Array = np.eye(3)
    if any_axes:
        left_, _, right = np.linalg.svd(matrix)
        handed = np.array([1.0, 1.0, np.linalg.det(left_ @ right)])
        axes = (left_ * handed) @ right
    left = (common - 2.0 * float((axes * matrix).sum())) / total
    return AxesFit(left, delay, axes, felt, seen)


@dataclass
class MotionSums:
    """Regression of the motion of the poses on the motion that the IMU implies.

    Level motion is a complex number, so that a product with the conjugate is a turn, and one
    without it a turn after a mirror; heights add to both. The slope is 1 for poses of this
    vehicle, and 0 for a body that does not move with it. It is 1.5 for positions 1.5 times too
    large. Noise of the poses widens its error, it does not move the slope.

    Attributes:
        span_s: length of a span [s]; samples within a span are not independent.
        least: smaller motion is noise, and left out.
        memory_s: time in which earlier spans fade [s].
        time_s: time of motion so far [s].
        felt, seen: sums of squares.
        product, mirrored: sums of the products.
    """

    span_s: float
    least: float = 0.0
    memory_s: float = math.inf
    time_s: float = 0.0
    felt: float = 0.0
    seen: float = 0.0
    product: complex = 0.0
    mirrored: complex = 0.0

    def add(self, felt: Array, seen: Array, step_s: float) -> None:
        """Add the newest span, both (3)."""
        (u, v, w), (x, y, z) = felt.tolist(), seen.tolist()
        felt2, seen2 = u * u + v * v + w * w, x * x + y * y + z * z
        if min(felt2, seen2) < self.least**2:
            return
        keep = math.exp(-step_s / self.memory_s)
        self.time_s = keep * self.time_s + step_s
        self.felt = keep * self.felt + step_s * felt2
        self.seen = keep * self.seen + step_s * seen2
        turn, mirror = complex(u, -v) * complex(x, y), complex(u, v) * complex(x, y)
        self.product = keep * self.product + step_s * (turn + w * z)
        self.mirrored = keep * self.mirrored + step_s * (mirror + w * z)

    def coherence(self, product: complex) -> float:
        """Return the share of both motions that one of the products explains."""
        return abs(product) ** 2 / max(self.felt * self.seen, 1e-18)

    @property
    def slope(self) -> float:
        """Motion of the poses over that of the IMU."""
        return self.product.real / max(self.felt, 1e-18)

    @property
    def error(self) -> float:
        """Three standard errors of the slope."""
        rest = max(self.seen - self.slope * self.product.real, 0.0)
        count = max(self.time_s / self.span_s, 1.0)
        return 3.0 * math.sqrt(rest / max(self.felt, 1e-18) / count)
