"""Conditions that end a flight: limits, poses that are lost or jump, and poses of something else.

From the arming on, the motion that PX4's gyro, accelerometer and barometer imply must appear in
the poses. Positions that move in another direction have wrong axes; positions that move too far, a
wrong scale. Poses that do not move belong to another body.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.rotation import rotate_vector
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.checklist import PreflightFinding
from tombo_px4.bridge.pose_motion import (
    GRID_S,
    LONG_HALF,
    SHORT_HALF,
    MotionSums,
    fit_axes,
    second_differences,
)
from tombo_px4.bridge.setpoint_stream import FlightLimits
from tombo_px4.link.messages import VehicleImu, VehicleOdometry

_LEVEL, _UPWARD = np.array([1.0, 1.0, 0.0]), np.array([0.0, 0.0, 1.0])
_UP = GRAVITY * _UPWARD
_WINDOW_NS = 1_100_000_000
"""Poses and samples of this age are compared: a long span and a margin [ns]."""
_SHORT_LEAST_M, _LONG_LEAST_M = 0.006, 0.03
"""[m]: a smaller second difference is noise. 0.23 and 0.19 m/s^2, tilts of 1.4 and 1.1 deg."""
_LEVEL_LEAST_M_S2, _VERTICAL_LEAST_M_S2 = 0.8, 0.5
"""Accelerations that poses have to show [m/s^2]: three times PX4's errors of tilt (1.5 deg) and
of the accelerometer's bias in flight."""
_DECIDES_S, _CONFIRMS_S = 0.1, 0.8
"""Time of motion after which the axes are called wrong, and right [s]."""
_SLOPE_STILL, _SLOPE_LOW, _SLOPE_HIGH = 0.5, 0.75, 1.25
"""Poses whose slope is surely lower, or higher, do not belong to this vehicle, or have another
scale. A pose 50 ms late still has 0.7 at 3 Hz."""
_STILL_SHARE = 0.3
"""Poses with less than this share of the squared motion stand still."""
_MEMORY_S = 1.0
"""Slopes forget earlier motion in this time: a body may be lost in flight [s]."""
_TURN_WINDOW_NS, _TURN_PERIOD_NS = 2 * SECOND_NS, SECOND_NS // 5
_TURN_LEAST_RAD, _TURN_MOST_RAD = 0.015, 0.7
"""Rotations within 0.09 s that are compared: above the noise of poses, below the error of small
angles [rad]."""
_TURN_LEAST_S = 0.3
_TURN_SPAN_S = 0.09
_STRIKE_M_S2 = 0.8 * GRAVITY
"""Specific force this far from gravity: a strike, shorter than the samples are apart."""
_REST_NS = SECOND_NS
_REST_STD_M_S2, _REST_RATE, _REST_OFF_M_S2 = 0.5, 0.15, 0.6
"""A vehicle at rest shows no more noise, rate [rad/s] and error of gravity."""
_FOLLOWS_S = 1.0
"""Time in which the velocity by the accelerometer follows that of the poses, where the motion has
shown their axes: an error of tilt by 1 deg then makes 0.17 m/s [s]."""
_BRAKES_S = 0.3
"""The same while it brakes after a mistake of axes: the direction is better known by then [s]."""
_WAY_NS, _WAY_OFF_M, _WAY_LASTS_NS = SECOND_NS // 2, 0.2, SECOND_NS // 7
"""Within 0.5 s [ns] the way of the poses and that of the accelerometer differ by less [m]; single
poses with exchanged markers do not last [ns]."""
_VELOCITY_NS = 150_000_000
"""The velocity of the poses is that over this time [ns]."""
_BEFORE_NS = 2 * SECOND_NS
"""Poses of another body were followed for so long, at most, before it is known [ns]."""
_SHOWS_S, _SHOWS_COHERENT = 1.0, 0.25
"""Time [s] and coherence after which even weak motion shows a direction to brake by: over real
PX4 it then was right to 26 deg in ten of ten flights. It does not suffice to call axes wrong."""
_STRIKE_RAD_S = 3.0
"""Change of rate between two samples: a strike [rad/s]."""
_STRIKE_NS = 2 * SECOND_NS
"""After a strike, turns that agree count more than accelerations [ns]."""
_HEIGHT_OFF_M, _HEIGHT_WINDOW_NS, _HEIGHT_SMOOTH_S = 2.0, 5 * SECOND_NS, 0.3
"""Largest difference of barometer and poses within 5 s: propellers and doors move it by 1 m."""
_FRESH_NS = SECOND_NS // 5
_LONGEST_STEP_S = 0.05
_COHERENT = 0.6
_WRONG, _RIGHT = math.radians(35.0), math.radians(20.0)
_UNFIT = ("position_differs", "yaw_differs", "poses_refused", "not_fused", "no_position")
"""Findings of the checks that end a flight."""
_UNFIT_NS = 2 * SECOND_NS
"""PX4 calls a vehicle airborne that still stands and spools up."""
_LIFTED_M = 0.05
_JUMP_NS = SECOND_NS // 4
"""Single poses with exchanged markers are left out; what stays away for longer has moved."""
_TAKEOFF_DRIFT_M = 0.15
"""[m]: a vehicle further from its set point in the take-off lands by thrust. In hover over a
real PX4 in gusts it is 0.06 m RMS away, in the first seconds at most 0.1 m."""
_CHECK_HEIGHT_M, _CHECK_NS = 0.6, 8 * SECOND_NS
"""The vehicle stays below this height until its motion has shown the axes, for this time at most
[ns]. Wrong axes then end below 1 m; over a real PX4 they show 2 to 7 s after the lift-off."""
_TAKEOFF_REPEATS_S = 0.2
"""Time of a repeated pose in the check at take-off that ends the flight [s]."""
_REPEATED_NS = 100_000_000
"""A driver may send a pose twice; the same bits for longer are not a new pose [ns]."""


