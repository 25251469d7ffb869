"""Preflight: collects poses and telemetry, keeps the proof of the axes, asks the checklist."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from itertools import takewhile
from typing import TypeVar

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.input_check import PoseRefusal
from tombo_dynamics.time_base import SECOND_NS
from tombo_px4.bridge.bridge_params import BridgeParams
from tombo_px4.bridge.checklist import (
    TILT_OFF_RAD,
    CheckState,
    PreflightFinding,
    SentPose,
    findings_of,
    latency_s,
)
from tombo_px4.bridge.hand_rotation_check import HandVerdict, MotionCheck
from tombo_px4.bridge.pose_axes import AxesEvidence, valid_proof
from tombo_px4.link.decoded_messages import EstimatorStatusFlags, VehicleImu, VehicleOdometry
from tombo_px4.link.timesync import TimeSync

_WINDOW_NS = SECOND_NS
_KEPT = 600
_Arrived = TypeVar("_Arrived", SentPose, VehicleImu, VehicleOdometry)


class Preflight:
    """Collects the data of the last second; `findings` checks them.

    Attributes:
        vehicle: hardware id of the autopilot; empty: not known yet.
        odometry: PX4's estimates; the caller adds them.
        estimator: what PX4 said last about its estimator; the caller sets it.
        motion: what moving the vehicle by hand has shown.
        evidence: the last proof of the axes of this body; None: there is none, or it was refuted.
    """

    def __init__(self, params: BridgeParams, proofs: Sequence[AxesEvidence] = ()) -> None:
        """Make the checks; `proofs` are those of the tracked body."""
        self._params, self._proofs = params, proofs
        self.vehicle = ""
        self._poses: deque[SentPose] = deque(maxlen=_KEPT)
        self._refused: dict[PoseRefusal, tuple[int, float]] = {}
        self._imu: deque[VehicleImu] = deque(maxlen=_KEPT)
        self.odometry: deque[VehicleOdometry] = deque(maxlen=_KEPT)
        self.estimator: EstimatorStatusFlags | None = None
        self._judged_ns = 0
        self.motion = MotionCheck(TILT_OFF_RAD)
        self.evidence: AxesEvidence | None = None
        self._new_evidence: AxesEvidence | None = None
        self._proved: HandVerdict | None = None
        self._refuted = ""

    def pose(self, stamp_ns: int, arrival_ns: int, position: Array, attitude: Array) -> None:
        """Take a pose that was sent to PX4."""
        self._poses.append(SentPose(stamp_ns, arrival_ns, position, attitude))
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
        for samples in (self._poses, self._refused, self._imu, self.odometry):
            samples.clear()
        self._judged_ns, self.estimator = 0, None
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
        self._new_evidence = self._evidence(now_ns, mistake=mistake)

    def latency_s(self, now_ns: int) -> float:
        """Return the usual time from a pose's capture to its arrival here [s]; NaN: no poses."""
        return latency_s(_lately(self._poses, now_ns))

    @property
    def latest_position(self) -> Array | None:
        """Position (3) of the newest pose, map [m]; None: none has come."""
        return self._poses[-1].position if self._poses else None

    def pose_rate_hz(self, now_ns: int) -> float:
        """Return how many poses came within the last second."""
        return len(_lately(self._poses, now_ns)) / (_WINDOW_NS * 1e-9)

    def findings(
        self,
        now_ns: int,
        sync: TimeSync,
        values: Mapping[str, float | int],
        *,
        linked_ns: int,
        answered: int,
        flying: bool,
        unwritten: Mapping[str, float] | None = None,
    ) -> list[PreflightFinding]:
        """Return what is wrong, the worst first; for the arguments see `CheckState`."""
        self._judge_motion(now_ns, flying)
        state = CheckState(
            now_ns,
            self._params,
            values,
            unwritten or {},
            sync,
            answered,
            linked_ns,
            flying,
            _lately(self._poses, now_ns),
            _lately(self._imu, now_ns),
            _lately(self.odometry, now_ns),
            self._poses[0].arrival_ns if self._poses else 0,
            self._poses[-1].arrival_ns if self._poses else 0,
            {w: age for w, (at, age) in self._refused.items() if now_ns - at <= _WINDOW_NS},
            self.estimator,
            self.motion.verdict,
            self.evidence,
            self._refuted,
        )
        if not flying:
            self._keep_proof(state)
        return findings_of(state)

    def _judge_motion(self, now_ns: int, flying: bool) -> None:
        """Judge a motion by hand once a second; what shows a mistake refutes the proof."""
        if flying:
            self.motion.forget()
        elif now_ns - self._judged_ns >= _WINDOW_NS:
            self._judged_ns = now_ns
            self.motion.judge(now_ns)
        verdict = self.motion.verdict
        if verdict is not None and verdict.mistake and verdict.sure and self.evidence is not None:
            self.refute(verdict.mistake, now_ns)

    def _keep_proof(self, state: CheckState) -> None:
        """Keep a new proof, once the vehicle rests."""
        verdict, tilt = state.verdict, state.tilt_at_rest
        if verdict is None or not verdict.proven or verdict is self._proved or tilt is None:
            return
        self._proved, self._refuted, state.refuted = verdict, "", ""
        self.evidence = state.proof = self._evidence(state.now_ns, tilt=tilt)
        self._new_evidence = self.evidence

    def _evidence(
        self, now_ns: int, mistake: str = "", tilt: tuple[float, ...] = ()
    ) -> AxesEvidence:
        date = str(np.datetime_as_string(np.datetime64(now_ns, "ns"), unit="s", timezone="UTC"))
        kept = tuple(round(v, 4) for v in tilt)
        return AxesEvidence(date, self._params.tracked_body, self.vehicle, mistake, kept)


def _lately(samples: deque[_Arrived], now_ns: int) -> list[_Arrived]:
    """Return those of the last second, oldest first, without looking at the older ones."""
    recent = list(takewhile(lambda s: now_ns - s.arrival_ns < _WINDOW_NS, reversed(samples)))
    return recent[::-1]
