"""What ends a flight: limits, poses that are lost or jump, and axes that are wrong.

Axes are wrong where positions do not accelerate as the accelerometer says, turned by an attitude.
The second difference of positions over a span is the acceleration, weighted by a triangle: no
velocity is needed, and no integration drifts.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.rotation import rotate_vector
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.setpoint_stream import FlightLimits
from tombo_px4.bridge.vehicle_parameters import PreflightFinding
from tombo_px4.link.decoded_messages import VehicleOdometry

_GRID_S = 0.02
_HALF = 8
"""Steps of the grid in half a span: 0.16 s."""
_LONG_HALF = 20
"""The same of a long span, 0.4 s: a slow drift shows there."""
_GAP_S = 0.1
"""Where positions are further apart than this, nothing is compared."""
_UP = np.array([0.0, 0.0, GRAVITY])
_KEPT_NS = 1_100_000_000
_SEEN_M, _LONG_SEEN_M = 0.006, 0.03
"""[m]: a smaller second difference is noise. 0.23 and 0.19 m/s^2, tilts of 1.4 and 1.1 deg."""
_BRAKE_SEEN_M = 0.012
"""[m]: the same over a long span for a direction to brake by; it accuses nobody."""
_SHOWS_S, _DECIDES_S, _CONFIRMS_S = 0.03, 0.1, 0.8
"""So long must it be larger before it shows a direction, before the axes are called wrong, and
right."""
_STRIKE = 3.0 * GRAVITY
_BRAKE_S, _MOST_BRAKE = 0.25, 2.0
"""[s], [m/s^2]: the velocity of a descent with wrong axes is to end within that time."""
_VELOCITY_NS = 150_000_000
"""The velocity is that over this time."""
_LONGEST_STEP_S = 0.05
_COHERENT = 0.6
_WRONG, _RIGHT = math.radians(35.0), math.radians(20.0)
FROZEN = "pose_frozen"
"""Finding: at rest it may be a simulation's; in flight nothing stands so still."""
_UNFIT = (FROZEN, "position_differs", "poses_refused", "not_fused", "no_position")
"""Findings of the checks that end a flight."""
_UNFIT_NS = 2 * SECOND_NS
"""PX4 calls a vehicle airborne that still stands and spools up."""
_JUMP_NS = SECOND_NS // 4
"""Single poses with exchanged markers are left out; what stays away for longer has moved."""


def accelerations_by_position(
    times: Array, position: Array, felt_times: Array, acceleration: Array, half: int = _HALF
) -> tuple[Array, Array]:
    """Return second differences of positions, and what accelerations say they are.

    Args:
        times: (N) of the positions [s], growing.
        position: (N, 3) [m].
        felt_times: (K) of the accelerations [s], growing.
        acceleration: (K, 3) [m/s^2], in the same frame.
        half: steps of 0.02 s in half a span.

    Returns:
        (M, 3) and (M, 3) [m], over spans that hold no gap.
    """
    grid = np.arange(times[-1], max(times[0], felt_times[0]), -_GRID_S)[::-1]
    if len(grid) <= 2 * half:
        return np.zeros((0, 3)), np.zeros((0, 3))
    place = np.stack([np.interp(grid, times, p) for p in position.T], axis=1)
    push = _means(grid, felt_times, acceleration)
    weights = half - np.abs(np.arange(-half + 1, half))
    seen = place[2 * half :] - 2.0 * place[half:-half] + place[: -2 * half]
    felt = np.stack([np.convolve(a[1:-1], weights, "valid") for a in push.T], axis=1)
    felt *= _GRID_S**2
    after = np.clip(np.searchsorted(times, grid), 1, len(times) - 1)
    gaps = (times[after] - times[after - 1] > _GAP_S).astype(float)
    whole = np.convolve(gaps, np.ones(2 * half + 1), "valid") < 0.5
    return seen[whole], felt[whole]


