"""Check by moving the vehicle by hand: axes of the mocap body and world, handedness, delay.

At rest gravity tells which way is up and nothing else. While the vehicle is turned, the gyro says
about which axis and when: that gives the axes of the tracked body. With them the accelerometer
gives the world's up, and while the vehicle is carried, along which axes the positions move. What
is left is the world's heading: PX4 takes it from the poses too, so it does no harm.
"""

from __future__ import annotations

import itertools
import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import body_to_map, conjugate, quaternion_multiply, unwrap_quaternions
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.flight_watch import accelerations_by_position

TURN_RAD, CARRY_M = 1.0, 1.0
"""The proof needs so much in all about each axis, and along each axis."""
_WINDOW_NS = 40_000_000_000
_SPAN_NS = 90_000_000
"""Rotations are compared over this time; between two frames the noise of poses is larger."""
_GAP_NS = 250_000_000
_POSE_NS = 15_000_000
"""Poses that come more often are left out."""
_TURNING = 0.3
"""[rad/s]: slower counts as rest."""
_ENOUGH = 1.0
"""[rad] turned in all."""
_EARLIEST, _LATEST, _COARSE, _FINE = -0.06, 0.3, 0.03, 0.005
_AGREES = 0.25
"""Share of the rotation that may stay unexplained."""
_CLEARER = 0.5
"""Another reading of the axes must leave less than this share of what the plain one leaves."""
_MOVES_AGREE = 0.5
"""Share of the motion that may stay unexplained: hands turn the vehicle about other points."""
_AXIS_AGREES = 0.7
"""Correlation of positions and accelerometer along each axis."""
_NAMES = "xyz"
_INVERSE = (
    "mocap attitude is the inverse: it turns map into base_link; let the driver send the rotation"
    " from base_link to map (w, or x, y and z with the other sign)"
)
_W_FIRST = "mocap quaternion is w first: let the driver fill x, y, z, w"
_UNEXPLAINED = (
    "poses turn otherwise than PX4's gyro: is the tracked body this vehicle, are its markers"
    " fixed, do stamps and poses belong together?"
)


