"""Check by moving the vehicle by hand: axes of the mocap body and world, handedness, delay.

At rest gravity tells which way is up and nothing else. While the vehicle is turned, the gyro says
about which axis and when: that gives the axes of the tracked body. With them the accelerometer
gives the world's up, and while the vehicle is carried, along which axes the positions move. What
is left is the world's heading: PX4 takes it from the poses too, so it does no harm.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import body_to_map, conjugate, unwrap_quaternions
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.pose_motion import (
    FLAT_READINGS,
    READINGS,
    SHORT_HALF,
    AxesFit,
    clearest,
    fit_axes,
    integrate,
    rotation_spans,
    second_differences,
)

TURN_RAD, CARRY_M = 1.0, 1.0
"""The proof needs so much in all about each axis, and along each axis."""
_WINDOW_NS = 40_000_000_000
_POSE_NS = 15_000_000
"""Poses that come more often are left out."""
_TURNING = 0.3
"""[rad/s]: slower counts as rest."""
_ENOUGH = 1.0
"""[rad] turned in all."""
_AGREES = 0.25
"""Share of the rotation that may stay unexplained."""
_MOVES_AGREE = 0.7
"""Correlation of positions and accelerometer, in all and along each direction: hands turn the
vehicle about other points."""
_SCALE_OFF = 0.25
"""Motion of positions over that of the accelerometer may be off by this."""
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
    """Result of the check.

    Attributes:
        delay_s: poses show the vehicle as it was so long before their stamps.
        mistake: what is wrong with the axes, in words; "" if nothing is.
        sure: False: they turn otherwise, and no known mistake explains how.
        turned: about each axis of the autopilot, to and fro [rad].
        carried: along each axis of map, to and fro [m].
        moves: the positions were compared with the accelerometer along each axis.
        least_carried: along the direction in which it was carried least, to and fro [m].
    """

    delay_s: float
    mistake: str
    sure: bool = True
    turned: tuple[float, ...] = (0.0, 0.0, 0.0)
    carried: tuple[float, ...] = (0.0, 0.0, 0.0)
    moves: bool = False
    least_carried: float = 0.0

    @property
    def proven(self) -> bool:
        """Axes of body and world are right, as gyro and accelerometer say."""
        return not self.mistake and self.moves and min(self.turned) >= TURN_RAD


class MotionCheck:
    """Collects what gyro, accelerometer and poses say; `judge` compares it.

    Attributes:
        verdict: the last one; None as long as the vehicle was not turned.
    """

    def __init__(self, angle_max: float) -> None:
        """Make the check; the axes may be off by an angle [rad]."""
        self._angle_max = angle_max
        self._poses: deque[tuple[int, Array, Array]] = deque(maxlen=4000)
        self._imu: deque[tuple[int, Array, Array]] = deque(maxlen=12000)
        self._moved = False
        self.verdict: HandVerdict | None = None

    def pose(self, stamp_ns: int, position: Array, attitude: Array) -> None:
        """Take position (3) and attitude (4) xyzw of a pose."""
        if not self._poses or stamp_ns - self._poses[-1][0] >= _POSE_NS:
            self._poses.append((stamp_ns, position, attitude))

    def imu(self, stamp_ns: int, rates: Array, accel: Array) -> None:
        """Take body rates (3) [rad/s] and specific force (3); stamps of the poses' clock."""
        if not self._imu or stamp_ns > self._imu[-1][0]:
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
            poses = [p for p in self._poses if now_ns - p[0] < _WINDOW_NS]
            imu = [s for s in self._imu if now_ns - s[0] < _WINDOW_NS]
            if len(imu) >= 50 and len(poses) >= 20:
                self.verdict = _judge_motion(poses, imu, self._angle_max) or self.verdict
        return self.verdict


def _judge_motion(
    poses: Sequence[tuple[int, Array, Array]],
    imu: Sequence[tuple[int, Array, Array]],
    angle_max: float,
) -> HandVerdict | None:
    """Return what the motion shows; None: the vehicle was not turned enough to tell."""
    begin_ns = imu[0][0]
    times = np.array([(t - begin_ns) * 1e-9 for t, _, _ in imu])
    rates, force = np.array([g for _, g, _ in imu]), np.array([f for _, _, f in imu])
    stamps = np.array([p[0] for p in poses])
    positions, attitudes = np.array([p[1] for p in poses]), np.array([p[2] for p in poses])
    steps, speed = np.diff(times), np.linalg.norm(rates[1:], axis=1)
    fast = speed > _TURNING
    turned = (np.abs(rates[1:]) * steps[:, None])[fast].sum(axis=0)
    if float(speed[fast] @ steps[fast]) < _ENOUGH:
        return None
    gyro = integrate(times, rates)
    complete = bool((turned >= TURN_RAD).all())
    fits: list[tuple[str, AxesFit]] = []
    for mistake, meant in _QUATERNIONS:
        fit = fit_axes(times, gyro, rotation_spans(stamps, meant(attitudes), begin_ns), complete)
        if not len(fit.felt):
            return None
        if fit.left <= _AGREES:
            fits.append((mistake, fit))
        if fits and not mistake:
            break
    about = tuple(turned.tolist())
    if not fits:
        return HandVerdict(math.nan, _UNEXPLAINED, sure=False, turned=about)
    mistake, best = min(fits, key=lambda f: _angle(f[1].axes))
    if mistake:
        return HandVerdict(best.delay_s, mistake, turned=about)
    axes = np.eye(3) if complete and _angle(best.axes) <= angle_max else best.axes
    seconds = (stamps - begin_ns) * 1e-9 - best.delay_s
    motion = _compare_motion(seconds, positions, attitudes, times, force @ axes.T)
    carried, least = tuple(motion.carried.tolist()), motion.least_carried
    mistake = _explain(axes, motion, angle_max)
    return HandVerdict(best.delay_s, mistake, True, about, carried, motion.compared, least)


