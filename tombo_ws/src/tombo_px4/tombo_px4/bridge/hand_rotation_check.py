"""Check by turning the vehicle by hand: axes of the mocap body, handedness, delay of stamps.

At rest gravity tells which way is up and nothing else. While the vehicle is turned, the gyro says
about which axis and when; the poses must say the same. Signed exchanges of axes are tried against
each other, and delays.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import conjugate, quaternion_multiply

_WINDOW_NS = 8_000_000_000
_SPAN_NS = 90_000_000
"""Rotations are compared over this time; between two frames the noise of poses is larger."""
_GAP_NS = 250_000_000
_TURNING = 0.3
"""[rad/s]: slower counts as rest."""
_ENOUGH = 1.0
"""[rad] turned in all."""
_EARLIEST, _LATEST, _COARSE, _FINE = -0.06, 0.3, 0.03, 0.005
_AGREES = 0.25
"""Share of the rotation that may stay unexplained."""
_CLEARER = 0.5
"""Another reading of the axes must leave less than this share of what the plain one leaves."""
_NAMES = "xyz"
_INVERSE = (
    "mocap attitude is the inverse: it turns map into base_link; let the driver send the rotation"
    " from base_link to map (w, or x, y and z with the other sign)"
)
_UNEXPLAINED = (
    "poses turn otherwise than PX4's gyro: is the tracked body this vehicle, are its markers"
    " fixed, do stamps and poses belong together?"
)


@dataclass(frozen=True)
class Verdict:
    """Result of the check."""

    delay_s: float
    """Poses show the vehicle as it was so long before their stamps."""
    mistake: str
    """What is wrong with the axes, in words; "" if nothing is."""
    sure: bool = True
    """False: they turn otherwise, and no known mistake explains how."""


class MotionCheck:
    """Collects rotations of gyro and poses; `judge` compares them."""

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Array]] = deque(maxlen=2000)
        self._gyro: deque[tuple[int, Array]] = deque(maxlen=2000)
        self.verdict: Verdict | None = None
        """The last one; None as long as the vehicle was not turned."""

    def pose(self, stamp_ns: int, attitude: Array) -> None:
        """Take the attitude (4) xyzw of a pose."""
        self._poses.append((stamp_ns, attitude))

    def gyro(self, stamp_ns: int, rates: Array) -> None:
        """Take body rates (3) [rad/s]; stamps of one clock with the poses'."""
        if self._gyro and stamp_ns <= self._gyro[-1][0]:
            return
        self._gyro.append((stamp_ns, rates))

    def reset(self) -> None:
        """Forget all samples."""
        self._poses.clear()
        self._gyro.clear()
        self.verdict = None

    def judge(self, now_ns: int) -> Verdict | None:
        """Compare the last seconds; return the newest verdict."""
        self.verdict = self._compare(now_ns) or self.verdict
        return self.verdict

    def _compare(self, now_ns: int) -> Verdict | None:
        gyro = [g for g in self._gyro if now_ns - g[0] < _WINDOW_NS]
        poses = [p for p in self._poses if now_ns - p[0] < _WINDOW_NS]
        if len(gyro) < 50 or len(poses) < 20:
            return None
        begin_ns = gyro[0][0]
        times = np.array([(t - begin_ns) * 1e-9 for t, _ in gyro])
        rates = np.array([g for _, g in gyro])
        steps = np.diff(times)
        speed = np.linalg.norm(rates[1:], axis=1)
        if float((speed * steps)[speed > _TURNING].sum()) < _ENOUGH:
            return None
        parts = 0.5 * (rates[1:] + rates[:-1]) * steps[:, None]
        turned = np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])
        spans = _spans(poses, begin_ns)
        if spans is None:
            return None
        best = _best(times, turned, *spans)
        if best.left <= _AGREES:
            return Verdict(best.delay, _explain(best.axes))
        inverse = _spans([(t, conjugate(q)) for t, q in poses], begin_ns)
        if inverse is not None and _best(times, turned, *inverse).left <= _AGREES:
            return Verdict(best.delay, _INVERSE)
        return Verdict(math.nan, _UNEXPLAINED, sure=False)


