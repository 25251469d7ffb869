"""Motion of the poses against the motion that PX4's gyro and accelerometer imply.

Both are compared over spans. A rotation is the integral of the gyro over a span. The second
difference of positions over a span is the acceleration, weighted by a triangle: no velocity is
needed, and no integration drifts. The proof of the axes by hand and the checks in flight use the
same comparison.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from tombo_dynamics.arrays import Array
from tombo_dynamics.time_base import SECOND_NS

GRID_S = 0.02
"""Step of the grid on which second differences are taken [s]."""
_HALF = 12
"""Half a span, in steps of the grid: a slow drift shows there, too."""
SPAN_S = 2 * _HALF * GRID_S
"""Length of a span, 0.48 s [s]; samples within a span are not independent."""
_ROTATION_SPAN_S = 0.09
"""Rotations are compared over this time; between two frames the noise of poses is larger [s]."""
_MAX_POSE_GAP_S = 0.1
"""Spans with a longer gap between two poses are left out [s]."""
_MAX_ROTATION_GAP_S = 0.25
_MIN_SPANS = 20
_EARLIEST_S, _LATEST_S, _COARSE_S, _FINE_S = -0.06, 0.3, 0.03, 0.005
"""Delays of the stamps that are tried [s]."""

_TIMES = [("stamp_ns", "i8"), ("arrival_ns", "i8")]
POSE = np.dtype([*_TIMES, ("position", "f8", 3), ("attitude", "f8", 4)])
"""A pose of the motion capture that was sent, or PX4's estimate of it: map, base_link."""
IMU = np.dtype(
    [*_TIMES, ("gyro", "f8", 3), ("accel", "f8", 3), ("force", "f8", 3), ("altitude", "f8"),
     ("airborne", "?")]
)  # fmt: skip
"""Rates [rad/s] and specific force [m/s^2] in base_link; the force in map by PX4's attitude.
Height of the barometer [m]; PX4 calls the vehicle airborne."""


class Samples:
    """The newest samples of one kind, with growing stamps."""

    def __init__(self, kind: np.dtype[Any], most: int) -> None:
        self._most = most
        self._rows = np.empty(2 * most, kind)
        self._end = 0

    def add(self, stamp_ns: int, *values: object) -> bool:
        """Add a sample; False: its stamp is not new. A clock that was set back begins anew."""
        ahead_ns = stamp_ns - self._rows["stamp_ns"][self._end - 1] if self._end else 1
        if -SECOND_NS < ahead_ns <= 0:
            return False
        if ahead_ns <= 0:
            self.clear()
        if self._end == len(self._rows):
            self._end = self._most
            self._rows[: self._end] = self._rows[self._end :]
        self._rows[self._end] = (stamp_ns, *values)
        self._end += 1
        return True

    @property
    def newest(self) -> Any | None:
        """The last sample; None: there is none."""
        return self._rows[self._end - 1] if self._end else None

    def last(self, count: int) -> Any:
        """Return the newest samples."""
        return self._rows[max(self._end - count, 0) : self._end]

    def since(self, time_ns: int, clock: str = "stamp_ns") -> Any:
        """Return the samples later than a time, of their stamps or of another column."""
        rows = self._rows[: self._end]
        return rows[np.searchsorted(rows[clock], time_ns, side="right") :]

    def clear(self) -> None:
        """Forget all samples."""
        self._end = 0


class MotionSums(NamedTuple):
    """Regression of the motion of the poses on the motion that the IMU implies.

    Level motion is a complex number, so that a product with the conjugate is a turn, and one
    without it a turn after a mirror; heights add to both. The slope is 1 for poses of this
    vehicle, and 0 for a body that does not move with it. It is 1.5 for positions 1.5 times too
    large. Noise of the poses widens its error, it does not move the slope.

    Attributes:
        time_s: time of motion [s].
        imu_square, pose_square: sums of squares of both motions.
        product, mirrored: sums of the products.
    """

    time_s: float
    imu_square: float
    pose_square: float
    product: complex
    mirrored: complex

    def coherence(self, product: complex) -> float:
        """Return the share of both motions that one of the products explains."""
        return abs(product) ** 2 / max(self.imu_square * self.pose_square, 1e-18)

    @property
    def slope(self) -> float:
        """Motion of the poses over that of the IMU."""
        return self.product.real / max(self.imu_square, 1e-18)

    @property
    def error(self) -> float:
        """Three standard errors of the slope."""
        rest = max(self.pose_square - self.slope * self.product.real, 0.0)
        count = max(self.time_s / SPAN_S, 1.0)
        return 3.0 * math.sqrt(rest / max(self.imu_square, 1e-18) / count)


def sum_motion(seen: Array, felt: Array, weight_s: Array) -> MotionSums:
    """Return the regression of motion (M, 3) of the poses on that of the IMU.

    Args:
        seen: of the poses.
        felt: of the IMU.
        weight_s: (M) time of each sample [s]; 0 leaves it out.
    """
    level, level_felt = (v[:, 0] + 1j * v[:, 1] for v in (seen, felt))
    up = seen[:, 2] * felt[:, 2]
    return MotionSums(
        float(weight_s.sum()),
        float(weight_s @ (felt**2).sum(axis=1)),
        float(weight_s @ (seen**2).sum(axis=1)),
        complex(weight_s @ (level_felt.conj() * level + up)),
        complex(weight_s @ (level_felt * level + up)),
    )


