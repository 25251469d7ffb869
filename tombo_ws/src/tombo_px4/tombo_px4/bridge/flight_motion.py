"""Motion since the arming: that of the poses against that of PX4's sensors, and the velocity.

PX4's roll and pitch come from gravity. The acceleration by its attitude and accelerometer is
therefore right, except for the heading, which comes from the poses.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.pose_motion import GRID_S, SPAN_S, Samples, second_differences, sum_motion

_LEVEL, _UPWARD = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
"""Factors that leave the horizontal and the vertical part of a vector in map."""
_UP = GRAVITY * _UPWARD
"""Specific force at rest [m/s^2], map."""
_WINDOW_NS = 10 * SECOND_NS
"""Motion of this age counts: the check at take-off takes 8 s [ns]."""
_LEAST_M = 0.012
"""A smaller second difference is noise [m]: 0.2 m/s^2, a tilt of 1.2 deg."""
_LEVEL_LEAST_M_S2, _VERTICAL_LEAST_M_S2 = 0.8, 0.5
"""Accelerations that poses have to show [m/s^2]: three times PX4's errors of tilt (1.5 deg) and
of the accelerometer's bias in flight."""
_MEMORY_S = 1.0
"""Motion that poses have to show fades in this time: a body may be lost in flight [s]."""
_OFF_S = 1.0 / 7.0
"""Single poses with exchanged markers do not last [s]."""
DECIDES_S, COHERENT = 0.1, 0.6
"""Time of motion [s], and coherence, after which it tells about the axes."""
_STRIKE_M_S2, _STRIKE_RAD_S = 0.8 * GRAVITY, 3.0
"""Specific force this far from gravity, or change of rate between two samples: a strike, shorter
than the samples are apart."""
_REST_NS = SECOND_NS
"""Time before the arming in which the vehicle is at rest [ns]."""
_REST_STD_M_S2, _REST_RATE, _REST_OFF_M_S2 = 0.5, 0.15, 0.6
"""A vehicle at rest shows no more noise, rate [rad/s] and error of gravity."""
_FOLLOWS_S, _BRAKES_S = 1.0, 0.3
"""Time in which the velocity by the accelerometer follows that of the poses, where the motion has
shown their axes: an error of tilt by 1 deg then makes 0.17 m/s. The second while it brakes after a
mistake of axes: the direction is better known by then [s]."""
_VELOCITY_NS = 150_000_000
"""The velocity of the poses is that over this time [ns]."""
_BEFORE_NS = 2 * SECOND_NS
"""Poses of another body were followed for so long, at most, before it is known [ns]."""
_SHOWS_S, _SHOWS_COHERENT = 1.0, 0.25
"""Time [s] and coherence after which even weak motion shows a direction to brake by: over real
PX4 it then was right to 26 deg in ten of ten flights. It does not suffice to call axes wrong."""
_HEIGHT_WINDOW_NS, _HEIGHT_MEAN_NS = 5 * SECOND_NS, SECOND_NS // 3
"""Barometer and poses are compared over 5 s, each end a mean [ns]."""
FRESH_NS = SECOND_NS // 5
"""Older poses show no motion of now [ns]."""
_LONGEST_STEP_S = 0.05
"""Longest time over which a sample is integrated [s]: after a gap it is not known."""

_SCALE = (0.5 * SPAN_S) ** 2
"""Second difference over a span, for a constant acceleration of 1 m/s^2 [m]."""
_NOTHING = sum_motion(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))


