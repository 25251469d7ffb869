"""Preflight checks: are the poses valid, does PX4 fuse them, and does its estimate follow?

PX4 reports nothing about wrong axes, wrong stamps and poses that it does not fuse. Here each of
them is a `PreflightFinding`.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import takewhile
from typing import TypeVar

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.pose_tracks import bodies_apart
from tombo_dynamics.rotation import yaw_pitch_roll
from tombo_dynamics.time_base import SECOND_NS
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.bridge.bridge_params import SIMULATED, BridgeParams
from tombo_px4.bridge.hand_rotation_check import CARRY_M, TURN_RAD, HandVerdict, MotionCheck
from tombo_px4.bridge.pose_axes import AxesEvidence, explain_up, up_in_pose_body, valid_proof
from tombo_px4.bridge.vehicle_parameters import (
    DELAY_MAX,
    EV_DELAY,
    FindingSeverity,
    PreflightFinding,
    parameter_findings,
)
from tombo_px4.link.decoded_messages import EstimatorStatusFlags, VehicleImu, VehicleOdometry
from tombo_px4.link.link_params import MOCAP
from tombo_px4.link.timesync import TimeSync

_WINDOW_NS = SECOND_NS
_KEPT = 600
_ENOUGH = 8
_SLOWEST_HZ = 20.0
_STANDS_GYRO, _STANDS_ACCEL = 0.3, 0.5
"""[rad/s], [m/s^2]: a vehicle that stands shows less in a second."""
_NO_TURN, _NO_PUSH = 0.15, 0.8
"""[rad/s], [m/s^2]: a vehicle that stands still shows no more."""
_STILL_GYRO, _STILL_ACCEL = 1e-4, 1e-3
"""[rad/s], [m/s^2]: no sensor is as quiet as this, but a simulated one."""
_IN_FLIGHT = 5.0
"""In flight PX4's position may be off by so many times more."""
_ODOMETRY_SILENT_NS = 500_000_000
_ESTIMATOR_SILENT_NS = 5 * SECOND_NS
_PAIR_NS = 50_000_000
_DELAY_OFF_MS = 20.0
_OTHER_BODY_RAD = 0.035
"""The tilt of a body at rest against gravity tells it from another definition of it: 2 deg."""
_LARGEST_ROOM_M, _LARGEST_NOISE_M = 100.0, 0.02
"""[m]: places further from the origin, and more noise of a vehicle at rest, are wrong."""
_LONG_ROUND_TRIP_NS = 20_000_000
_REQUESTS_NS = 3 * SECOND_NS
_REFUSED = {
    PoseRefusal.FUTURE: (
        "mocap stamps are {ahead:.3g} s in the future: the clock of the mocap computer is ahead;"
        " let chrony or NTP set both clocks"
    ),
    PoseRefusal.LATE: (
        "mocap stamps are {age:.3g} s old when they arrive, accepted are {limit:g} s: the clock"
        " of the mocap computer is behind (chrony, NTP), or the network is late"
    ),
    PoseRefusal.WRONG_FRAME: "mocap poses are not in frame map: let the driver publish in map",
    PoseRefusal.NOT_FINITE: "mocap poses contain NaN or infinity: the tracker has lost the body",
    PoseRefusal.NOT_UNIT: "mocap quaternions are no rotations: the driver fills them wrongly",
    PoseRefusal.OUT_OF_ORDER: "mocap stamps do not grow: two drivers at work?",
    PoseRefusal.JUMP: (
        "mocap poses are elsewhere than PX4 in flight: another body, or exchanged markers"
    ),
    PoseRefusal.TWO_PUBLISHERS: "two nodes publish mocap poses: stop one of them",
    PoseRefusal.REPEATED: (
        "mocap repeats its last pose though the vehicle moves: the tracker does not see the body"
    ),
    PoseRefusal.DISTRUSTED: "poses were judged wrong in this flight: no pose is sent any more",
}
_WARNING = FindingSeverity.WARNING


@dataclass(frozen=True)
class _SentPose:
    stamp_ns: int
    arrival_ns: int
    position: Array
    attitude: Array


_Arrived = TypeVar("_Arrived", _SentPose, VehicleImu, VehicleOdometry)