class RepeatedPose:
    """Finds poses whose bits do not change although the vehicle moves.

    A real motion capture has noise. A simulated pose without noise is a pose at rest, as long as
    the gyro does not turn and the vehicle does not fly.
    """

    def __init__(self) -> None:
        self._pose: Array = np.full(7, math.nan)
        self._since_ns = 0
        self._moves = False

    def moves(self) -> None:
        """Take note that the vehicle turns or flies now."""
        self._moves = True

    def repeats(self, now_ns: int, position: Array, attitude: Array) -> bool:
        """Take a pose; return whether it repeats an old one of a vehicle that moves."""
        pose = np.concatenate([position, attitude])
        if not np.array_equal(pose, self._pose):
            self._pose, self._since_ns, self._moves = pose, now_ns, False
        return self._moves and now_ns - self._since_ns > _REPEATED_NS


class Mistake(NamedTuple):
    """Fault of the poses in flight.

    Attributes:
        text: to tell.
        rotated: the poses are turned or mirrored, but are this vehicle's: it brakes by them. Else
            the velocity is as if they had not been followed lately.
        voids_proof: it is one of axes, scale or body.
    """

    text: str
    rotated: bool = False
    voids_proof: bool = False


class _Span:
    """Sums over spans of one length: level motion, upward motion, and motion above the noise."""

    def __init__(self, half: int, least_m: float) -> None:
        self.half = half
        span_s = 2 * half * GRID_S
        self.level, self.height = MotionSums(span_s, least_m), MotionSums(span_s, least_m)
        self.weak = MotionSums(span_s)
        self.slope = MotionSums(span_s, memory_s=_MEMORY_S)
        scale = (half * GRID_S) ** 2
        self._least = scale * _LEVEL_LEAST_M_S2, scale * _VERTICAL_LEAST_M_S2

    def add(self, seen: Array, felt: Array, step_s: float) -> None:
        """Add the newest second difference (3) of the poses, and that of the accelerometer."""
        self.level.add(_LEVEL * felt, _LEVEL * seen, step_s)
        self.weak.add(_LEVEL * felt, _LEVEL * seen, step_s)
        self.height.add(_UPWARD * felt, _UPWARD * seen, step_s)
        u, v, w = felt.tolist()
        level, vertical = math.hypot(u, v) > self._least[0], abs(w) > self._least[1]
        if level or vertical:
            use = level * _LEVEL + vertical * _UPWARD
            self.slope.add(use * felt, use * seen, step_s)

    @property
    def turn(self) -> tuple[complex, bool] | None:
        """Turn of a motion of the poses into the felt one, and whether it is mirrored first."""
        weak = self.weak
        mirrored = abs(weak.mirrored) > abs(weak.product)
        product = weak.mirrored if mirrored else weak.product.conjugate()
        if weak.time_s < _SHOWS_S or weak.coherence(product) < _SHOWS_COHERENT:
            return None
        return product / abs(product), mirrored