def _means(grid: Array, times: Array, values: Array) -> Array:
    """Return the means (M, 3) of values over the cells around the points of a grid."""
    steps = 0.5 * (values[1:] + values[:-1]) * np.diff(times)[:, None]
    whole = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    begin = np.maximum(grid - 0.5 * _GRID_S, times[0])
    end = np.minimum(grid + 0.5 * _GRID_S, times[-1])
    both = [np.interp(end, times, w) - np.interp(begin, times, w) for w in whole.T]
    mean: Array = np.stack(both, axis=1) / np.maximum(end - begin, 1e-3)[:, None]
    return mean


@dataclass
class _Sums:
    """Weighted sums over the spans: of the felt, the seen, and their products."""

    least: float
    """[m]: a smaller second difference is noise."""
    time_s: float = 0.0
    felt: float = 0.0
    seen: float = 0.0
    product: complex = 0.0
    mirrored: complex = 0.0

    def add(self, felt: complex, seen: complex, weight_s: float) -> None:
        if min(abs(felt), abs(seen)) < self.least:
            return
        self.time_s += weight_s
        self.felt += weight_s * abs(felt) ** 2
        self.seen += weight_s * abs(seen) ** 2
        self.product += weight_s * felt.conjugate() * seen
        self.mirrored += weight_s * felt * seen

    def coherence(self, product: complex) -> float:
        return abs(product) ** 2 / max(self.felt * self.seen, 1e-18)

    @property
    def shows_turn(self) -> bool:
        """There is a direction to brake by, once the axes are known to be wrong."""
        best = max(self.coherence(self.product), self.coherence(self.mirrored))
        return self.time_s >= _SHOWS_S and best > _COHERENT

    @property
    def decides(self) -> bool:
        """Both have moved for long enough: poses that jump alone are no matter of axes."""
        return self.time_s >= _DECIDES_S