class Preflight:
    """Collects the data of the last second; `findings` checks them."""

    def __init__(
        self, params: BridgeParams, system: int, proofs: Sequence[AxesEvidence] = ()
    ) -> None:
        """Make the checks, for a MAVLink system; `proofs` are those of the tracked body."""
        self._params = params
        self._system = system
        self._proofs = proofs
        self.vehicle = ""
        """Hardware id of the autopilot; empty: not known yet."""
        self._poses: deque[_SentPose] = deque(maxlen=_KEPT)
        self._refused: dict[PoseRefusal, tuple[int, float]] = {}
        self._imu: deque[VehicleImu] = deque(maxlen=_KEPT)
        self.odometry: deque[VehicleOdometry] = deque(maxlen=_KEPT)
        """PX4's estimates; the caller adds them."""
        self.estimator: EstimatorStatusFlags | None = None
        """What PX4 said last about its estimator; the caller sets it."""
        self._judged_ns = 0
        self.motion = MotionCheck(params.tilt_error_max)
        """What moving the vehicle by hand has shown."""
        self.evidence: AxesEvidence | None = None
        """The last proof of the axes of this body; None: there is none, or it was refuted."""
        self._new_evidence: AxesEvidence | None = None
        self._proved: HandVerdict | None = None
        self._refuted = ""
        """What was shown to be wrong, until a new proof."""

    def pose(self, stamp_ns: int, arrival_ns: int, position: Array, attitude: Array) -> None:
        """Take a pose that was sent to PX4."""
        self._poses.append(_SentPose(stamp_ns, arrival_ns, position, attitude))
        self.motion.pose(stamp_ns, position, attitude)

    def refused_pose(self, why: PoseRefusal, now_ns: int, age_s: float = 0.0) -> None:
        """Record a pose that was not sent, and its age."""
        self._refused[why] = (now_ns, age_s)

    def imu(self, sample: VehicleImu) -> None:
        """Take a sample of PX4's sensors."""
        self._imu.append(sample)
        if sample.stamp_ns is not None:
            self.motion.imu(sample.stamp_ns, sample.gyro, sample.accel)

    def reset(self) -> None:
        """Forget everything: another vehicle, a restart of it, or a clock that was set."""
        self._poses.clear()
        self._refused.clear()
        self._judged_ns = 0
        self._imu.clear()
        self.odometry.clear()
        self.estimator = None
        self.motion.reset()

    def take_vehicle(self, hardware_id: str) -> None:
        """Take the hardware id of the autopilot: the last proof with it is valid."""
        if hardware_id != self.vehicle:
            self.vehicle = hardware_id
            self.evidence = valid_proof(self._proofs, hardware_id)

    def take_evidence(self) -> AxesEvidence | None:
        """Return what has been shown since the last call, to be kept; None: nothing new."""
        evidence, self._new_evidence = self._new_evidence, None
        return evidence

    def refute(self, mistake: str, now_ns: int) -> None:
        """Record that the axes are wrong, whatever was proven before."""
        self.evidence, self._refuted = None, mistake
        self._new_evidence = self._evidence(now_ns, mistake)

    def _evidence(
        self, now_ns: int, mistake: str = "", tilt: tuple[float, ...] = ()
    ) -> AxesEvidence:
        date = str(np.datetime_as_string(np.datetime64(now_ns, "ns"), unit="s", timezone="UTC"))
        verdict = self.motion.verdict
        if verdict is None:
            return AxesEvidence(date, self._params.tracked_body, self.vehicle, mistake)
        return AxesEvidence(
            date,
            self._params.tracked_body,
            self.vehicle,
            mistake,
            tuple(round(v, 2) for v in verdict.turned),
            tuple(round(v, 2) for v in verdict.carried),
            round(1e3 * verdict.delay_s, 1) if math.isfinite(verdict.delay_s) else 0.0,
            tuple(round(v, 4) for v in tilt),
        )

    def latency_s(self, now_ns: int) -> float:
        """Return the usual time from a pose's capture to its arrival here [s]; NaN: no poses."""
        ages = [p.arrival_ns - p.stamp_ns for p in self._recent(now_ns)]
        return float(np.median(ages)) * 1e-9 if ages else math.nan

    @property
    def latest_position(self) -> Array | None:
        """Position (3) of the newest pose, map [m]; None: none has come."""
        return self._poses[-1].position if self._poses else None

    def pose_rate_hz(self, now_ns: int) -> float:
        """Return how many poses came within the last second."""
        return len(self._recent(now_ns)) / (_WINDOW_NS * 1e-9)

    def findings(
        self,
        now_ns: int,
        sync: TimeSync,
        parameters: Mapping[str, float | int],
        *,
        linked_ns: int,
        answered: int,
        flying: bool,
    ) -> list[PreflightFinding]:
        """Return what is wrong, the worst first.

        Args:
            now_ns: the present.
            sync: with the vehicle's clock.
            parameters: of the vehicle, as far as known.
            linked_ns: since when the vehicle is there.
            answered: how many of its TIMESYNC requests were answered.
            flying: it is in the air; what can be judged at rest only is left out.
        """
        findings = [
            *self._of_poses(now_ns, flying),
            *self._of_time(now_ns, sync, linked_ns, answered),
            *self._of_delay(now_ns, parameters),
            *parameter_findings(parameters, self._system),
        ]
        if self._params.mocap == MOCAP:
            text = (
                "poses go out as ATT_POS_MOCAP, which EKF2 does not fuse:"
                " set px4.mocap to odometry or vision"
            )
            findings.append(PreflightFinding("mocap_message", text))
        fused = not any(f.key in ("not_fused", "mocap_message") for f in findings)
        findings += self._of_estimate(now_ns, flying, fused)
        if not flying:
            findings += self._of_up(now_ns)
        findings += self._of_motion(now_ns, parameters, flying)
        return sorted(findings, key=lambda finding: -finding.weight)

    # --- The poses themselves -----------------------------------------------------------------

    def _recent(self, now_ns: int) -> list[_SentPose]:
        return _newest(self._poses, now_ns)

    def _of_poses(self, now_ns: int, flying: bool) -> Iterator[PreflightFinding]:
        refused = [
            (why, age_s)
            for why, (seen_ns, age_s) in self._refused.items()
            if now_ns - seen_ns <= _WINDOW_NS
        ]
        for why, age_s in refused:
            limit = self._params.pose_age_max
            text = _REFUSED[why].format(age=age_s, ahead=-age_s, limit=limit)
            yield PreflightFinding(f"pose_{why.key}", text)
        last = self._poses[-1].arrival_ns if self._poses else None
        if last is None or now_ns - last > self._params.pose_timeout * SECOND_NS:
            if not refused:
                age = "" if last is None else f" for {(now_ns - last) * 1e-9:.1f} s"
                text = (
                    f"no mocap pose has come{age}: is the driver running, is the body tracked,"
                    " is the topic /mocap/pose?"
                )
                yield PreflightFinding("pose_stale", text)
            return
        recent = self._recent(now_ns)
        if not flying and _frozen(recent) and self._trembles(now_ns):
            text = (
                "mocap pose is frozen: not one bit has changed for a second; the tracker repeats"
                " its last pose, the body is not seen (or it is simulated, without noise)"
            )
            yield PreflightFinding("pose_frozen", text, _WARNING)
        yield from _findings_of_place(recent, not flying and self._at_rest(now_ns))
        rate = self.pose_rate_hz(now_ns)
        if now_ns - self._poses[0].arrival_ns > _WINDOW_NS and rate < _SLOWEST_HZ:
            text = f"mocap poses come at {rate:.0f} Hz: EKF2 wants {_SLOWEST_HZ:.0f} Hz and more"
            yield PreflightFinding("pose_rate", text, _WARNING)

    def _trembles(self, now_ns: int) -> bool:
        """Return whether PX4's sensors show any noise: if not, nothing real is there to move."""
        samples = _newest(self._imu, now_ns)
        if len(samples) < _ENOUGH:
            return True
        gyro = np.std([s.gyro for s in samples], axis=0).max()
        accel = np.std([s.accel for s in samples], axis=0).max()
        return bool(gyro > _STILL_GYRO or accel > _STILL_ACCEL)

    # --- Time ---------------------------------------------------------------------------------

    def _of_time(
        self, now_ns: int, sync: TimeSync, linked_ns: int, answered: int
    ) -> Iterator[PreflightFinding]:
        if not sync.converged:
            text = (
                "TIMESYNC has not converged: PX4's answers are missing or too few; stamps can't"
                " be compared. Does the link work both ways?"
            )
            yield PreflightFinding("timesync", text)
            return
        if sync.rtt_ns is not None and sync.rtt_ns > _LONG_ROUND_TRIP_NS:
            text = (
                f"TIMESYNC takes {sync.rtt_ns * 1e-6:.0f} ms there and back: stamps are uncertain"
                " by half of it; a radio link, or a busy computer?"
            )
            yield PreflightFinding("timesync_slow", text, _WARNING)
        if answered == 0 and now_ns - linked_ns > _REQUESTS_NS:
            text = (
                "PX4 has not asked for our time (TIMESYNC): it takes the arrival of poses for"
                " their capture; enable TIMESYNC on its link (MAV_0_MODE onboard)"
            )
            yield PreflightFinding("timesync_unasked", text, _WARNING)

    def _of_delay(
        self, now_ns: int, parameters: Mapping[str, float | int]
    ) -> Iterator[PreflightFinding]:
        latency_ms = 1e3 * self.latency_s(now_ns)
        longest, extra = parameters.get(DELAY_MAX, math.inf), parameters.get(EV_DELAY, 0.0)
        if latency_ms + extra > longest:  # not so without poses: NaN
            text = (
                f"poses are {latency_ms + extra:.0f} ms old for EKF2 ({latency_ms:.0f} ms to here,"
                f" EKF2_EV_DELAY {extra:.0f} ms), it keeps {longest:.0f} ms (EKF2_DELAY_MAX) and"
                " drops older ones"
            )
            yield PreflightFinding("pose_delay", text)

    # --- PX4's use of the poses ---------------------------------------------------------------

    def _of_estimate(self, now_ns: int, flying: bool, fused: bool) -> Iterator[PreflightFinding]:
        state = self.estimator
        if state is not None and now_ns - state.arrival_ns <= _ESTIMATOR_SILENT_NS:
            if fused and self._recent(now_ns) and not (state.is_aided and state.has_position):
                text = (
                    "PX4 knows no position though poses are sent: nothing is fused; EKF2_EV_CTRL,"
                    " stamps, or poses that jump"
                )
                yield PreflightFinding("not_fused", text)
            # NaN where no source is fused; max() of it depends on the order
            ratios = (state.position_ratio, state.height_ratio)
            ratio = max((r for r in ratios if r > 1.0), default=0.0)
            if ratio > 1.0:
                text = (
                    f"PX4 refuses the poses: innovation test ratio {ratio:.1f}, accepted below 1;"
                    " its estimate is elsewhere: axes, stamps, or restart it"
                )
                yield PreflightFinding("poses_refused", text)
        last = self.odometry[-1] if self.odometry else None
        if last is None or now_ns - last.arrival_ns > _ODOMETRY_SILENT_NS:
            text = "PX4 sends no position (ODOMETRY): it has no estimate, or the link is too slow"
            yield PreflightFinding("no_position", text)
            return
        pairs = self._pairs(now_ns)
        if pairs is None:
            return
        ours, theirs, turn = pairs
        off, limit = math.dist(ours, theirs), self._params.position_error_max
        if off > limit * (_IN_FLIGHT if flying else 1.0):
            text = (
                f"PX4's position is {off:.2f} m away from the pose: pose ({_place(ours)}), PX4"
                f" ({_place(theirs)}); are the poses fused (EKF2_EV_CTRL 11, EKF2_HGT_REF 3), does"
                " another sensor, or another sender with other axes, feed PX4?"
            )
            yield PreflightFinding("position_differs", text)
        if abs(turn) > self._params.yaw_error_max:
            text = (
                f"yaw of mocap body differs from PX4 by {math.degrees(turn):+.0f} deg: x of the"
                " rigid body is not the nose, or PX4's heading comes from the magnetometer"
                " (EKF2_EV_CTRL bit 3)"
            )
            yield PreflightFinding("yaw_differs", text)

    def _pairs(self, now_ns: int) -> tuple[Array, Array, float] | None:
        """Return position of the pose, that of PX4, and yaw of the pose against PX4's.

        All of the same time, medians over the last second; None without enough of both.
        """
        recent = self._recent(now_ns)
        if len(recent) < _ENOUGH:
            return None
        stamps = np.array([p.stamp_ns for p in recent])
        lately = [o for o in _newest(self.odometry, now_ns) if o.stamp_ns is not None]
        if len(lately) < _ENOUGH:
            return None
        seen = np.array([o.stamp_ns for o in lately])
        right = np.clip(np.searchsorted(stamps, seen), 1, len(stamps) - 1)
        nearest = right - (seen - stamps[right - 1] < stamps[right] - seen)
        away = stamps[nearest] - seen
        near = np.abs(away) <= _PAIR_NS
        if near.sum() < _ENOUGH:
            return None
        nearest, away = nearest[near], away[near]
        theirs = np.array([o.position for o in lately])[near]
        theirs += 1e-9 * away[:, None] * np.array([o.velocity for o in lately])[near]
        ours = np.array([p.position for p in recent])[nearest]
        yaw = yaw_pitch_roll(np.array([o.attitude for o in lately])[near])[:, 0]
        our_yaw = yaw_pitch_roll(np.array([p.attitude for p in recent])[nearest])[:, 0]
        turn = float(np.angle(np.exp(1j * (our_yaw - yaw)).sum()))
        return np.median(ours, axis=0), np.median(theirs, axis=0), turn

    def _of_up(self, now_ns: int) -> Iterator[PreflightFinding]:
        recent = self._recent(now_ns)
        samples = _newest(self._imu, now_ns)
        if len(samples) < _ENOUGH:
            text = "PX4 sends no HIGHRES_IMU: which way is up can't be checked"
            yield PreflightFinding("no_imu", text)
            return
        if not recent:
            return
        gyro = np.mean([s.gyro for s in samples], axis=0)
        accel = np.mean([s.accel for s in samples], axis=0)
        push = abs(float(np.linalg.norm(accel)) - GRAVITY)
        if float(np.linalg.norm(gyro)) > _NO_TURN or push > _NO_PUSH:
            yield PreflightFinding("moved", "the vehicle is moved: put it down", _WARNING)
            return
        verdict = self.motion.verdict
        if verdict is not None and verdict.mistake and verdict.sure:
            return  # it says what is wrong
        if why := explain_up(recent[-1].attitude, accel, self._params.tilt_error_max):
            yield PreflightFinding("mocap_up", why)

    def _of_evidence(self, now_ns: int) -> Iterator[PreflightFinding]:
        """Yield what is missing of the proof of the axes; keep a new one, of a vehicle at rest."""
        verdict, evidence = self.motion.verdict, self.evidence
        tilt = self._tilt_at_rest(now_ns)
        new = verdict is not None and verdict.proven and verdict is not self._proved
        if new and tilt is not None:
            self._proved = verdict
            evidence = self.evidence = self._new_evidence = self._evidence(now_ns, tilt=tilt)
            self._refuted = ""
        if self._params.axes_evidence == SIMULATED and not self._refuted:
            return
        because = f" ({self._refuted})" if self._refuted else ""
        if (
            evidence is not None
            and tilt is not None
            and (math.dist(evidence.tilt_rad, tilt) > _OTHER_BODY_RAD)
        ):
            degrees = math.degrees(math.dist(evidence.tilt_rad, tilt))
            because = (
                f" (the proof of {evidence.date} was of another body: it lay {degrees:.1f} deg"
                " differently in the vehicle)"
            )
        elif evidence is not None:
            return
        text = (
            f"the axes of the poses are not proven{because}: propellers off, turn the vehicle by"
            f" hand about each axis, {TURN_RAD:g} rad in all, and carry it briskly, {CARRY_M:g} m"
            " in all along each axis, within 40 s; then put it down"
        )
        if verdict is not None:
            turned = ", ".join(f"{v:.1f}" for v in verdict.turned)
            carried = ", ".join(f"{v:.1f}" for v in verdict.carried)
            least = f"{verdict.least_carried:.1f}"
            text += (
                f" (until now: turned {turned} rad, carried {carried} m, {least} m in the"
                " direction of least motion)"
            )
        yield PreflightFinding("axes_unproven", text)

    def _at_rest(self, now_ns: int) -> bool:
        """Return whether PX4's sensors show a vehicle that stands."""
        samples = _newest(self._imu, now_ns)
        if len(samples) < _ENOUGH:
            return False
        gyro = np.array([s.gyro for s in samples])
        accel = np.array([s.accel for s in samples])
        return bool(
            np.ptp(gyro, axis=0).max() < _STANDS_GYRO and accel.std(axis=0).max() < _STANDS_ACCEL
        )

    def _tilt_at_rest(self, now_ns: int) -> tuple[float, float] | None:
        """Return how the tracked body's z is tilted in the vehicle; None: it is moved."""
        samples, poses = _newest(self._imu, now_ns), self._recent(now_ns)
        if len(poses) < _ENOUGH or not self._at_rest(now_ns):
            return None
        accel = np.array([s.accel for s in samples])
        tilts = [up_in_pose_body(p.attitude, accel.mean(axis=0)) for p in poses]
        about_y, about_x = np.mean(tilts, axis=0).tolist()
        return about_y, about_x

    def _of_motion(
        self, now_ns: int, parameters: Mapping[str, float | int], flying: bool
    ) -> Iterator[PreflightFinding]:
        """Yield findings on axes and delay from the last rotation by hand."""
        if not flying and now_ns - self._judged_ns >= _WINDOW_NS:
            self._judged_ns = now_ns
            self.motion.judge(now_ns)
        if flying:
            self.motion.forget()
        else:
            yield from self._of_evidence(now_ns)
        verdict = self.motion.verdict
        if verdict is None:
            return
        if verdict.mistake:
            if verdict.sure and self.evidence is not None:
                self.refute(verdict.mistake, now_ns)
            yield PreflightFinding("mocap_axes", verdict.mistake)
            return
        delay_ms, told_ms = 1e3 * verdict.delay_s, parameters.get(EV_DELAY, 0.0)
        if abs(delay_ms - told_ms) > _DELAY_OFF_MS:
            text = (
                f"poses show the vehicle as it was {delay_ms:.0f} ms before their stamps (gyro"
                f" compared), EKF2_EV_DELAY is {told_ms:.0f} ms: let the driver stamp the capture,"
                f" or set it to {max(delay_ms, 0.0):.0f}"
            )
            yield PreflightFinding("stamp_delay", text, _WARNING)