class PoseMotionWatch:
    """Compares, from the arming on, the motion of the poses with that of PX4's sensors.

    PX4's roll and pitch come from gravity. The acceleration by its attitude and accelerometer is
    therefore right, except for the heading, which comes from the poses. If poses move in another
    direction, too far, or not at all, PX4 drives the vehicle away.

    Attributes:
        confirmed: the motion has shown that the axes are right.
        mistake: fault of the poses; None: no fault is known.
        velocity: (3) by the accelerometer since the arming, in PX4's map [m/s].
    """

    def __init__(self) -> None:
        self._poses: deque[tuple[int, Array, Array]] = deque(maxlen=500)
        self._imu: deque[tuple[int, Array, Array]] = deque(maxlen=600)
        self._rest = _UP
        self._begun = False
        self._start()

    def _start(self) -> None:
        self._spans = _Span(SHORT_HALF, _SHORT_LEAST_M), _Span(LONG_HALF, _LONG_LEAST_M)
        self._ways: deque[tuple[int, Array]] = deque(maxlen=100)
        self._heights: deque[tuple[int, float]] = deque()
        self._measured: Array = np.zeros(3)
        """Velocity by the accelerometer alone."""
        self._velocities: deque[tuple[int, Array, Array]] = deque()
        """Stamp, `velocity` and `_measured`, lately."""
        self._judged_ns = self._turned_ns = 0
        self._strike_ns = -_STRIKE_NS
        self._way_off_ns: int | None = None
        self.confirmed = self._turns_agree = False
        self.mistake: Mistake | None = None
        self.velocity: Array = np.zeros(3)

    def begin(self) -> None:
        """Begin with the arming: the accelerometer at rest shows its bias and PX4's tilt."""
        self._start()
        self._begun, self._rest = True, _UP
        newest_ns = self._imu[-1][0] if self._imu else 0
        rest = [s for s in self._imu if newest_ns - s[0] < _REST_NS]
        force = np.array([s[2] for s in rest]).reshape(-1, 3)
        if len(rest) < 8 or np.abs([s[1] for s in rest]).max() > _REST_RATE:
            return
        mean = force.mean(axis=0)
        off = float(np.linalg.norm(mean - _UP))
        if force.std(axis=0).max() < _REST_STD_M_S2 and off < _REST_OFF_M_S2:
            self._rest = mean

    def end(self) -> None:
        """End with the disarming."""
        self._begun = False

    def pose(self, stamp_ns: int, position: Array, attitude: Array) -> None:
        """Take position (3) and attitude (4) xyzw of a pose."""
        if not self._poses or stamp_ns > self._poses[-1][0]:
            self._poses.append((stamp_ns, position, attitude))

    def imu(self, sample: VehicleImu, estimate: VehicleOdometry, airborne: bool) -> None:
        """Take a sample of PX4's sensors and its estimate of about the same time."""
        stamp_ns = sample.stamp_ns
        if stamp_ns is None or (self._imu and stamp_ns <= self._imu[-1][0]):
            return
        force = rotate_vector(estimate.attitude, sample.accel)
        step_s = min((stamp_ns - self._imu[-1][0]) * 1e-9, _LONGEST_STEP_S) if self._imu else 0.0
        strikes = abs(float(np.linalg.norm(sample.accel)) - GRAVITY) > _STRIKE_M_S2
        if self._imu:
            strikes |= float(np.abs(sample.gyro - self._imu[-1][1]).max()) > _STRIKE_RAD_S
        self._imu.append((stamp_ns, sample.gyro, force))
        if strikes:
            self._strike_ns = stamp_ns
        way = self._ways[-1][1] if self._ways else np.zeros(3)
        self._ways.append((stamp_ns, way + step_s * self.velocity))
        change = step_s * (force - self._rest)
        self.velocity, self._measured = self.velocity + change, self._measured + change
        # PX4 calls a vehicle airborne some 0.1 s late
        shown = self._shown_velocity() if airborne else np.zeros(3)
        if shown is not None:
            share = step_s / (_BRAKES_S if self.mistake else _FOLLOWS_S)
            self.velocity = self.velocity + (1.0 if strikes else share) * (shown - self.velocity)
        if airborne and not (self.confirmed or self.mistake):
            self._shorten_velocity()
        self._velocities.append((stamp_ns, self.velocity, self._measured))
        while self._velocities[0][0] < max(stamp_ns - _BEFORE_NS, self._strike_ns):
            self._velocities.popleft()
        if self._poses and math.isfinite(sample.pressure_altitude) and airborne:
            self._follow_height(stamp_ns, sample.pressure_altitude, step_s)

    def _shown_velocity(self) -> Array | None:
        """Return the velocity (3) of the poses in PX4's map; None: their axes are not known."""
        seen = self._seen_velocity()
        if seen is None or (self.mistake and not self.mistake.rotated):
            return None
        span, shown = self._spans[1], self.velocity.copy()
        direction = (1.0, False) if self.confirmed else span.turn
        vx, vy, vz = seen.tolist()
        if direction is not None:
            turn, mirrored = direction
            level = turn * (complex(vx, -vy) if mirrored else complex(vx, vy))
            shown[:2] = level.real, level.imag
        upward = span.height.time_s >= _DECIDES_S and span.height.slope > _COHERENT
        if upward and not self.mistake:
            shown[2] = vz
        return shown

    def _seen_velocity(self) -> Array | None:
        """Return the velocity (3) of the newest poses, in their axes; None: they are old."""
        if not self._poses:
            return None
        now_ns, place, _ = self._poses[-1]
        before_ns, before, _ = next(p for p in self._poses if now_ns - p[0] <= _VELOCITY_NS)
        if before_ns == now_ns or now_ns < self._imu[-1][0] - _FRESH_NS:
            return None
        seen: Array = (place - before) / ((now_ns - before_ns) * 1e-9)
        return seen

    def _shorten_velocity(self) -> None:
        """Let the level velocity be no faster than the poses: axes change no speed.

        The accelerometer's velocity alone drifts by PX4's error of tilt, 0.1 m/s in 3 s.
        """
        seen = self._seen_velocity()
        speed = float(np.linalg.norm(self.velocity[:2]))
        if seen is not None and speed > 0.0:
            share = min(float(np.linalg.norm(seen[:2])) / speed, 1.0)
            self.velocity = self.velocity * (share * _LEVEL + _UPWARD)

    def _follow_height(self, now_ns: int, altitude: float, step_s: float) -> None:
        """Keep the height of the barometer above that of the poses, smoothed."""
        above = altitude - float(self._poses[-1][1][2])
        if self._heights:
            before = self._heights[-1][1]
            above = before + min(step_s / _HEIGHT_SMOOTH_S, 1.0) * (above - before)
        self._heights.append((now_ns, above))
        while now_ns - self._heights[0][0] > _HEIGHT_WINDOW_NS:
            self._heights.popleft()

    def drifts(self, now_ns: int, away_m: float) -> None:
        """Take a vehicle that does not hold its place while it takes off: its axes are wrong.

        Args:
            now_ns: the present; old poses prove no drift.
            away_m: horizontal distance of the pose from the set point.
        """
        fresh = bool(self._poses) and now_ns - self._poses[-1][0] < _FRESH_NS
        if fresh and not (self.confirmed or self.mistake):
            self.accuse(
                Mistake(
                    f"the vehicle is {away_m:.2f} m beside its set point while it takes off: PX4"
                    " does not hold it; axes of the poses, or a wind that is too strong",
                    rotated=True,
                )
            )

    def compare(self) -> Mistake | None:
        """Compare the newest span; return the mistake, None if no mistake is known.

        After a mistake the motion goes on to show the direction to brake by.
        """
        if not self._begun or not self._poses or self._poses[-1][0] == self._judged_ns:
            return self.mistake
        now_ns = self._poses[-1][0]
        step_s = min((now_ns - self._judged_ns) * 1e-9, _LONGEST_STEP_S)
        self._judged_ns = now_ns
        moved = self._add_spans(now_ns, step_s)
        for compare in (
            self._compare_height,
            self._compare_turns,
            *((self._compare_way, self._compare_direction, self._compare_scale) if moved else ()),
        ):
            mistake = None if self.mistake else compare(now_ns)
            if mistake is not None:
                self.accuse(mistake)
        return self.mistake

    def accuse(self, mistake: Mistake) -> None:
        """Take a mistake: brake by the poses, or by the accelerometer alone."""
        self.mistake = mistake
        if mistake.rotated:
            self._follow_poses()
        elif self._velocities:
            _, velocity, measured = self._velocities[0]
            self.velocity = velocity + self._measured - measured

    def _follow_poses(self) -> None:
        """Take over the velocity that the poses show."""
        shown = self._shown_velocity()
        self.velocity = self.velocity if shown is None else shown

    def _add_spans(self, now_ns: int, step_s: float) -> bool:
        """Add the newest second differences; return whether there are samples enough."""
        poses = [p for p in self._poses if now_ns - p[0] < _WINDOW_NS]
        imu = [s for s in self._imu if now_ns - s[0] < _WINDOW_NS and s[0] > self._strike_ns]
        if len(poses) < 4 or len(imu) < 8:
            return False
        motion = (
            np.array([(p[0] - now_ns) * 1e-9 for p in poses]),
            np.array([p[1] for p in poses]),
            np.array([(s[0] - now_ns) * 1e-9 for s in imu]),
            np.array([s[2] for s in imu]) - self._rest,
        )
        for span in self._spans:
            seen, felt = second_differences(*motion, span.half)
            if len(seen):
                span.add(seen[-1], felt[-1], step_s)
        return True

    def _compare_height(self, now_ns: int) -> Mistake | None:
        """Compare the height of the poses with the barometer's."""
        climbed = self._heights[-1][1] - self._heights[0][1] if self._heights else 0.0
        if abs(climbed) <= _HEIGHT_OFF_M:
            return None
        return Mistake(
            f"within 5 s PX4's barometer has moved {climbed:+.1f} m against the height of the"
            " poses: the tracked body is not this vehicle"
        )

    def _compare_turns(self, now_ns: int) -> Mistake | None:
        """Compare the rotations of the last 2 s with those of the gyro."""
        if now_ns - self._turned_ns < _TURN_PERIOD_NS:
            return None
        self._turned_ns = now_ns
        poses = [p for p in self._poses if now_ns - p[0] < _TURN_WINDOW_NS]
        imu = [s for s in self._imu if now_ns - s[0] < _TURN_WINDOW_NS + _FRESH_NS]
        self._turns_agree = False
        if len(poses) < 20 or len(imu) < 20:
            return None
        stamps, attitudes = (np.array([p[k] for p in poses]) for k in (0, 2))
        imu_stamps, rates = (np.array([s[k] for s in imu]) for k in (0, 1))
        fit = fit_axes(imu_stamps, rates, stamps, attitudes, any_axes=False)
        size = np.linalg.norm(fit.felt, axis=1)
        use = (size > _TURN_LEAST_RAD) & (size < _TURN_MOST_RAD)
        sums = MotionSums(_TURN_SPAN_S)
        step_s = float(stamps[-1] - stamps[0]) * 1e-9 / len(stamps)
        for felt, seen in zip(fit.felt[use], fit.seen[use], strict=True):
            sums.add(felt, seen, step_s)
        if sums.time_s < _TURN_LEAST_S:
            return None
        self._turns_agree = sums.slope - sums.error > _SLOPE_STILL
        if sums.slope + sums.error >= _SLOPE_STILL:
            return None
        text = (
            "poses do not turn as PX4's gyro does: the tracked body"
            f" {_name_motion(sums, 'turns')}; is it this vehicle, is x of the rigid body the nose?"
        )
        return Mistake(text, voids_proof=True)

    def _compare_way(self, now_ns: int) -> Mistake | None:
        """Compare the way within 0.5 s: upwards, and each way once the axes are right."""
        poses = [p for p in self._poses if now_ns - p[0] <= _WAY_NS]
        ways = [w for w in self._ways if w[0] >= poses[0][0]]
        if len(ways) < 8 or now_ns - ways[0][0] < 0.8 * _WAY_NS:
            return None
        off = ways[-1][1] - ways[0][1] - (poses[-1][1] - poses[0][1])
        off_m = float(np.linalg.norm(off if self.confirmed else off[2:]))
        far = now_ns - self._strike_ns > _STRIKE_NS and off_m > _WAY_OFF_M
        self._way_off_ns = (self._way_off_ns or now_ns) if far else None
        if self._way_off_ns is None or now_ns - self._way_off_ns <= _WAY_LASTS_NS:
            return None
        return Mistake(
            f"within 0.5 s the poses moved {off_m:.2f} m less or more than PX4's accelerometer"
            " measures: is the tracked body this vehicle?"
        )

    def _compare_direction(self, now_ns: int) -> Mistake | None:
        """Compare the directions of the motion; confirm the axes if they agree."""
        for span in self._spans:
            mistake = None if self.confirmed else self._compare_span(span)
            if mistake is not None:
                return mistake
        return None

    def _compare_span(self, span: _Span) -> Mistake | None:
        level, height = span.level, span.height
        falls = height.time_s >= _DECIDES_S and height.slope < 0.0
        if falls and height.coherence(height.product) > _COHERENT:
            text = "poses sink where PX4 feels that it climbs: z is upside down"
            return Mistake(text, voids_proof=True)
        if level.time_s < _DECIDES_S:  # jumps of the poses alone do not concern the axes
            return None
        turn = math.atan2(level.product.imag, level.product.real)
        along = level.coherence(level.product)
        if level.coherence(level.mirrored) > max(_COHERENT, 1.5 * along):
            text = (
                "poses move mirrored to where PX4's tilt drives the vehicle: positions are"
                " left-handed, or x and y are exchanged"
            )
            return Mistake(text, rotated=True, voids_proof=True)
        if along > _COHERENT and abs(turn) > _WRONG:
            text = (
                f"poses move {math.degrees(turn):+.0f} deg beside where PX4's tilt drives the"
                " vehicle: x of the rigid body is not the nose, or the axes of the positions are"
                " not those of the attitude"
            )
            return Mistake(text, rotated=True, voids_proof=True)
        if level.time_s > _CONFIRMS_S and along > _COHERENT and abs(turn) < _RIGHT:
            self.confirmed = True
            self._follow_poses()
            self._ways.clear()
        return None

    def _compare_scale(self, now_ns: int) -> Mistake | None:
        """Compare how far the poses move; turns that agree excuse them after a strike."""
        if self._turns_agree and now_ns - self._strike_ns < _STRIKE_NS:
            return None
        for slope in (span.slope for span in self._spans if span.slope.time_s > _DECIDES_S):
            most, least = slope.slope + slope.error, slope.slope - slope.error
            wrong = (most < _SLOPE_LOW or least > _SLOPE_HIGH) and not self.confirmed
            if most < _SLOPE_STILL or (wrong and slope.slope < _STILL_SHARE):
                text = (
                    "poses do not show the motion that PX4's accelerometer measures: the tracked"
                    f" body {_name_motion(slope, 'moves')}; is it this vehicle?"
                )
                return Mistake(text, voids_proof=True)
            if wrong:
                text = (
                    f"positions move {slope.slope:.1f} times as far as PX4's accelerometer"
                    " measures: wrong scale or unit of the motion capture"
                )
                return Mistake(text, voids_proof=True)
        return None