class FlightMotion:
    """Compares, from the arming on, the motion of the poses with that of PX4's sensors.

    Attributes:
        confirmed: the motion has shown that the axes are right.
        level: level motion above the noise.
        weak: level motion, with the noise.
        recent: motion that poses have to show; earlier one fades.
        off_m, off_up_m: least distance between poses and accelerometer over a span in the last
            1/7 s [m], and upwards.
        climbed_m: motion of the barometer against the poses within 5 s [m].
        since_strike_s: time since the last strike [s].
    """

    def __init__(self, poses: Samples, imu: Samples) -> None:
        self._poses, self._imu = poses, imu
        self._begun_ns: int | None = None
        self._start()

    def _start(self) -> None:
        self._rest = _UP
        self.level = self.weak = self.recent = _NOTHING
        self.off_m = self.off_up_m = 0.0
        self.climbed_m, self.since_strike_s = 0.0, math.inf
        self.confirmed = False
        self._measured: Array = np.zeros(3)
        """Velocity by the accelerometer alone."""
        self._followed: Array = np.zeros(3)
        """Its corrections by the poses."""
        self._corrections: deque[tuple[int, Array]] = deque()
        """Stamps and `_followed`, lately."""
        self._by_poses: bool | None = None
        """After a mistake: it brakes by the poses, or by the accelerometer alone."""

    @property
    def velocity(self) -> Array:
        """Velocity (3) by the accelerometer since the arming, in PX4's map [m/s]."""
        return self._measured + self._followed

    @property
    def has_new_pose(self) -> bool:
        """The newest pose is recent against PX4's sensors."""
        pose, sample = self._poses.newest, self._imu.newest
        if pose is None or sample is None:
            return False
        return bool(sample["stamp_ns"] - pose["stamp_ns"] < FRESH_NS)

    def begin(self) -> None:
        """Begin with the arming: the accelerometer at rest shows its bias and PX4's tilt."""
        self._start()
        newest = self._imu.newest
        self._begun_ns = 0 if newest is None else int(newest["stamp_ns"])
        rest = self._imu.since(self._begun_ns - _REST_NS)
        if len(rest) < 8 or np.abs(rest["gyro"]).max() > _REST_RATE:
            return
        mean = rest["force"].mean(axis=0)
        off = float(np.linalg.norm(mean - _UP))
        if rest["force"].std(axis=0).max() < _REST_STD_M_S2 and off < _REST_OFF_M_S2:
            self._rest = mean

    def end(self) -> None:
        """End with the disarming."""
        self._begun_ns = None

    def accuse(self, by_poses: bool) -> None:
        """Take a mistake: brake by the poses, or as if they had not been followed lately."""
        self._by_poses = by_poses
        if by_poses:
            self.follow_poses()
        elif self._corrections:
            self._followed = self._corrections[0][1]

    def confirm(self) -> None:
        """Take the axes for right: the velocity is that of the poses."""
        self.confirmed = True
        self.follow_poses()

    def follow_poses(self) -> None:
        """Take over the velocity that the poses show."""
        shown = self._shown_velocity()
        if shown is not None:
            self._followed = shown - self._measured

    # --- Velocity -------------------------------------------------------------------------------

    def feel(self) -> None:
        """Follow the newest sample of PX4's sensors."""
        samples = self._imu.last(2)
        if self._begun_ns is None or len(samples) < 2:
            return
        (before_ns, stamp_ns), sample = samples["stamp_ns"].tolist(), samples[-1]
        step_s = min((stamp_ns - before_ns) * 1e-9, _LONGEST_STEP_S)
        strikes = bool(_find_strikes(samples)[-1])
        if strikes:
            self._corrections.clear()
        self._measured = self._measured + step_s * (sample["force"] - self._rest)
        # PX4 calls a vehicle airborne some 0.1 s late
        shown = self._shown_velocity() if sample["airborne"] else np.zeros(3)
        if shown is not None:
            follows_s = _FOLLOWS_S if self._by_poses is None else _BRAKES_S
            share = 1.0 if strikes else step_s / follows_s
            self._followed = self._followed + share * (shown - self.velocity)
        if sample["airborne"] and not self.confirmed and self._by_poses is None:
            self._shorten_velocity()
        self._corrections.append((stamp_ns, self._followed))
        while self._corrections[0][0] < stamp_ns - _BEFORE_NS:
            self._corrections.popleft()

    def _shown_velocity(self) -> Array | None:
        """Return the velocity (3) of the poses in PX4's map; None: their axes are not known."""
        seen = self._seen_velocity()
        if seen is None or self._by_poses is False:
            return None
        shown = self.velocity
        weak, (vx, vy, vz) = self.weak, seen.tolist()
        mirrored = abs(weak.mirrored) > abs(weak.product) and not self.confirmed
        product = weak.mirrored if mirrored else weak.product.conjugate()
        turn = 1.0 if self.confirmed else product / max(abs(product), 1e-18)
        shows = weak.time_s > _SHOWS_S and weak.coherence(product) > _SHOWS_COHERENT
        if self.confirmed or shows:
            level = turn * (complex(vx, -vy) if mirrored else complex(vx, vy))
            shown[:2] = level.real, level.imag
            shown[2] = vz if self._by_poses is None else shown[2]
        return shown

    def _seen_velocity(self) -> Array | None:
        """Return the velocity (3) of the newest poses, in their axes; None: they are old."""
        newest = self._poses.newest
        if newest is None or not self.has_new_pose:
            return None
        before = self._poses.since(newest["stamp_ns"] - _VELOCITY_NS)[0]
        span_s = (newest["stamp_ns"] - before["stamp_ns"]) * 1e-9
        if span_s == 0.0:
            return None
        seen: Array = (newest["position"] - before["position"]) / span_s
        return seen

    def _shorten_velocity(self) -> None:
        """Reduce the horizontal velocity to the horizontal speed of the poses, if it is larger.

        Poses with wrong axes show a wrong direction, but the right speed. The accelerometer's
        velocity alone drifts: an error of PX4's tilt by 0.2 deg makes 0.1 m/s in 3 s.
        """
        seen, level = self._seen_velocity(), _LEVEL * self.velocity
        speed = float(np.linalg.norm(level))
        if seen is not None and speed > 0.0:
            share = min(float(np.linalg.norm(seen[:2])) / speed, 1.0)
            self._followed = self._followed - (1.0 - share) * level

    # --- Comparison -----------------------------------------------------------------------------

    def measure(self) -> None:
        """Compare the motion up to the newest pose."""
        newest = self._poses.newest
        if newest is None or self._begun_ns is None:
            return
        now_ns = int(newest["stamp_ns"])
        since_ns = max(self._begun_ns, now_ns - _WINDOW_NS)
        poses, imu = self._poses.since(since_ns), self._imu.since(since_ns)
        if len(poses) < 4 or len(imu) < 8:
            return
        self._measure_height(poses, imu, now_ns)
        times, felt_times = ((rows["stamp_ns"] - now_ns) * 1e-9 for rows in (poses, imu))
        strikes = felt_times[_find_strikes(imu)]
        self.since_strike_s = -float(strikes[-1]) if len(strikes) else math.inf
        force = imu["force"] - self._rest
        spans = second_differences(times, poses["position"], felt_times, force, strikes)
        if len(spans[0]):
            self._sum_spans(*spans)

    def _sum_spans(self, seen: Array, felt: Array, ends: Array) -> None:
        """Sum second differences (M, 3) [m] of spans that end at times (M) [s]."""
        flat, high = np.linalg.norm(felt[:, :2], axis=1), np.abs(felt[:, 2])
        every = np.full(len(ends), GRID_S)
        least = np.minimum(flat, np.linalg.norm(seen[:, :2], axis=1))
        self.weak = sum_motion(_LEVEL * seen, _LEVEL * felt, every)
        above = every * (least >= _LEAST_M)
        self.level = sum_motion(_LEVEL * seen, _LEVEL * felt, above)
        use = np.outer(flat > _SCALE * _LEVEL_LEAST_M_S2, _LEVEL)
        use += np.outer(high > _SCALE * _VERTICAL_LEAST_M_S2, _UPWARD)
        fades = every * use.any(axis=1) * np.exp((ends - ends[-1]) / _MEMORY_S)
        self.recent = sum_motion(use * seen, use * felt, fades)
        off = (seen - felt)[ends >= ends[-1] - _OFF_S]
        self.off_m = float(np.linalg.norm(off, axis=1).min())
        self.off_up_m = float(np.abs(off[:, 2]).min())

    def _measure_height(self, poses: Any, imu: Any, now_ns: int) -> None:
        """Compare the height of the poses with the barometer's."""
        aloft = imu[imu["airborne"] & np.isfinite(imu["altitude"])]
        aloft = aloft[aloft["stamp_ns"] > now_ns - _HEIGHT_WINDOW_NS]
        stamps = aloft["stamp_ns"]
        if len(stamps) < 2 or stamps[-1] - stamps[0] < 2 * _HEIGHT_MEAN_NS:
            return
        above = aloft["altitude"] - np.interp(stamps, poses["stamp_ns"], poses["position"][:, 2])
        first, last = stamps < stamps[0] + _HEIGHT_MEAN_NS, stamps > stamps[-1] - _HEIGHT_MEAN_NS
        self.climbed_m = float(above[last].mean() - above[first].mean())


def _find_strikes(imu: Any) -> NDArray[np.bool_]:
    """Return which samples (N) of PX4's sensors show a strike."""
    off = np.abs(np.linalg.norm(imu["accel"], axis=1) - GRAVITY)
    jumps = np.abs(np.diff(imu["gyro"], axis=0, prepend=imu["gyro"][:1])).max(axis=1)
    strikes: NDArray[np.bool_] = (off > _STRIKE_M_S2) | (jumps > _STRIKE_RAD_S)
    return strikes