class TakeoffWatch:
    """Compares, from lift-off on, the poses' motion with what PX4's tilt must cause.

    PX4 tilts the vehicle to move it. Its roll and pitch come from gravity, so the acceleration
    that its attitude and accelerometer say is right but for the heading, which the poses gave. If
    the poses move in another direction, their axes are wrong, and PX4 drives the vehicle away.
    """

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Array]] = deque(maxlen=200)
        self._felt: deque[tuple[int, Array]] = deque(maxlen=400)
        self._spans = tuple(
            (half, _Sums(least), _Sums(least))
            for half, least in (
                *((_HALF, _SEEN_M), (_LONG_HALF, _LONG_SEEN_M)),
                (_LONG_HALF, _BRAKE_SEEN_M),
            )
        )
        """Steps in half a span, sums of the level motion, sums of that in height. The last ones
        are to brake by."""
        self._level, self._height = self._spans[0][1:]
        """Those that have decided."""
        self._begun = False
        self._judged_ns = 0
        self.confirmed = False
        """The motion has shown that the axes are right."""
        self.mistake = ""
        """What is wrong; "" as long as nothing is known to be."""
        self._correction: tuple[complex, bool, float] = (1.0, False, 1.0)
        self._corrected: deque[tuple[int, Array]] = deque(maxlen=200)
        """Positions in the axes that PX4 feels, since a mistake is known."""
        self._pivot: tuple[Array, Array] | None = None
        """A place of the poses, and what was made of it."""

    def begin(self) -> None:
        """Begin, with the arming."""
        self._begun = True

    def pose(self, stamp_ns: int, position: Array) -> None:
        """Take the position (3) of a pose."""
        if not self.confirmed and (not self._poses or stamp_ns > self._poses[-1][0]):
            self._poses.append((stamp_ns, position))

    def felt(self, stamp_ns: int, attitude: Array, accel: Array) -> None:
        """Take PX4's attitude (4) xyzw and specific force (3), base_link, of about one time."""
        if float(accel @ accel) > _STRIKE**2:  # shorter than the samples are apart
            self._felt.clear()
        elif not self.confirmed and (not self._felt or stamp_ns > self._felt[-1][0]):
            self._felt.append((stamp_ns, rotate_vector(attitude, accel) - _UP))

    def as_px4_feels(self, stamp_ns: int, position: Array) -> Array:
        """Return the position (3) of a pose in the axes that the motion has shown, to land with.

        It is turned about the place where that was seen last, so that nothing jumps.
        """
        if not self.mistake:
            return position
        place, shown = (position, position) if self._pivot is None else self._pivot
        turn, mirrored, up = self._correction
        x, y, z = (float(v) for v in position - place)
        level = turn * (complex(x, -y) if mirrored else complex(x, y))
        way: Array = np.array([level.real, level.imag, up * z])
        place_felt: Array = np.add(shown, way)
        wanted = self._new_correction()
        if self._pivot is None or self._correction != wanted:
            self._pivot, self._correction = (position, place_felt), wanted
        self._corrected.append((stamp_ns, place_felt))
        return place_felt

    def _new_correction(self) -> tuple[complex, bool, float]:
        """Return what turns a motion of the poses into what PX4 feels: turn, mirror, sign of z."""
        level, height = self._level, self._height
        up = -1.0 if height.decides and height.product.real < 0.0 else 1.0
        if not level.shows_turn:
            return 1.0, False, up
        mirrored = abs(level.mirrored) > abs(level.product)
        turn = level.mirrored if mirrored else level.product.conjugate()
        return turn / max(abs(turn), 1e-18), mirrored, up

    @property
    def brake(self) -> complex:
        """Horizontal acceleration that ends the present motion, x + i y in PX4's map [m/s^2]."""
        if not self._corrected or not self._level.shows_turn:
            return 0.0
        now_ns, (x, y, _) = self._corrected[-1]
        before = next(b for b in self._corrected if now_ns - b[0] <= _VELOCITY_NS)
        step_s = (now_ns - before[0]) * 1e-9
        if step_s <= 0.0:
            return 0.0
        velocity = complex(float(x - before[1][0]), float(y - before[1][1])) / step_s
        wanted = -velocity / _BRAKE_S
        return wanted * min(1.0, _MOST_BRAKE / max(abs(wanted), 1e-9))

    def drifts(self, away_m: float) -> None:
        """Take a vehicle that does not hold its place while it takes off: its axes are wrong.

        Args:
            away_m: horizontal distance of the pose from the set point.
        """
        if not self.confirmed and not self.mistake:
            self._level, self._height = self._spans[-1][1:]
            self.mistake = (
                f"the vehicle is {away_m:.2f} m beside its set point while it takes off: PX4 does"
                " not hold it; axes of the poses, or a wind that is too strong"
            )

    def judge(self) -> str:
        """Compare the newest span; return the mistake, "" if none is known."""
        if self.confirmed or not self._begun or not self._poses:
            return self.mistake
        now_ns = self._poses[-1][0]
        if now_ns == self._judged_ns:
            return self.mistake
        step_s = min((now_ns - self._judged_ns) * 1e-9, _LONGEST_STEP_S)
        self._judged_ns = now_ns
        poses = [p for p in self._poses if now_ns - p[0] < _KEPT_NS]
        felt = [f for f in self._felt if now_ns - f[0] < _KEPT_NS]
        if len(poses) < 4 or len(felt) < 8:
            return self.mistake
        motion = (
            np.array([(t - now_ns) * 1e-9 for t, _ in poses]),
            np.array([p for _, p in poses]),
            np.array([(t - now_ns) * 1e-9 for t, _ in felt]),
            np.array([a for _, a in felt]),
        )
        compared = {h: accelerations_by_position(*motion, h) for h in (_HALF, _LONG_HALF)}
        for half, level, height in self._spans:
            seen, wanted = compared[half]
            if len(seen):
                (x, y, z), (u, v, w) = seen[-1].tolist(), wanted[-1].tolist()
                level.add(complex(u, v), complex(x, y), step_s)
                height.add(complex(w), complex(z), step_s)
        for _, level, height in self._spans[:-1]:
            if not self.mistake:
                self._level, self._height = level, height
                self._decide()
        return self.mistake

    def _decide(self) -> None:
        level, height = self._level, self._height
        falls = height.decides and height.product.real < 0.0
        if falls and height.coherence(height.product) > _COHERENT:
            self.mistake = "poses sink where PX4 feels that it climbs: z is upside down"
            return
        if not level.decides:
            return
        turn = math.atan2(level.product.imag, level.product.real)
        along = level.coherence(level.product)
        if level.coherence(level.mirrored) > max(_COHERENT, 1.5 * along):
            self.mistake = (
                "poses move mirrored to where PX4's tilt drives the vehicle: positions are"
                " left-handed, or x and y are exchanged"
            )
        elif along > _COHERENT and abs(turn) > _WRONG:
            self.mistake = (
                f"poses move {math.degrees(turn):+.0f} deg beside where PX4's tilt drives the"
                " vehicle: x of the rigid body is not the nose, or the axes of the positions are"
                " not those of the attitude"
            )
        elif level.time_s > _CONFIRMS_S and along > _COHERENT and abs(turn) < _RIGHT:
            self.confirmed = True