def second_differences(
    times: Array,
    position: Array,
    felt_times: Array,
    acceleration: Array,
    strikes: Array | None = None,
) -> tuple[Array, Array, Array]:
    """Return second differences of positions, measured and by the accelerations.

    Args:
        times: (N) of the positions [s], growing.
        position: (N, 3) [m].
        felt_times: (K) of the accelerations [s], growing.
        acceleration: (K, 3) [m/s^2], in the same frame.
        strikes: times [s] whose acceleration can't be used.

    Returns:
        (M, 3) and (M, 3) [m], and the ends (M) [s] of the spans; those with a gap are left out.
    """
    latest, earliest = min(times[-1], felt_times[-1]), max(times[0], felt_times[0])
    grid = np.arange(latest, earliest, -GRID_S)[::-1]
    half = _HALF
    if len(grid) <= 2 * half:
        return np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0)
    place = np.stack([np.interp(grid, times, p) for p in position.T], axis=1)
    push = _cell_means(grid, felt_times, acceleration)
    weights = half - np.abs(np.arange(-half + 1, half))
    seen = place[2 * half :] - 2.0 * place[half:-half] + place[: -2 * half]
    felt = np.stack([np.convolve(a[1:-1], weights, "valid") for a in push.T], axis=1)
    felt *= GRID_S**2
    after = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    broken = (times[after] - times[after - 1] > _MAX_POSE_GAP_S).astype(float)
    if strikes is not None:
        broken[np.clip(np.searchsorted(grid, strikes), 0, len(grid) - 1)] = 1.0
    whole = np.convolve(broken, np.ones(2 * half + 1), "valid") < 0.5
    return seen[whole], felt[whole], grid[2 * half :][whole]


def _cell_means(grid: Array, times: Array, values: Array) -> Array:
    """Return the means (M, 3) of values over the cells around the points of a grid."""
    whole = integrate(times, values)
    begin = np.maximum(grid - 0.5 * GRID_S, times[0])
    end = np.minimum(grid + 0.5 * GRID_S, times[-1])
    both = [np.interp(end, times, w) - np.interp(begin, times, w) for w in whole.T]
    mean: Array = np.stack(both, axis=1) / np.maximum(end - begin, 1e-3)[:, None]
    return mean


def integrate(times: Array, values: Array) -> Array:
    """Return the integral (N, 3) of values (N, 3) at times (N) [s], by trapezoids."""
    parts = 0.5 * (values[1:] + values[:-1]) * np.diff(times)[:, None]
    return np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])


TurnSpans = tuple[Array, Array, Array]
"""Begin (M) and end (M) [s] of short spans, and how far the poses turn in them (M, 3) [rad]."""


def rotation_spans(times: Array, attitude: Array) -> TurnSpans:
    """Return the rotations between poses a span apart: times (N) [s], attitude (N, 4) xyzw."""
    early = np.searchsorted(times, times - _ROTATION_SPAN_S, side="right") - 1
    late = np.arange(len(times))
    use = (early >= 0) & (times - times[np.maximum(early, 0)] <= _MAX_ROTATION_GAP_S)
    early, late = early[use], late[use]
    earlier, later = (Rotation.from_quat(attitude[rows]) for rows in (early, late))
    return times[early], times[late], (earlier.inv() * later).as_rotvec()


class AxesFit(NamedTuple):
    """How rotations of the poses follow from those of the gyro: `poses = axes @ gyro`."""

    left: float
    """Share of the turning that stays unexplained; infinite: there are too few rotations."""
    delay_s: float
    axes: Array


_NO_FIT = AxesFit(math.inf, 0.0, np.eye(3))


def fit_axes(gyro_times: Array, rates: Array, times: Array, attitude: Array) -> AxesFit:
    """Return the delay and the axes by which the gyro explains most of the poses' rotations.

    Args:
        gyro_times: (K) of the gyro [s], growing.
        rates: (K, 3) [rad/s], turns about each axis.
        times: (N) of the poses [s], growing.
        attitude: (N, 4) xyzw.
    """
    turned = integrate(gyro_times, rates)
    spans = rotation_spans(times, attitude)
    best = _NO_FIT
    delays: list[float] = np.arange(_EARLIEST_S, _LATEST_S, _COARSE_S).tolist()
    for step in (_COARSE_S, _FINE_S):
        fits = [_fit_at(gyro_times, turned, spans, delay) for delay in delays]
        best = min([best, *fits], key=lambda fit: fit.left)
        delays = (best.delay_s + np.arange(-step, step, _FINE_S)).tolist()
    return best


def _fit_at(times: Array, turned: Array, spans: TurnSpans, delay: float) -> AxesFit:
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
    left_, _, right = np.linalg.svd(matrix)
    handed = np.array([1.0, 1.0, np.linalg.det(left_ @ right)])
    axes: Array = (left_ * handed) @ right
    return AxesFit((common - 2.0 * float((axes * matrix).sum())) / total, delay, axes)