@dataclass(frozen=True)
class HandVerdict:
    """Result of the check."""

    delay_s: float
    """Poses show the vehicle as it was so long before their stamps."""
    mistake: str
    """What is wrong with the axes, in words; "" if nothing is."""
    sure: bool = True
    """False: they turn otherwise, and no known mistake explains how."""
    turned: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """About each axis of the autopilot, to and fro [rad]."""
    carried: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Along each axis of map, to and fro [m]."""
    moves: bool = False
    """The positions were compared with the accelerometer along each axis."""

    @property
    def proven(self) -> bool:
        """Axes of body and world are right, as gyro and accelerometer say."""
        return not self.mistake and self.moves and min(self.turned) >= TURN_RAD


class MotionCheck:
    """Collects what gyro, accelerometer and poses say; `judge` compares it."""

    def __init__(self, angle_max: float) -> None:
        """Make the check; the axes may be off by an angle [rad]."""
        self._angle_max = angle_max
        self._poses: deque[tuple[int, Array, Array]] = deque(maxlen=4000)
        self._imu: deque[tuple[int, Array, Array]] = deque(maxlen=12000)
        self._moved = False
        self.verdict: HandVerdict | None = None
        """The last one; None as long as the vehicle was not turned."""

    def pose(self, stamp_ns: int, position: Array, attitude: Array) -> None:
        """Take position (3) and attitude (4) xyzw of a pose."""
        if self._poses and stamp_ns - self._poses[-1][0] < _POSE_NS:
            return
        self._poses.append((stamp_ns, position, attitude))

    def imu(self, stamp_ns: int, rates: Array, accel: Array) -> None:
        """Take body rates (3) [rad/s] and specific force (3); stamps of the poses' clock."""
        if self._imu and stamp_ns <= self._imu[-1][0]:
            return
        self._moved |= float(rates @ rates) > _TURNING**2
        self._imu.append((stamp_ns, rates, accel))

    def forget(self) -> None:
        """Forget all samples: what was a flight is no motion by hand."""
        self._poses.clear()
        self._imu.clear()
        self._moved = False

    def reset(self) -> None:
        """Forget all samples and the verdict."""
        self.forget()
        self.verdict = None

    def judge(self, now_ns: int) -> HandVerdict | None:
        """Compare the last seconds; return the newest verdict."""
        if self._moved:
            self._moved = False
            self.verdict = self._compare(now_ns) or self.verdict
        return self.verdict

    def _compare(self, now_ns: int) -> HandVerdict | None:
        imu = [s for s in self._imu if now_ns - s[0] < _WINDOW_NS]
        poses = [p for p in self._poses if now_ns - p[0] < _WINDOW_NS]
        if len(imu) < 50 or len(poses) < 20:
            return None
        begin_ns = imu[0][0]
        times = np.array([(t - begin_ns) * 1e-9 for t, _, _ in imu])
        rates = np.array([g for _, g, _ in imu])
        steps = np.diff(times)
        turns = np.abs(rates[1:]) * steps[:, None]
        fast = np.linalg.norm(rates[1:], axis=1) > _TURNING
        turned = turns[fast].sum(axis=0)
        if float(np.linalg.norm(rates[1:], axis=1)[fast] @ steps[fast]) < _ENOUGH:
            return None
        parts = 0.5 * (rates[1:] + rates[:-1]) * steps[:, None]
        gyro = np.vstack([np.zeros(3), np.cumsum(parts, axis=0)])
        stamps = np.array([p[0] for p in poses])
        attitudes = np.array([p[2] for p in poses])
        about: tuple[float, float, float] = tuple(turned.tolist())
        complete = bool((turned >= TURN_RAD).all())
        unsure = HandVerdict(math.nan, _UNEXPLAINED, sure=False, turned=about)
        fits: list[tuple[str, _AxesFit]] = []
        for mistake, meant in _QUATERNIONS:
            spans = _spans(stamps, meant(attitudes), begin_ns)
            if spans is None:
                return None
            fit = _best(times, gyro, *spans, complete)
            if fit.left <= _AGREES:
                fits.append((mistake, fit))
            if fits and not mistake:
                break
        if not fits:
            return unsure
        mistake, best = min(fits, key=lambda f: _angle(f[1].axes))
        if mistake:
            return HandVerdict(best.delay, mistake, turned=about)
        axes = best.axes
        if complete and _angle(axes) <= self._angle_max:
            axes = np.eye(3)
        seconds = (stamps - begin_ns) * 1e-9 - best.delay
        force = np.array([f for _, _, f in imu]) @ axes.T
        motion = _compare_motion(seconds, np.array([p[1] for p in poses]), attitudes, times, force)
        carried: tuple[float, float, float] = tuple(motion.carried.tolist())
        mistake = _explain(axes, motion, self._angle_max)
        return HandVerdict(best.delay, mistake, True, about, carried, motion.compared)


class _PositionMotion(NamedTuple):
    """How positions move, against the accelerometer turned by the attitudes."""

    up: Array
    """Direction of up in the mocap's world."""
    carried: Array
    """Way to and fro along each axis [m]."""
    reading: Array | None
    """Which signed exchange of axes turns accelerations into those of the positions; None: the
    motion was too small to say."""
    compared: bool
    """Each axis of the positions was moved enough, and agrees."""


def _compare_motion(
    times: Array, position: Array, attitude: Array, felt_times: Array, force: Array
) -> _PositionMotion:
    """Compare the second differences of positions with the accelerometer.

    Args:
        times: (N) of the poses [s].
        position: (N, 3) [m].
        attitude: (N, 4) xyzw.
        felt_times: (K) of the accelerometer [s].
        force: (K, 3) specific force, in the axes of the tracked body.
    """
    inside = (felt_times >= times[0]) & (felt_times <= times[-1])
    felt_times, force = felt_times[inside], force[inside]
    steady = unwrap_quaternions(attitude)
    between = np.stack([np.interp(felt_times, times, q) for q in steady.T], axis=1)
    between /= np.maximum(np.linalg.norm(between, axis=1, keepdims=True), 1e-9)
    felt = body_to_map(between, force)
    mean = felt.mean(axis=0)
    up = mean / max(float(np.linalg.norm(mean)), 1e-9)
    seen, wanted = accelerations_by_position(times, position, felt_times, felt - GRAVITY * up)
    carried = np.abs(np.diff(position, axis=0)).sum(axis=0)
    nothing = _PositionMotion(up, carried, None, False)
    total = float((wanted**2).sum())
    if len(seen) < 50 or total <= 0.0:
        return nothing
    left = (float((seen**2).sum()) + total - 2.0 * (_FLAT @ (seen.T @ wanted).ravel())) / total
    k = int(np.argmin(left))
    if left[k] > _CLEARER * left[0]:
        k = 0
    if left[k] > _MOVES_AGREE:
        return nothing
    product = (seen * wanted).sum(axis=0)
    size = np.sqrt((seen**2).sum(axis=0) * (wanted**2).sum(axis=0))
    agree = bool((product >= _AXIS_AGREES * size).all())
    enough = bool((_moved(position) >= CARRY_M).all())
    return _PositionMotion(up, carried, _READINGS[k], k == 0 and agree and enough)