class FlightWatch:
    """Tells why a flight must end.

    Attributes:
        takeoff: the motion since the arming against PX4's tilt.
        pose_ns: when the last pose came that could be sent.
        jump_ns: since when poses are elsewhere than PX4; None: they are not.
    """

    def __init__(self, params: BridgeParams, limits: FlightLimits) -> None:
        self._params = params
        self._limits = limits
        self.takeoff = TakeoffWatch()
        self.pose_ns = 0
        self.jump_ns: int | None = None
        self._unfit_ns: int | None = None
        self._limit_ns: int | None = None
        self._was_armed = False
        self._beside_m = 0.0
        """Horizontal distance from the set point at the arming [m]."""

    def rest(self) -> None:
        """Forget since when something is wrong: the vehicle does not fly."""
        self._unfit_ns = self._limit_ns = None

    def follow(self, armed: bool, takes_off: bool, beside_m: float) -> str:
        """Compare the motion since the arming with PX4's tilt.

        Args:
            armed: the vehicle is.
            takes_off: the mission says so.
            beside_m: horizontal distance from the set point.

        Returns:
            what is wrong with the axes, when it is found; else "".
        """
        if armed != self._was_armed:
            self._was_armed = armed
            self.takeoff = TakeoffWatch()
            if armed:
                self.takeoff.begin()
                self._beside_m = beside_m
        known = bool(self.takeoff.mistake)
        drifts = beside_m - self._beside_m > self._params.takeoff_drift_max
        if armed and takes_off and drifts:
            self.takeoff.drifts(beside_m)
        mistake = self.takeoff.judge() if armed else ""
        return "" if known else mistake

    def must_land(
        self, now_ns: int, odometry: VehicleOdometry | None, blocking: Sequence[PreflightFinding]
    ) -> str:
        """Return why the flight must end, "" if it may go on.

        Args:
            now_ns: the present.
            odometry: PX4's last estimate.
            blocking: findings with which the bridge would not arm.
        """
        if self.takeoff.mistake:
            return self.takeoff.mistake
        broken = "" if odometry is None else self._limits.broken(odometry)
        self._limit_ns = (self._limit_ns or now_ns) if broken else None
        limit_ns = self._limits.safety.limit_time * SECOND_NS
        if self._limit_ns is not None and now_ns - self._limit_ns > limit_ns:
            return broken
        pose_s = (now_ns - self.pose_ns) * 1e-9
        if pose_s > self._params.pose_loss_time:
            refused = next((f.text for f in blocking if f.key.startswith("pose_")), "")
            return refused or f"no mocap pose for {pose_s:.1f} s"
        if self.jump_ns is not None and now_ns - self.jump_ns > _JUMP_NS:
            return PoseRefusal.JUMP.text
        unfit = next((f.text for f in blocking if f.key in _UNFIT), "")
        self._unfit_ns = (self._unfit_ns or now_ns) if unfit else None
        return unfit if self._unfit_ns and now_ns - self._unfit_ns > _UNFIT_NS else ""