class _Fit(NamedTuple):
    left: float
    """Share of the turning that stays unexplained."""
    delay: float
    axes: Array


def _best(times: Array, turned: Array, first: Array, last: Array, seen: Array) -> _Fit:
    """Return the delay and the reading of the axes that explain most."""
    best = _Fit(math.inf, 0.0, np.eye(3))
    delays = [*np.arange(_EARLIEST, _LATEST, _COARSE)]
    for step in (_COARSE, _FINE):
        for delay in delays:
            left, axes = _misfit(times, turned, first - delay, last - delay, seen)
            if left < best.left:
                best = _Fit(left, float(delay), axes)
        delays = [best.delay + d for d in np.arange(-step, step, _FINE)]
    return best


def _spans(poses: list[tuple[int, Array]], begin_ns: int) -> tuple[Array, Array, Array] | None:
    """Return begin, end [s] and turn (N, 3) [rad, body] between poses a span apart."""
    first, last, before, after = [], [], [], []
    early = 0
    for stamp, attitude in poses:
        while early + 1 < len(poses) and stamp - poses[early + 1][0] >= _SPAN_NS:
            early += 1
        if not _SPAN_NS <= stamp - poses[early][0] <= _GAP_NS:
            continue
        first.append((poses[early][0] - begin_ns) * 1e-9)
        last.append((stamp - begin_ns) * 1e-9)
        before.append(poses[early][1])
        after.append(attitude)
    if len(first) < 20:
        return None
    turn = quaternion_multiply(conjugate(np.array(before)), np.array(after))
    turn = np.where(turn[:, 3:] < 0.0, -turn, turn)
    sine = np.linalg.norm(turn[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, turn[:, 3:])
    vector = turn[:, :3] * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0)
    return np.array(first), np.array(last), vector


def _misfit(
    times: Array, turned: Array, first: Array, last: Array, seen: Array
) -> tuple[float, Array]:
    """Return the share of the turning that no reading of the axes explains, and the best one.

    The plain reading stands unless another one explains much more.
    """
    inside = (first >= times[0]) & (last <= times[-1])
    if inside.sum() < 20:
        return math.inf, np.eye(3)
    first, last, seen = first[inside], last[inside], seen[inside]
    both = [(np.interp(last, times, w), np.interp(first, times, w)) for w in turned.T]
    felt = np.stack([end - begin for end, begin in both], axis=1)
    total = float((felt**2).sum())
    if total <= 0.0:
        return math.inf, np.eye(3)
    # the sum of squares of `seen - felt @ axes.T` for each reading, from one 3x3 matrix
    common = float((seen**2).sum()) + total
    left = (common - 2.0 * (_FLAT @ (seen.T @ felt).ravel())) / total
    k = int(np.argmin(left))
    if left[k] > _CLEARER * left[0]:
        k = 0
    return float(left[k]), _READINGS[k]


def _readings() -> list[Array]:
    """Return all 48 signed exchanges of axes, the plain one first, then the likeliest."""
    found = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]
    # few changes before many, turns before mirrors
    return sorted(found, key=lambda a: (-float(np.trace(a)), -round(float(np.linalg.det(a)))))


_READINGS = _readings()
_FLAT = np.array([axes.ravel() for axes in _READINGS])


def _explain(axes: Array) -> str:
    if np.array_equal(axes, np.eye(3)):
        return ""
    reads = []
    for column in range(3):
        row = int(np.argmax(np.abs(axes[:, column])))
        sign = "-" if axes[row, column] < 0.0 else ""
        if sign or row != column:
            reads.append(f"{_NAMES[column]} as {sign}{_NAMES[row]}")
    changed = ", ".join(reads)
    # turning is an axial vector: a mirror turns it round, and z with it, though z stays up
    if np.linalg.det(axes) < 0.0 or axes[2, 2] < 0.0:
        return (
            f"mocap attitude is mirrored: turning shows about {changed}; left-handed axes, or a"
            " sign lost on the way: let the driver send right-handed ENU and FLU"
        )
    return (
        f"axes of the mocap body are not the autopilot's: turning shows about {changed}; define"
        " the rigid body with x to the nose and z up (Motive streams Y-up by default)"
    )
