"""The estimator as a node sees it: samples with stamps in, estimates out, bad samples refused.

The same compiled functions as in the headless flight's loop; here samples may be lost, late,
doubled, or wrong, and the estimate begins in flight if it has to.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from tombo_control.autopilot import (
    HISTORY_TICKS,
    IDLE,
    LANDED,
    A,
    E,
    G,
    new_autopilot,
    restart_estimate,
)
from tombo_control.estimate import TICK_NS, Array, Estimate, nearest_tick
from tombo_control.estimator import correct, process_imu, store_history, update_body_rates
from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.pose_check import FRAME, MAX_FUTURE_NS, MAX_SQUARE_ERROR
from tombo_dynamics.core import ERROR, Core
from tombo_dynamics.jit import compiled, compiled_call
from tombo_dynamics.message_records import ESTIMATOR_STATUS, ODOMETRY, message_of
from tombo_dynamics.messages import EstimatorStatus, Imu, MissionStatus, Odometry, Pose
from tombo_dynamics.rotation import rotated
from tombo_dynamics.vehicle import VehicleParams

_INITIAL_POSES = 3
_JUMPS_TO_REINITIALIZE = 5
"""So many refused poses on end that agree with each other: the estimate is wrong, not they."""
_BRIDGE_TICKS = 100
"""Longest gap of the IMU that is bridged by its last sample."""
_MAX_INITIAL_GAP_NS = 250_000_000
_NO_STAMP = -1
_ODOMETRY_TICKS, _STATUS_TICKS = 4, 20
"""Ticks between two messages."""
_POSE_SILENT_NS, _IMU_SILENT_NS = 120_000_000, 50_000_000
"""Three and a half samples at 30 Hz; fifty of the IMU."""
_GRACE_NS = 3_000_000_000
"""Nodes start in any order: before the first message a sensor may be silent for so long."""
POSE_REFUSALS = (
    "",
    "wrong_frame",
    "not_finite",
    "not_unit",
    "future",
    "out_of_order",
    "late",
    "jump",
)
"""Why a pose is not used; empty if it is."""
_TAKEN, _WRONG_FRAME, _NOT_FINITE, _NOT_UNIT, _FUTURE, _OUT_OF_ORDER, _LATE, _JUMP = range(8)
_REFUSALS = (
    "",
    "a pose whose frame is not map",
    "a pose with NaN or infinity",
    "a pose whose quaternion is no rotation",
    "a pose stamped in the future",
    "a pose not newer than the one before",
    "a pose more than half a second old",
    "a pose too far from the estimate",
)
_PENDING = 16
"""Poses that can wait for the IMU sample of their time."""

ESTIMATOR = np.dtype(
    [
        ("running", np.bool_),  # there is a state
        ("known", np.bool_),  # and an estimate, at an IMU sample
        ("airborne", np.bool_),  # by the mission's phase: on the ground the velocity is zero
        ("stamp_ns", np.int64),  # of the last IMU sample; -1: none, as in the next ones
        ("next_tick", np.int64),  # tick of the state
        ("pose_stamp_ns", np.int64),  # of the last pose used
        ("newest_pose_ns", np.int64),  # of the last pose that came
        ("poses", np.int64),  # used
        ("rejected", np.int64),
        ("lost_samples", np.int64),  # IMU samples that never came
        ("imu", np.float64, 6),  # the last sample: gyro [rad/s], specific force [m/s^2]
        ("initial", np.int64),  # poses to begin from
        ("initial_ns", np.int64, _INITIAL_POSES),
        ("initial_poses", np.float64, (_INITIAL_POSES, 7)),
        ("pending", np.int64),  # poses that wait for their IMU sample
        ("pending_ticks", np.int64, _PENDING),
        ("pending_poses", np.float64, (_PENDING, 7)),
        ("jumps", np.int64),  # poses on end that were refused as jumps
        ("jump", np.float64, 3),  # position of the last of them [m]
        ("estimate", np.float64, 19),  # `Estimate`, flat: position to rates as in `A`
        ("odometry", ODOMETRY),
        ("status", ESTIMATOR_STATUS),
    ],
    align=True,
)
"""Bookkeeping of the estimator's core; its state is an autopilot's memory."""


@compiled_call
def reset_estimator(r: Any) -> None:
    """Forget the state; the next poses begin it anew."""
    r.running = False
    r.known = False
    r.initial = 0
    r.pending = 0
    r.jumps = 0
    r.newest_pose_ns = _NO_STAMP
    r.stamp_ns = _NO_STAMP


@compiled_call
def take_pose(
    r: Any, a: Array, stamp_ns: int, now_ns: int, position: Array, attitude: Array
) -> int:
    """Take a pose in map; return 0 or why it is not used, an index in `POSE_REFUSALS`.

    Args:
        r: the estimator's bookkeeping.
        a: the autopilot's memory.
        stamp_ns: time of capture.
        now_ns: time now, of the same clock.
        position: (3) of base_link [m].
        attitude: (4) xyzw, map from base_link; its length may be off by a tenth.
    """
    why = _check(r, stamp_ns, now_ns, position, attitude)
    if why == _TAKEN:
        r.newest_pose_ns = stamp_ns
        square = 0.0
        for i in range(4):
            square += attitude[i] * attitude[i]
        scale = 1.0 / math.sqrt(square)
        pose = np.empty(7)
        for i in range(3):
            pose[i] = position[i]
        for i in range(4):
            pose[3 + i] = scale * attitude[i]
        if not r.running:
            _initialize(r, a, stamp_ns, pose)
        else:
            why = _check_jump(r, a, stamp_ns, pose)
            if why == _TAKEN:
                _append_pending(r, nearest_tick(stamp_ns), pose)
    if why != _TAKEN:
        r.rejected += 1
    return why


@compiled_call
def _check(r: Any, stamp_ns: int, now_ns: int, position: Array, attitude: Array) -> int:
    total = position[0] + position[1] + position[2]
    square = 0.0
    for i in range(4):
        total += attitude[i]
        square += attitude[i] * attitude[i]
    if not math.isfinite(total):
        return _NOT_FINITE
    if abs(square - 1.0) > MAX_SQUARE_ERROR:
        return _NOT_UNIT
    if stamp_ns > now_ns + MAX_FUTURE_NS:
        return _FUTURE
    if stamp_ns <= r.newest_pose_ns:
        return _OUT_OF_ORDER
    return _LATE if now_ns - stamp_ns > (HISTORY_TICKS - 2) * TICK_NS else _TAKEN


@compiled_call
def _append_pending(r: Any, tick: int, pose: Array) -> None:
    """Keep a pose for its IMU sample; of too many the oldest is dropped."""
    if r.pending == _PENDING:
        _drop_first_pending(r)
    r.pending_ticks[r.pending] = tick
    for i in range(7):
        r.pending_poses[r.pending, i] = pose[i]
    r.pending += 1


@compiled_call
def _drop_first_pending(r: Any) -> None:
    r.pending -= 1
    for k in range(r.pending):
        r.pending_ticks[k] = r.pending_ticks[k + 1]
        for i in range(7):
            r.pending_poses[k, i] = r.pending_poses[k + 1, i]


@compiled_call
def _initialize(r: Any, a: Array, stamp_ns: int, pose: Array) -> None:
    """Begin the estimate from three poses on end: place, attitude, velocity."""
    if r.initial > 0 and stamp_ns - r.initial_ns[r.initial - 1] > _MAX_INITIAL_GAP_NS:
        r.initial = 0
    if r.initial == _INITIAL_POSES:  # the oldest goes
        r.initial -= 1
        for k in range(r.initial):
            r.initial_ns[k] = r.initial_ns[k + 1]
            for i in range(7):
                r.initial_poses[k, i] = r.initial_poses[k + 1, i]
    r.initial_ns[r.initial] = stamp_ns
    for i in range(7):
        r.initial_poses[r.initial, i] = pose[i]
    r.initial += 1
    if r.initial < _INITIAL_POSES or r.stamp_ns == _NO_STAMP:
        return
    lasted = (stamp_ns - r.initial_ns[0]) * 1e-9
    late = (r.next_tick - nearest_tick(stamp_ns)) * 1e-3
    velocity = np.empty(3)
    position = np.empty(3)
    for i in range(3):
        velocity[i] = (pose[i] - r.initial_poses[0, i]) / lasted
        position[i] = pose[i] + late * velocity[i]
    restart_estimate(a, position, velocity, pose[3:])
    a[A.mode + 2] = stamp_ns * 1e-9
    store_history(a, r.next_tick)
    r.running = True
    r.pose_stamp_ns = stamp_ns
    r.poses += 1
    r.initial = 0


@compiled_call
def _distance(pose: Array, x: float, y: float, z: float) -> float:
    x, y, z = pose[0] - x, pose[1] - y, pose[2] - z
    return math.sqrt(x * x + y * y + z * z)


@compiled_call
def _check_jump(r: Any, a: Array, stamp_ns: int, pose: Array) -> int:
    """Refuse a pose too far from the estimate, unless it comes again and again."""
    tick = nearest_tick(stamp_ns)
    slot = A.history + 8 * (tick % HISTORY_TICKS)
    x, y, z = a[slot], a[slot + 1], a[slot + 2]
    if tick > r.next_tick:  # the pose came before the IMU sample of its time
        ahead = (tick - r.next_tick) * 1e-3
        x = a[A.position] + ahead * a[A.velocity]
        y = a[A.position + 1] + ahead * a[A.velocity + 1]
        z = a[A.position + 2] + ahead * a[A.velocity + 2]
    elif a[slot + 7] != tick:
        return _TAKEN  # `correct` says so in its turn
    since = max(stamp_ns - r.pose_stamp_ns, 0) * 1e-9
    limit = a[E.jump_min] + a[E.jump_speed] * since
    if _distance(pose, x, y, z) <= limit:
        r.jumps = 0
        return _TAKEN
    if r.jumps > 0 and _distance(pose, r.jump[0], r.jump[1], r.jump[2]) > limit:
        r.jumps = 0
    r.jumps += 1
    for i in range(3):
        r.jump[i] = pose[i]
    if r.jumps >= _JUMPS_TO_REINITIALIZE:
        reset_estimator(r)
        r.newest_pose_ns = stamp_ns
    return _JUMP


@compiled
def take_imu(r: Any, a: Array, stamp_ns: int, gyro: Array, accel: Array) -> bool:
    """Take an IMU sample; return whether `estimate` holds a new estimate, at its capture.

    Args:
        r: the estimator's bookkeeping.
        a: the autopilot's memory.
        stamp_ns: time of capture; a sample that is not newer than the last is left out.
        gyro: (3) [rad/s], base_link.
        accel: (3) specific force [m/s^2], base_link.
    """
    if stamp_ns <= r.stamp_ns:
        if r.stamp_ns - stamp_ns > 1e9:  # the clock was set back: a new flight
            reset_estimator(r)
        return False
    tick = nearest_tick(stamp_ns)
    gap = tick - r.next_tick
    r.stamp_ns = stamp_ns
    if not r.running:
        r.next_tick = tick + 1
        return False
    if gap < 0:
        return False
    if gap > 0:
        r.lost_samples += gap
        if gap > _BRIDGE_TICKS:
            reset_estimator(r)
            return False
        process_imu(a, r.imu, r.next_tick, gap, r.airborne)
        r.next_tick = tick
    for i in range(3):
        r.imu[i] = gyro[i]
        r.imu[3 + i] = accel[i]
    while r.pending > 0 and r.pending_ticks[0] <= tick:
        captured = r.pending_ticks[0]
        period = captured * 1e-3 - a[A.mode + 2]
        if correct(a, r.pending_poses[0], 0, captured, tick, period, r.airborne):
            a[A.mode + 2] = max(a[A.mode + 2], captured * 1e-3)
            r.pose_stamp_ns = captured * TICK_NS
            r.poses += 1
        else:
            r.rejected += 1
        _drop_first_pending(r)
    update_body_rates(a, r.imu, 0)
    for i in range(A.leg):
        r.estimate[i] = a[i]
    r.known = True
    process_imu(a, r.imu, tick, 1, r.airborne)
    r.next_tick = tick + 1
    return True


@compiled_call
def odometry_due(stamp_ns: int) -> bool:
    """Return whether an estimate goes out as odometry."""
    return nearest_tick(stamp_ns) % _ODOMETRY_TICKS == 0


@compiled_call
def status_due(stamp_ns: int) -> bool:
    """Return whether a status goes out with an estimate."""
    return nearest_tick(stamp_ns) % _STATUS_TICKS == 0


@compiled_call
def fill_odometry(r: Any, out: Any) -> None:
    """Write the newest estimate as odometry: velocity in base_link."""
    e = r.estimate
    out.stamp_ns = r.stamp_ns
    q = out.attitude
    for i in range(4):
        q[i] = e[A.attitude + i]
    back = np.array([-q[0], -q[1], -q[2], q[3]])
    v = A.velocity
    x, y, z = rotated(back, e[v], e[v + 1], e[v + 2])
    out.velocity[0], out.velocity[1], out.velocity[2] = x, y, z
    for i in range(3):
        out.position[i] = e[A.position + i]
        out.rates[i] = e[A.rates + i]


@compiled_call
def fill_status(r: Any, out: Any) -> None:
    """Write the status that goes with the newest estimate."""
    out.stamp_ns = r.stamp_ns
    out.initialised = True
    for i in range(3):
        out.gyro_bias[i] = r.estimate[A.gyro_bias + i]
        out.accel_bias[i] = r.estimate[A.accel_bias + i]
    out.pose_stamp_ns = r.pose_stamp_ns
    out.poses = r.poses
    out.rejected = r.rejected


class EstimatorCore(Core):
    """Estimates pose and velocity from gyro, accelerometer and mocap poses.

    Refused poses and lost samples are counted; after a gap of the IMU of more than 0.1 s it
    begins anew.
    """

    name = "estimator"
    inputs = ("/mission/status", "/mocap/pose", "/imu/data_raw")
    outputs = ("/odometry", "/estimator/status")
    period_ns = 4_000_000
    sections: ClassVar[Mapping[str, type]] = {
        "estimator": EstimatorParams,
        "vehicle": VehicleParams,
    }

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
        self._vehicle = vehicle
        self.autopilot = self._fresh(params)
        """Memory of the estimate, `tombo_control.autopilot`."""
        self.memory: Any = np.zeros(1, ESTIMATOR)[0]
        reset_estimator(self.memory)
        self.memory["pose_stamp_ns"] = _NO_STAMP
        self.memory["airborne"] = True

    def _fresh(self, params: EstimatorParams) -> Array:
        level = np.array([0.0, 0.0, 0.0, 1.0])
        return new_autopilot(ControlParams(), params, self._vehicle, np.zeros(3), level)

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
                    self.health.report_event(f"pose_{why}", _REFUSALS[POSE_REFUSALS.index(why)])
        else:
            self.phase(message.phase)

    def _take_imu(self, sample: Imu) -> None:
        if not np.isfinite(sample.gyro.sum() + sample.accel.sum()):
            self.health.report_event("imu_not_finite", "imu sample with NaN or infinity")
        r, stamp_ns = self.memory, sample.stamp_ns
        if not take_imu(r, self.autopilot, stamp_ns, sample.gyro, sample.accel):
            return
        if odometry_due(stamp_ns):
            fill_odometry(r, r["odometry"])
            self._outputs.append(("/odometry", message_of(Odometry, r["odometry"])))
        if status_due(stamp_ns):
            fill_status(r, r["status"])
            self._outputs.append(("/estimator/status", message_of(EstimatorStatus, r["status"])))

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return what follows from the IMU samples since the last step."""
        if self._began_ns is None or now_ns < self._began_ns:
            self._began_ns = now_ns
        r, health = self.memory, self.health
        if not r["known"]:
            waited = now_ns - self._began_ns > _GRACE_NS
            health.fault("mocap_silent", waited and not r["initial"], "no mocap poses")
        else:
            age = int(now_ns - r["pose_stamp_ns"])
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
        self.memory["airborne"] = phase not in (IDLE, LANDED)

    def params(self, params: EstimatorParams) -> None:
        """Take other parameters; the estimate goes on."""
        self.autopilot[G[0] :] = self._fresh(params)[G[0] :]

    def pose(
        self, stamp_ns: int, now_ns: int, frame_id: str, position: Array, attitude: Array
    ) -> str:
        """Take a pose as `take_pose` does; return one of `POSE_REFUSALS`, empty if it is used."""
        if frame_id.lstrip("/") != FRAME:
            self.memory["rejected"] += 1
            return POSE_REFUSALS[_WRONG_FRAME]
        why = take_pose(self.memory, self.autopilot, stamp_ns, now_ns, position, attitude)
        return POSE_REFUSALS[why]

    def imu(self, stamp_ns: int, gyro: Array, accel: Array) -> Estimate | None:
        """Take an IMU sample as `take_imu` does; return the estimate, None without a new one."""
        known = take_imu(self.memory, self.autopilot, stamp_ns, gyro, accel)
        return self.estimate if known else None

    @property
    def estimate(self) -> Estimate | None:
        """The newest estimate."""
        r = self.memory
        if not r["known"]:
            return None
        e = r["estimate"].copy()
        a = A
        return Estimate(
            int(r["stamp_ns"]),
            e[a.position : a.position + 3],
            e[a.velocity : a.velocity + 3],
            e[a.attitude : a.attitude + 4],
            e[a.rates : a.rates + 3],
            e[a.gyro_bias : a.gyro_bias + 3],
            e[a.accel_bias : a.accel_bias + 3],
            int(r["pose_stamp_ns"]),
        )

    @property
    def poses(self) -> int:
        """Poses used."""
        return int(self.memory["poses"])

    @property
    def rejected(self) -> int:
        """Poses refused."""
        return int(self.memory["rejected"])

    @property
    def lost_samples(self) -> int:
        """IMU samples that never came."""
        return int(self.memory["lost_samples"])

    def reset(self) -> None:
        """Forget the state; the next poses begin it anew."""
        reset_estimator(self.memory)