class _AxesFit(NamedTuple):
    left: float
    """Share of the turning that stays unexplained."""
    delay: float
    axes: Array


def _best(
    times: Array, turned: Array, first: Array, last: Array, seen: Array, any_angle: bool
) -> _AxesFit:
    """Return the delay and the axes that explain most."""
    best = _AxesFit(math.inf, 0.0, np.eye(3))
    delays = [*np.arange(_EARLIEST, _LATEST, _COARSE)]
    for step in (_COARSE, _FINE):
        for delay in delays:
            left, axes = _misfit(times, turned, first - delay, last - delay, seen, any_angle)
            if left < best.left:
                best = _AxesFit(left, float(delay), axes)
        delays = [best.delay + d for d in np.arange(-step, step, _FINE)]
    return best


def _spans(stamps: Array, attitude: Array, begin_ns: int) -> tuple[Array, Array, Array] | None:
    """Return begin, end [s] and turn (N, 3) [rad, body] between poses a span apart."""
    early = np.searchsorted(stamps, stamps - _SPAN_NS, side="right") - 1
    late = np.arange(len(stamps))
    apart = stamps - stamps[np.maximum(early, 0)]
    use = (early >= 0) & (apart >= _SPAN_NS) & (apart <= _GAP_NS)
    if use.sum() < 20:
        return None
    early, late = early[use], late[use]
    turn = quaternion_multiply(conjugate(attitude[early]), attitude[late])
    turn = np.where(turn[:, 3:] < 0.0, -turn, turn)
    sine = np.linalg.norm(turn[:, :3], axis=1, keepdims=True)
    angle = 2.0 * np.arctan2(sine, turn[:, 3:])
    vector = turn[:, :3] * np.where(sine > 1e-9, angle / np.maximum(sine, 1e-9), 2.0)
    seconds = (stamps - begin_ns) * 1e-9
    return seconds[early], seconds[late], vector