def _frozen(recent: list[_SentPose]) -> bool:
    """Return whether no bit of the poses has changed for most of the last second."""
    if len(recent) < _ENOUGH or recent[-1].arrival_ns - recent[0].arrival_ns < 0.8e9:
        return False
    first = recent[0]
    return all(
        np.array_equal(p.position, first.position) and np.array_equal(p.attitude, first.attitude)
        for p in recent
    )


def _findings_of_place(recent: list[_SentPose], at_rest: bool) -> Iterator[PreflightFinding]:
    """Yield findings on poses not in metres, of several bodies, or of a body moving at rest."""
    if len(recent) < _ENOUGH:
        return
    place = np.array([p.position for p in recent])
    apart = bodies_apart(place)
    size, spread = float(np.abs(place).max()), float(place.std(axis=0).max())
    if size > _LARGEST_ROOM_M:
        where = _place(np.median(place, axis=0))
        text = (
            f"mocap poses are not in metres (millimetres?): ({where}); let the driver send metres"
        )
        yield PreflightFinding("pose_unit", text)
    elif apart > 0.0:
        text = (
            f"mocap poses of two bodies or more take turns in one topic, {apart:.2f} m apart: give"
            " each body a topic of its own"
        )
        yield PreflightFinding("pose_bodies", text)
    elif at_rest and spread > _LARGEST_NOISE_M:
        text = (
            f"mocap poses move by {spread:.2g} m (standard deviation) while PX4's sensors are at"
            " rest: another body is tracked, or poses are in millimetres"
        )
        yield PreflightFinding("pose_moves", text)


def _place(position: Array) -> str:
    return ", ".join(f"{p:.2f}" for p in position)


def _newest(records: deque[_Arrived], now_ns: int) -> list[_Arrived]:
    """Return those of the last second, oldest first, without looking at the older ones."""
    recent = list(takewhile(lambda r: now_ns - r.arrival_ns < _WINDOW_NS, reversed(records)))
    return recent[::-1]