def _name_motion(sums: MotionSums, moves: str) -> str:
    return "does not move" if sums.seen < _STILL_SHARE * sums.felt else f"{moves} otherwise"


class FlightWatch:
    """Decides whether, and why, a flight must end.

    Attributes:
        motion: of the poses since the arming, against PX4's sensors.
        pose_ns: arrival of the last pose that was sent.
        jump_ns: since when poses are elsewhere than PX4; None: they agree.
        distrusts: poses were judged wrong in this flight: none is sent before the disarming.
    """

    def __init__(self, params: BridgeParams, limits: FlightLimits) -> None:
        self._params = params
        self._limits = limits
        self.motion = PoseMotionWatch()
        self.pose_ns = 0
        self.jump_ns: int | None = None
        self.distrusts = False
        self._unfit_ns: int | None = None
        self._limit_ns: int | None = None
        self._was_armed = False
        self._beside_m = 0.0
        """Horizontal distance from the set point at the arming [m]."""
        self._begin_m = math.nan
        """Height of the pose at the arming, in map [m]."""
        self._lifted_ns: int | None = None

    def ceiling(self, now_ns: int, position: Array | None) -> float:
        """Return the highest place to fly to now, in map [m]: low until the axes have shown.

        Args:
            now_ns: the present.
            position: (3) of the newest pose [m].
        """
        if not self._was_armed or position is None or self.motion.confirmed:
            self._lifted_ns, self._begin_m = None, math.nan
            return math.inf
        height = float(position[2])
        if math.isnan(self._begin_m):
            self._begin_m = height
        if self._lifted_ns is None and height > self._begin_m + _LIFTED_M:
            self._lifted_ns = now_ns
        if not self._checks_takeoff(now_ns):
            return math.inf
        return self._begin_m + _CHECK_HEIGHT_M

    def _checks_takeoff(self, now_ns: int) -> bool:
        """Return whether the axes have to show yet."""
        waits = self._lifted_ns is None or now_ns - self._lifted_ns < _CHECK_NS
        return waits and not self.motion.confirmed

    def rest(self) -> None:
        """Forget since when something is wrong: the vehicle does not fly."""
        self._unfit_ns = self._limit_ns = None

    def follow(self, now_ns: int, armed: bool, takes_off: bool, beside_m: float) -> Mistake | None:
        """Compare the motion since the arming with that of PX4's sensors.

        Args:
            now_ns: the present.
            armed: the vehicle is.
            takes_off: it follows a mission that takes off.
            beside_m: horizontal distance from the set point.

        Returns:
            the mistake, in the tick in which it is detected.
        """
        motion = self.motion
        if armed != self._was_armed:
            self._was_armed, self.distrusts = armed, False
            if armed:
                motion.begin()
                self._beside_m = beside_m
            else:
                motion.end()
        if not armed:
            return None
        known = motion.mistake
        if takes_off and beside_m - self._beside_m > _TAKEOFF_DRIFT_M:
            motion.drifts(now_ns, beside_m)
        mistake = motion.compare()
        self.distrusts = self.distrusts or bool(mistake)
        return None if known else mistake

    def must_land(
        self, now_ns: int, odometry: VehicleOdometry | None, blocking: Sequence[PreflightFinding]
    ) -> str:
        """Return why the flight must end, "" if it may go on.

        Args:
            now_ns: the present.
            odometry: PX4's last estimate.
            blocking: findings with which the bridge would not arm.
        """
        if self.motion.mistake:
            return self.motion.mistake.text
        broken = "" if odometry is None else self._limits.broken(odometry)
        self._limit_ns = (self._limit_ns or now_ns) if broken else None
        limit_ns = self._limits.safety.limit_time * SECOND_NS
        if self._limit_ns is not None and now_ns - self._limit_ns > limit_ns:
            return broken
        pose_s = (now_ns - self.pose_ns) * 1e-9
        repeats = next((f.text for f in blocking if f.key == "pose_repeated"), "")
        if repeats and self._checks_takeoff(now_ns) and pose_s > _TAKEOFF_REPEATS_S:
            self.motion.accuse(Mistake(repeats))
            return repeats
        if pose_s > self._params.pose_loss_time:
            refused = next((f.text for f in blocking if f.key.startswith("pose_")), "")
            return refused or f"no mocap pose for {pose_s:.1f} s"
        if self.jump_ns is not None and now_ns - self.jump_ns > _JUMP_NS:
            return PoseRefusal.JUMP.text
        unfit = next((f.text for f in blocking if f.key in _UNFIT), "")
        self._unfit_ns = (self._unfit_ns or now_ns) if unfit else None
        if self._unfit_ns is None or now_ns - self._unfit_ns < _UNFIT_NS:
            return ""
        self.distrusts = True
        return unfit