class _PositionMotion(NamedTuple):
    """Motion of the positions against the accelerometer turned by the attitudes.

    Attributes:
        up: direction of up in the mocap's world.
        carried: way to and fro along each axis [m].
        least_carried: the same along the direction in which it was carried least [m].
        reading: signed exchange of axes that turns accelerations into those of the positions;
            None: the motion was too small to tell.
        scale: motion of the positions over that of the accelerometer.
        scale_error: three standard errors of it.
        agrees: positions agree along each principal direction of the motion.
    """

    up: Array
    carried: Array
    least_carried: float
    reading: Array | None = None
    scale: float = 1.0
    scale_error: float = math.inf
    agrees: bool = False

    @property
    def wrong_scale(self) -> bool:
        """The scale is surely wrong."""
        return abs(self.scale - 1.0) - self.scale_error > _SCALE_OFF

    @property
    def compared(self) -> bool:
        """Positions were carried along each direction, and agree."""
        right = max(abs(self.scale - 1.0), self.scale_error) < _SCALE_OFF
        return self.agrees and right and self.least_carried >= CARRY_M


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
    seen, wanted = second_differences(times, position, felt_times, felt - GRAVITY * up)
    known = _PositionMotion(up, *_carried(position))
    W, S = float((wanted**2).sum()), float((seen**2).sum())
    if len(seen) < 50 or min(W, S) <= 0.0:
        return known
    products = FLAT_READINGS @ (seen.T @ wanted).ravel()
    k = clearest(1.0 - np.maximum(products, 0.0) ** 2 / (S * W))
    correlation = products[k] / math.sqrt(S * W)
    if correlation < _MOVES_AGREE:
        return known
    count = len(seen) / (2 * SHORT_HALF)
    error = math.sqrt((1.0 / correlation**2 - 1.0) / count)
    # a vehicle carried along a diagonal alone would agree along exchanged axes, too
    _, directions = np.linalg.eigh(wanted.T @ wanted)
    s, w = seen @ directions, wanted @ directions
    size = np.sqrt((s**2).sum(axis=0) * (w**2).sum(axis=0))
    agrees = k == 0 and bool(((s * w).sum(axis=0) >= _MOVES_AGREE * size).all())
    scale = float(products[k]) / W
    return known._replace(
        reading=READINGS[k], scale=scale, scale_error=3.0 * error * scale, agrees=agrees
    )


_QUATERNIONS: tuple[tuple[str, Callable[[Array], Array]], ...] = (
    ("", lambda q: q),
    (_INVERSE, conjugate),
    (_W_FIRST, lambda q: np.roll(q, -1, axis=-1)),
)
"""What is wrong with the quaternion itself -> what was meant."""


def _carried(position: Array) -> tuple[Array, float]:
    """Return the way to and fro along each axis (3), and along the weakest direction [m].

    Positions (N, 3) are thinned, so that their noise adds nothing.
    """
    steps = np.diff(position[:: max(len(position) // 400, 1)], axis=0)
    _, directions = np.linalg.eigh(steps.T @ steps)
    way: Array = np.abs(steps).sum(axis=0)
    return way, float(np.abs(steps @ directions).sum(axis=0).min())


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
    if motion.wrong_scale:
        parts.append(
            f"positions move {motion.scale:.2g} times as far as PX4's accelerometer measures:"
            " unit or scale of the motion capture; poses are in metres"
        )
    if reading is not None and not mirrored and not np.array_equal(reading, np.eye(3)):
        parts.append(
            f"mocap positions move along other axes than the attitude says: {_exchange(reading)};"
            " let the driver turn position and attitude alike, into right-handed ENU"
        )
    return "; ".join(parts)


def _explain_body(axes: Array, mirrored: bool, carried: bool) -> str:
    nearest = READINGS[int(np.argmax(FLAT_READINGS @ axes.ravel()))]
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