def _misfit(
    times: Array, turned: Array, first: Array, last: Array, seen: Array, any_angle: bool
) -> tuple[float, Array]:
    """Return the share of the turning that no axes explain, and the axes that explain most.

    Args:
        times: (N) of the gyro [s].
        turned: (N, 3) its integral [rad].
        first: (M) begin of each rotation of the poses.
        last: (M) its end.
        seen: (M, 3) [rad].
        any_angle: turned about each axis, so that any rotation between the axes can be told; else
            only signed exchanges, of which the plain one stands unless another explains much more.
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
    # the sum of squares of `seen - felt @ axes.T`, from one 3x3 matrix
    common, matrix = float((seen**2).sum()) + total, seen.T @ felt
    if any_angle:
        left_, _, right = np.linalg.svd(matrix)
        handed = np.array([1.0, 1.0, np.linalg.det(left_ @ right)])
        axes: Array = (left_ * handed) @ right
        return (common - 2.0 * float((axes * matrix).sum())) / total, axes
    left = (common - 2.0 * (_FLAT @ matrix.ravel())) / total
    k = int(np.argmin(left))
    if left[k] > _CLEARER * left[0]:
        k = 0
    return float(left[k]), _READINGS[k]


def _readings() -> list[Array]:
    """Return all 48 signed exchanges of axes, the plain one first, then the likeliest."""
    readings = [
        np.eye(3)[list(order)] * np.array(signs)[:, None]
        for order in itertools.permutations(range(3))
        for signs in itertools.product((1.0, -1.0), repeat=3)
    ]
    # few changes before many, turns before mirrors
    return sorted(readings, key=lambda a: (-float(np.trace(a)), -round(float(np.linalg.det(a)))))


_READINGS = _readings()
_FLAT = np.array([axes.ravel() for axes in _READINGS])
_QUATERNIONS: tuple[tuple[str, Callable[[Array], Array]], ...] = (
    ("", lambda q: q),
    (_INVERSE, conjugate),
    (_W_FIRST, lambda q: np.roll(q, -1, axis=-1)),
)
"""What is wrong with the quaternion itself -> what was meant."""


def _moved(position: Array) -> Array:
    """Return the way to and fro along each axis (3) [m], without the tremble of the poses."""
    calm = position[:: max(len(position) // 400, 1)]
    way: Array = np.abs(np.diff(calm, axis=0)).sum(axis=0)
    return way


def _angle(axes: Array) -> float:
    return math.acos(min(max(0.5 * (float(np.trace(axes)) - 1.0), -1.0), 1.0))


def _exchange(axes: Array) -> str:
    """Return which axis is read as which, in words; "" if each is itself."""
    reads = []
    for column in range(3):
        row = int(np.argmax(np.abs(axes[:, column])))
        sign = "-" if axes[row, column] < 0.0 else ""
        if sign or row != column:
            reads.append(f"{_NAMES[column]} as {sign}{_NAMES[row]}")
    return ", ".join(reads)


def _explain(axes: Array, motion: _PositionMotion, angle_max: float) -> str:
    """Return in words what is wrong with the axes of body, attitude and position."""
    reading = motion.reading
    mirrored = reading is not None and np.array_equal(reading, -np.eye(3))
    parts = []
    body = _explain_body(axes, mirrored, reading is None)
    if body:
        parts.append(body)
    up = -motion.up if mirrored else motion.up
    if up[2] < math.cos(angle_max) and (reading is not None or not body):
        parts.append(_explain_world(up))
    if reading is not None and not mirrored and not np.array_equal(reading, np.eye(3)):
        parts.append(
            f"mocap positions move along other axes than the attitude says: {_exchange(reading)};"
            " let the driver turn position and attitude alike, into right-handed ENU"
        )
    return "; ".join(parts)


def _explain_body(axes: Array, mirrored: bool, carried: bool) -> str:
    nearest = _READINGS[int(np.argmax(_FLAT @ axes.ravel()))]
    exchange = _exchange(nearest)
    if np.array_equal(axes, np.eye(3)):
        return ""
    # turning is an axial vector: a mirror turns it round, and z with it, though z stays up
    if mirrored or np.linalg.det(axes) < 0.0:
        return (
            f"mocap attitude is mirrored: turning shows about {exchange}; left-handed axes, or a"
            " sign lost on the way: let the driver send right-handed ENU and FLU"
        )
    degrees = math.degrees(_angle(axes))
    turn = np.array([axes[2, 1] - axes[1, 2], axes[0, 2] - axes[2, 0], axes[1, 0] - axes[0, 1]])
    if float((axes * nearest).sum()) < 2.8:
        size = max(float(np.linalg.norm(turn)), 1e-9)
        about = ", ".join(f"{t / size:.1f}" for t in turn)
        exchange = f"an axis ({about}) turned by {degrees:.0f} deg"
    if axes[2, 2] > math.cos(0.3):
        yaw = math.degrees(math.atan2(-axes[1, 0], axes[0, 0]))
        return (
            f"x of the rigid body is not the nose: it is turned by {yaw:+.0f} deg about z against"
            " the autopilot; define the rigid body with the nose along +x"
        )
    text = (
        f"axes of the mocap body are not the autopilot's: turning shows about {exchange}; define"
        " the rigid body with x to the nose and z up (Motive streams Y-up by default)"
    )
    if axes[2, 2] < -0.9:
        text += "; z of the body points down (FRD)"
        text += ", or the attitude is mirrored: left-handed axes" if carried else ""
    return text


def _explain_world(up: Array) -> str:
    axis = int(np.argmax(np.abs(up)))
    if abs(float(up[axis])) < 0.95:
        tilt = math.degrees(math.acos(min(max(float(up[2]), -1.0), 1.0)))
        return f"mocap world is tilted: up is {tilt:.0f} deg off +z; set the ground plane again"
    name = ("-" if up[axis] < 0.0 else "+") + _NAMES[axis]
    kind = "NED: z down" if name == "-z" else f"{_NAMES[axis].upper()}-up"
    return (
        f"mocap world is {kind}: up is its {name}; set the streamed up axis to Z (OptiTrack"
        " Motive: Streaming, Up Axis)"
    )
