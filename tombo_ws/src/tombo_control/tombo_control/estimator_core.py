"""The estimator as a node sees it: samples with stamps in, estimates out, bad samples refused.

The same compiled functions as in the headless flight's loop; here samples may be lost, late,
doubled, or wrong, and the estimate begins in flight if it has to.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from tombo_control.autopilot import HISTORY_TICKS, IDLE, LANDED, A, G, new_autopilot, part
from tombo_control.estimate import TICK_NS, Array, Estimate, nearest_tick
from tombo_control.estimator import correct, process_imu, store_history, update_body_rates
from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.pose_check import check_pose
from tombo_dynamics.core import ERROR, Core
from tombo_dynamics.messages import EstimatorStatus, Imu, MissionStatus, Odometry, Pose
from tombo_dynamics.rotation import rotate_vectors
from tombo_dynamics.vehicle import VehicleParams

_INITIAL_POSES = 3
_JUMPS_TO_REINITIALIZE = 5
"""So many refused poses on end that agree with each other: the estimate is wrong, not they."""
_BRIDGE_TICKS = 100
"""Longest gap of the IMU that is bridged by its last sample."""
_NO_STAMP = -1
_ODOMETRY_TICKS, _STATUS_TICKS = 4, 20
"""Ticks between two messages."""
_POSE_SILENT_NS, _IMU_SILENT_NS = 120_000_000, 50_000_000
"""Three and a half samples at 30 Hz; fifty of the IMU."""
_GRACE_NS = 3_000_000_000
"""Nodes start in any order: before the first message a sensor may be silent for so long."""
_REFUSALS = {
    "wrong_frame": "a pose whose frame is not map",
    "not_finite": "a pose with NaN or infinity",
    "not_unit": "a pose whose quaternion is no rotation",
    "future": "a pose stamped in the future",
    "out_of_order": "a pose not newer than the one before",
    "late": "a pose more than half a second old",
    "jump": "a pose too far from the estimate",
}


class EstimatorCore(Core):
    """Estimates pose and velocity from gyro, accelerometer and mocap poses.

    Refused poses and lost samples are counted; after a gap of the IMU of more than 0.1 s it
    begins anew.
    """

    name = "estimator"
    inputs = ("/mission/status", "/mocap/pose", "/imu/data_raw")
    outputs = ("/odometry", "/estimator/status")
    period_ns = 4_000_000
    sections = {"estimator": EstimatorParams, "vehicle": VehicleParams}

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> EstimatorCore:
        """Return a new estimator."""
        return cls(records["estimator"], records["vehicle"])

    def __init__(self, params: EstimatorParams, vehicle: VehicleParams) -> None:
        super().__init__()
        self._outputs: list[tuple[str, Any]] = []
        self._multiple_publishers: set[str] = set()
        self._began_ns: int | None = None
        self._imu_ns: int | None = None
        """When the last IMU sample came."""
        self._params = params
        self._vehicle = vehicle
        self._a: Array | None = None
        self._imu = np.zeros(6)
        self._estimate: Estimate | None = None
        self._stamp_ns = _NO_STAMP
        self._next_tick = 0
        self._pose_stamp_ns = _NO_STAMP
        self._newest_pose_ns = _NO_STAMP
        self._initial_poses: list[tuple[int, Array]] = []
        self._pending_poses: deque[tuple[int, Array]] = deque(maxlen=16)
        self._rejected_jumps: list[Array] = []
        self._airborne = True
        self.poses = 0
        """Poses used."""
        self.rejected = 0
        """Poses refused."""
        self.lost_samples = 0
        """IMU samples that never came."""

    def on(self, topic: str, message: Pose | Imu | MissionStatus, now_ns: int) -> None:
        """Take a pose, an IMU sample or the mission's phase."""
        if isinstance(message, Imu):
            self._imu_ns = now_ns
            if topic not in self._multiple_publishers:
                self._take_imu(message)
        elif isinstance(message, Pose):
            if topic not in self._multiple_publishers:
                why = self.pose(
                    message.stamp_ns,
                    now_ns + self.clock_slack_ns,
                    message.frame_id,
                    message.position,
                    message.attitude,
                )
                if why:
                    self.health.report_event(f"pose_{why}", _REFUSALS[why])
        else:
            self.phase(message.phase)

    def _take_imu(self, sample: Imu) -> None:
        if not np.isfinite(sample.gyro.sum() + sample.accel.sum()):
            self.health.report_event("imu_not_finite", "imu sample with NaN or infinity")
        estimate = self.imu(sample.stamp_ns, sample.gyro, sample.accel)
        if estimate is None:
            return
        tick = nearest_tick(estimate.stamp_ns)
        if tick % _ODOMETRY_TICKS == 0:
            x, y, z, w = estimate.attitude
            velocity = rotate_vectors(np.array([-x, -y, -z, w]), estimate.velocity)
            odometry = Odometry(
                estimate.stamp_ns, estimate.position, estimate.attitude, velocity, estimate.rates
            )
            self._outputs.append(("/odometry", odometry))
        if tick % _STATUS_TICKS == 0:
            status = EstimatorStatus(
                estimate.stamp_ns,
                True,
                estimate.gyro_bias,
                estimate.accel_bias,
                estimate.pose_stamp_ns,
                self.poses,
                self.rejected,
            )
            self._outputs.append(("/estimator/status", status))

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return what follows from the IMU samples since the last step."""
        if self._began_ns is None or now_ns < self._began_ns:
            self._began_ns = now_ns
        estimate, health = self._estimate, self.health
        if estimate is None:
            waited = now_ns - self._began_ns > _GRACE_NS
            health.fault("mocap_silent", waited and not self._initial_poses, "no mocap poses")
        else:
            age = now_ns - estimate.pose_stamp_ns
            text = f"the last mocap pose is {age * 1e-9:.2f} s old"
            health.fault("mocap_silent", age > _POSE_SILENT_NS, text)
            health.values["mocap_age_s"] = round(age * 1e-9, 3)
        silent_ns = now_ns - (self._imu_ns or self._began_ns + _GRACE_NS)
        health.fault("imu_silent", silent_ns > _IMU_SILENT_NS, "no imu samples", ERROR)
        health.values["poses"] = self.poses
        health.values["poses_rejected"] = self.rejected
        health.values["imu_lost"] = self.lost_samples
        outputs, self._outputs = self._outputs, []
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take other bandwidths in flight; another vehicle at the next start only."""
        if section == "estimator":
            self.params(params)
        else:
            self.health.fault("not_at_runtime", True, f"{section} is used at the next start")

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Use nothing of a topic with several publishers: nobody can tell which is true."""
        (self._multiple_publishers.add if several else self._multiple_publishers.discard)(topic)

    def phase(self, phase: int) -> None:
        """Take the mission's phase: on the ground the velocity is zero."""
        self._airborne = phase not in (IDLE, LANDED)

    def params(self, params: EstimatorParams) -> None:
        """Take other parameters; the estimate goes on."""
        self._params = params
        if self._a is not None:
            fresh = new_autopilot(
                ControlParams(), params, self._vehicle, self._a[:3], part(self._a, "attitude")
            )
            self._a[G[0] :] = fresh[G[0] :]

    def pose(
        self, stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array
    ) -> str:
        """Take a pose of the motion capture.

        Args:
            stamp_ns: time of capture.
            now_ns: time now, of the same clock.
            frame_id: must be `map`.
            position: (3) of base_link [m].
            attitude: (4) xyzw, map from base_link; its length may be off by a tenth.

        Returns:
            "" if it will be used, else why not: wrong_frame, not_finite, not_unit, future,
            out_of_order, late, jump.
        """
        why = self._refuse(stamp_ns, now_ns, frame_id, position, attitude)
        if not why:
            self._newest_pose_ns = stamp_ns
            pose = np.concatenate([position, attitude / np.linalg.norm(attitude)])
            if self._a is None:
                self._initialize(stamp_ns, pose)
            else:
                why = self._check_jump(stamp_ns, pose)
                if not why:
                    self._pending_poses.append((nearest_tick(stamp_ns), pose))
        if why:
            self.rejected += 1
        return why

    def imu(self, stamp_ns: int, gyro: Array, accel: Array) -> Estimate | None:
        """Take an IMU sample; return the estimate at its capture, None while there is none.

        Args:
            stamp_ns: time of capture; a sample that is not newer than the last is left out.
            gyro: (3) [rad/s], base_link.
            accel: (3) specific force [m/s^2], base_link.
        """
        if stamp_ns <= self._stamp_ns:
            if self._stamp_ns - stamp_ns > 1e9:  # the clock was set back: a new flight
                self.reset()
            return None
        tick = nearest_tick(stamp_ns)
        gap = tick - self._next_tick
        self._stamp_ns = stamp_ns
        if self._a is None:
            self._next_tick = tick + 1
            return None
        if gap < 0:
            return None
        if gap > 0:
            self.lost_samples += gap
            if gap > _BRIDGE_TICKS:
                self.reset()
                return None
            process_imu(self._a, self._imu, self._next_tick, gap, self._airborne)
            self._next_tick = tick
        self._imu[:3] = gyro
        self._imu[3:] = accel
        a = self._a
        while self._pending_poses and self._pending_poses[0][0] <= tick:
            captured, pose = self._pending_poses.popleft()
            period = captured * 1e-3 - a[A.mode + 2]
            if correct(a, pose, 0, captured, tick, period, self._airborne):
                a[A.mode + 2] = max(float(a[A.mode + 2]), captured * 1e-3)
                self._pose_stamp_ns = captured * TICK_NS
                self.poses += 1
            else:
                self.rejected += 1
        update_body_rates(a, self._imu, 0)
        state = a[: A.leg].copy()
        self._estimate = Estimate(
            stamp_ns,
            part(state, "position"),
            part(state, "velocity"),
            part(state, "attitude"),
            part(state, "rates"),
            part(state, "gyro_bias"),
            part(state, "accel_bias"),
            self._pose_stamp_ns,
        )
        process_imu(a, self._imu, tick, 1, self._airborne)
        self._next_tick = tick + 1
        return self._estimate

    @property
    def estimate(self) -> Estimate | None:
        """The newest estimate."""
        return self._estimate

    def reset(self) -> None:
        """Forget the state; the next poses begin it anew."""
        self._a = self._estimate = None
        self._initial_poses.clear()
        self._pending_poses.clear()
        self._rejected_jumps.clear()
        self._newest_pose_ns = _NO_STAMP
        self._stamp_ns = _NO_STAMP

    def _refuse(
        self, stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array
    ) -> str:
        why = check_pose(stamp_ns, now_ns, frame_id, position, attitude)
        if why:
            return why
        if stamp_ns <= self._newest_pose_ns:
            return "out_of_order"
        if now_ns - stamp_ns > (HISTORY_TICKS - 2) * TICK_NS:
            return "late"
        return ""

    def _initialize(self, stamp_ns: int, pose: Array) -> None:
        """Begin the estimate from three poses on end: place, attitude, velocity."""
        if self._initial_poses and stamp_ns - self._initial_poses[-1][0] > 0.25e9:
            self._initial_poses.clear()
        self._initial_poses.append((stamp_ns, pose))
        if len(self._initial_poses) < _INITIAL_POSES or self._stamp_ns == _NO_STAMP:
            del self._initial_poses[:-_INITIAL_POSES]
            return
        first_ns, first = self._initial_poses[0]
        velocity = (pose[:3] - first[:3]) / ((stamp_ns - first_ns) * 1e-9)
        late = (self._next_tick - nearest_tick(stamp_ns)) * 1e-3
        a = new_autopilot(
            ControlParams(), self._params, self._vehicle, pose[:3] + late * velocity, pose[3:]
        )
        part(a, "velocity")[:] = velocity
        a[A.mode + 2] = stamp_ns * 1e-9
        store_history(a, self._next_tick)
        self._a = a
        self._pose_stamp_ns = stamp_ns
        self.poses += 1
        self._initial_poses.clear()

    def _check_jump(self, stamp_ns: int, pose: Array) -> str:
        """Return "jump" for a pose too far from the estimate, unless it comes again and again."""
        assert self._a is not None
        tick = nearest_tick(stamp_ns)
        slot = A.history + 8 * (tick % HISTORY_TICKS)
        known = self._a[slot : slot + 3]
        if tick > self._next_tick:  # the pose came before the IMU sample of its time
            known = part(self._a, "position") + (tick - self._next_tick) * 1e-3 * part(
                self._a, "velocity"
            )
        elif self._a[slot + 7] != tick:
            return ""  # `correct` says so in its turn
        since = max(stamp_ns - self._pose_stamp_ns, 0) * 1e-9
        limit = self._params.jump_min + self._params.jump_speed * since
        if float(np.linalg.norm(pose[:3] - known)) <= limit:
            self._rejected_jumps.clear()
            return ""
        if (
            self._rejected_jumps
            and float(np.linalg.norm(pose[:3] - self._rejected_jumps[-1][:3])) > limit
        ):
            self._rejected_jumps.clear()
        self._rejected_jumps.append(pose)
        if len(self._rejected_jumps) >= _JUMPS_TO_REINITIALIZE:
            self.reset()
            self._newest_pose_ns = stamp_ns
        return "jump"
