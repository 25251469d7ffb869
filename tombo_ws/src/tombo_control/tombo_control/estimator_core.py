"""The estimator as a node sees it: samples with stamps in, estimates out, bad samples refused.

The same compiled functions as in the headless flight's loop; here samples may be lost, late,
doubled, or wrong, and the estimate begins in flight if it has to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from tombo_control.autopilot import (
    HISTORY_TICKS,
    Autopilot,
    EstimatedState,
    PoseAtTick,
    new_autopilot,
    restart_estimate,
)
from tombo_control.estimator import (
    attitude_gains,
    correct,
    correction_step,
    nearest_tick,
    observer_gains,
    process_imu,
    store_history,
    update_body_rates,
)
from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.uncertainty import (
    Uncertainty,
    begin_uncertainty,
    fill_covariance,
    take_gyro,
    take_innovation,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS, ERROR, START_GRACE_NS, Compiled, Core, Output
from tombo_dynamics.frames import is_map
from tombo_dynamics.input_check import MAX_POSE_AGE_NS, PoseRefusal, check_pose
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import EstimatorStatus, Imu, MissionStatus, Odometry, Phase, Pose
from tombo_dynamics.records import Record, field, fill_record
from tombo_dynamics.rotation import normalize_quaternion, rotated_back, rotation_vector
from tombo_dynamics.time_base import TICK_NS, TICK_S
from tombo_dynamics.vectors import AnyVector, add_scaled, dot, norm, store, subtract, vector
from tombo_dynamics.vehicle import VehicleParams

_INITIAL_POSES = 3
_JUMPS_TO_REINITIALIZE = 5
"""So many refused poses in a row that agree with each other: the estimate is wrong, not they."""
_BRIDGE_TICKS = 100
"""Longest gap of the IMU that is bridged by its last sample."""
_MAX_INITIAL_GAP_NS = 250_000_000
_NO_STAMP = -1
_ODOMETRY_TICKS, _STATUS_TICKS = 4, 20
"""Ticks between two messages."""
_POSE_SILENT_NS, _IMU_SILENT_NS = 120_000_000, 50_000_000
"""Three and a half samples at 30 Hz; fifty of the IMU."""
_PENDING = 16
"""Poses that can wait for the IMU sample of their time."""


class InitialPose(Record):
    """A pose that the estimate is begun from."""

    stamp_ns = field("ns", "capture", kind=int)
    position = field("m", "in map", 3)


class EstimatorMemory(Record):
    """Bookkeeping of the estimator's core; its state is an autopilot's memory."""

    running = field("1", "there is a state", kind=bool)
    known = field("1", "and an estimate, at an IMU sample", kind=bool)
    airborne = field("1", "by the mission's phase: on the ground velocity is zero", kind=bool)
    stamp_ns = field("ns", "of the last IMU sample; -1: none, as in the next ones", kind=int)
    next_tick = field("1", "tick of the state", kind=int)
    pose_stamp_ns = field("ns", "of the last pose used", kind=int)
    newest_pose_ns = field("ns", "of the last pose that came", kind=int)
    poses = field("1", "used", kind=int)
    rejected = field("1", "poses refused", kind=int)
    lost_samples = field("1", "IMU samples that never came", kind=int)
    gyro = field("rad/s", "of the last sample, body", 3)
    accel = field("m/s^2", "of the last sample: specific force, body", 3)
    initial = field("1", "how many poses there are to begin from", kind=int)
    initial_poses = field("", "these poses", _INITIAL_POSES, InitialPose)
    pending = field("1", "how many poses wait for their IMU sample", kind=int)
    pending_poses = field("", "these poses", _PENDING, PoseAtTick)
    jumps = field("1", "poses in a row that were refused as jumps", kind=int)
    jump = field("m", "position of the last of them, in map", 3)
    estimate = field("", "the newest, at the last IMU sample", kind=EstimatedState)
    uncertainty = field("", "of the estimate", kind=Uncertainty)
    odometry_due = field("1", "an estimate is to be published", kind=bool)
    status_due = field("1", "so is a status", kind=bool)


@compiled(inline=False)
def reset_estimator(memory: EstimatorMemory) -> None:
    """Reset the state; the next poses begin it again."""
    memory.running = False
    memory.known = False
    memory.initial = 0
    memory.pending = 0
    memory.jumps = 0
    memory.newest_pose_ns = _NO_STAMP
    memory.stamp_ns = _NO_STAMP


@compiled(inline=False)
def take_pose(
    memory: EstimatorMemory, autopilot: Autopilot, pose: Pose, now_ns: int
) -> PoseRefusal:
    """Take a pose in map; return why it is not used, a `PoseRefusal`.

    Args:
        memory: the estimator's bookkeeping.
        autopilot: state and history are used and written.
        pose: of base_link; the quaternion's length may be off by a tenth.
        now_ns: time now, of the stamp's clock.
    """
    stamp_ns, position, attitude = pose.stamp_ns, pose.position, pose.attitude
    why = check_pose(stamp_ns, now_ns, MAX_POSE_AGE_NS, position, attitude)
    if why == PoseRefusal.NONE and stamp_ns <= memory.newest_pose_ns:
        why = PoseRefusal.OUT_OF_ORDER
    if why == PoseRefusal.NONE:
        memory.newest_pose_ns = stamp_ns
        rotation = attitude.copy()
        normalize_quaternion(rotation)
        if not memory.running:
            why = _initialize(memory, autopilot, stamp_ns, position, rotation)
        else:
            why = _check_jump(memory, autopilot, stamp_ns, position)
            if why == PoseRefusal.NONE:
                _append_pending(memory, nearest_tick(stamp_ns), position, rotation)
    if why != PoseRefusal.NONE:
        memory.rejected += 1
    return why


@compiled(inline=False)
def _append_pending(memory: EstimatorMemory, tick: int, position: Array, attitude: Array) -> None:
    """Keep a pose for its IMU sample; of too many the oldest is dropped."""
    if memory.pending == _PENDING:
        _drop_first_pending(memory)
    pose = memory.pending_poses[memory.pending]
    pose.tick = tick
    store(pose.position, position)
    store(pose.attitude, attitude)
    memory.pending += 1


@compiled(inline=False)
def _drop_first_pending(memory: EstimatorMemory) -> None:
    memory.pending -= 1
    for k in range(memory.pending):
        memory.pending_poses[k] = memory.pending_poses[k + 1]


@compiled(inline=False)
def _initialize(
    memory: EstimatorMemory, autopilot: Autopilot, stamp_ns: int, position: Array, attitude: Array
) -> PoseRefusal:
    """Begin the estimate from three poses in a row: position, attitude, velocity.

    Poses of two bodies that take turns in the topic never do: each is a jump from the last.
    """
    poses, why = memory.initial_poses, PoseRefusal.NONE
    if memory.initial > 0:
        last = poses[memory.initial - 1]
        since_ns = stamp_ns - last.stamp_ns
        if _is_apart(autopilot.observer, position, last.position, since_ns):
            why = PoseRefusal.JUMP
        if why != PoseRefusal.NONE or since_ns > _MAX_INITIAL_GAP_NS:
            memory.initial = 0
    if memory.initial == _INITIAL_POSES:  # the oldest goes
        memory.initial -= 1
        for k in range(memory.initial):
            poses[k] = poses[k + 1]
    poses[memory.initial].stamp_ns = stamp_ns
    store(poses[memory.initial].position, position)
    memory.initial += 1
    if memory.initial < _INITIAL_POSES or memory.stamp_ns == _NO_STAMP:
        return why
    first = poses[0]
    lasted = (stamp_ns - first.stamp_ns) * 1e-9
    late = (memory.next_tick - nearest_tick(stamp_ns)) * TICK_S
    x, y, z = subtract(position, first.position)
    velocity = (x / lasted, y / lasted, z / lasted)
    restart_estimate(autopilot, add_scaled(position, late, velocity), velocity, attitude)
    autopilot.mocap_time = stamp_ns * 1e-9
    store_history(autopilot.state, autopilot.history, memory.next_tick)
    memory.running = True
    begin_uncertainty(memory.uncertainty, lasted)
    memory.pose_stamp_ns = stamp_ns
    memory.poses += 1
    memory.initial = 0
    return why


@compiled
def _is_apart(observer: Any, position: AnyVector, other: AnyVector, since_ns: int) -> bool:
    """Return whether two places are further apart than the vehicle moves within a time [ns]."""
    limit = observer.jump_min + observer.jump_speed * since_ns * 1e-9
    return bool(norm(subtract(position, other)) > limit)


@compiled(inline=False)
def _check_jump(
    memory: EstimatorMemory, autopilot: Autopilot, stamp_ns: int, position: Array
) -> PoseRefusal:
    """Refuse a pose too far from the estimate, unless it comes again and again."""
    tick = nearest_tick(stamp_ns)
    state, observer = autopilot.state, autopilot.observer
    past = autopilot.history[tick % HISTORY_TICKS]
    expected = vector(past.position)
    if tick > memory.next_tick:  # the pose came before the IMU sample of its time
        ahead = (tick - memory.next_tick) * TICK_S
        expected = add_scaled(state.position, ahead, state.velocity)
    elif past.tick != tick:
        return PoseRefusal.NONE  # `correct` says so in its turn
    since_ns = max(stamp_ns - memory.pose_stamp_ns, 0)
    if not _is_apart(observer, position, expected, since_ns):
        memory.jumps = 0
        return PoseRefusal.NONE
    if memory.jumps > 0 and _is_apart(observer, position, memory.jump, since_ns):
        memory.jumps = 0
    memory.jumps += 1
    store(memory.jump, position)
    if memory.jumps >= _JUMPS_TO_REINITIALIZE:
        reset_estimator(memory)
        memory.newest_pose_ns = stamp_ns
    return PoseRefusal.JUMP


@compiled
def take_imu(memory: EstimatorMemory, autopilot: Autopilot, imu: Imu, now_ns: int) -> None:
    """Take an IMU sample; one that is not newer than the last is left out.

    `estimate` is then at its capture, and the flags say which messages are due with it.
    """
    if _estimate(memory, autopilot, imu):
        tick = nearest_tick(imu.stamp_ns)
        memory.odometry_due = tick % _ODOMETRY_TICKS == 0
        memory.status_due = tick % _STATUS_TICKS == 0


@compiled
def _estimate(memory: EstimatorMemory, autopilot: Autopilot, imu: Imu) -> bool:
    """Carry the estimate on to an IMU sample; return whether there is a new one."""
    stamp_ns = imu.stamp_ns
    if stamp_ns <= memory.stamp_ns:
        if memory.stamp_ns - stamp_ns > CLOCK_SET_BACK_NS:
            reset_estimator(memory)
        return False
    tick = nearest_tick(stamp_ns)
    gap = tick - memory.next_tick
    memory.stamp_ns = stamp_ns
    if not memory.running:
        memory.next_tick = tick + 1
        return False
    if gap < 0:
        return False
    if gap > 0:
        memory.lost_samples += gap
        if gap > _BRIDGE_TICKS:
            reset_estimator(memory)
            return False
        process_imu(autopilot, memory.gyro, memory.accel, memory.next_tick, gap, memory.airborne)
        memory.next_tick = tick
    take_gyro(memory.uncertainty, imu.gyro)
    store(memory.gyro, imu.gyro)
    store(memory.accel, imu.accel)
    while memory.pending > 0 and memory.pending_poses[0].tick <= tick:
        pose, airborne = memory.pending_poses[0], memory.airborne
        captured = pose.tick
        period = captured * TICK_S - autopilot.mocap_time
        past = autopilot.history[captured % HISTORY_TICKS]
        turn = rotation_vector(pose.attitude, past.attitude)
        off = norm(subtract(past.position, pose.position))
        if correct(autopilot, pose.position, pose.attitude, captured, tick, period, airborne):
            observer, step = autopilot.observer, correction_step(period)
            place_gains = observer_gains(observer.position_bandwidth, step)
            turn_gains = attitude_gains(observer.attitude_bandwidth, step)
            squares = off * off / 3.0, dot(turn, turn) / 3.0
            take_innovation(memory.uncertainty, place_gains, turn_gains, step, airborne, *squares)
            autopilot.mocap_time = max(autopilot.mocap_time, captured * TICK_S)
            memory.pose_stamp_ns = captured * TICK_NS
            memory.poses += 1
        else:
            memory.rejected += 1
        _drop_first_pending(memory)
    memory.estimate = autopilot.state  # a copy right behind the rates would wait for them
    update_body_rates(autopilot.state, memory.gyro)
    memory.estimate.rates = vector(autopilot.state.rates)
    memory.known = True
    process_imu(autopilot, memory.gyro, memory.accel, tick, 1, memory.airborne)
    memory.next_tick = tick + 1
    return True


@compiled(inline=False)
def fill_odometry(memory: EstimatorMemory, out: Any) -> None:
    """Write the newest estimate as odometry: velocity in base_link."""
    estimate = memory.estimate
    out.stamp_ns = memory.stamp_ns
    out.velocity = rotated_back(estimate.attitude, estimate.velocity)
    out.position = estimate.position
    out.attitude = estimate.attitude
    out.rates = estimate.rates
    age = max(memory.stamp_ns - memory.pose_stamp_ns, 0) * 1e-9
    fill_covariance(memory.uncertainty, age, memory.airborne, out)


@compiled(inline=False)
def fill_status(memory: EstimatorMemory, out: Any) -> None:
    """Write the status that goes with the newest estimate."""
    out.stamp_ns = memory.stamp_ns
    out.initialised = True
    out.gyro_bias = memory.estimate.gyro_bias
    out.accel_bias = memory.estimate.accel_bias
    out.pose_stamp_ns = memory.pose_stamp_ns
    out.poses = memory.poses
    out.rejected = memory.rejected


@compiled(inline=False)
def take_phase(
    memory: EstimatorMemory, autopilot: Autopilot, status: MissionStatus, now_ns: int
) -> None:
    """Take the mission's phase: on the ground the velocity is zero."""
    memory.airborne = status.phase != Phase.IDLE and status.phase != Phase.LANDED


class EstimatorCore(Core):
    """Estimates pose and velocity from gyro, accelerometer and mocap poses.

    Refused poses and lost samples are counted; after a gap of the IMU of more than 0.1 s it
    begins again.
    """

    name = "estimator"
    inputs = ("/mission/status", "/mocap/pose", "/imu/data_raw")
    outputs: ClassVar[Mapping[str, Output]] = {
        "/odometry": Output(Odometry, fill_odometry, "odometry_due", every=_ODOMETRY_TICKS),
        "/estimator/status": Output(
            EstimatorStatus, fill_status, "status_due", every=_STATUS_TICKS
        ),
    }
    compiled = Compiled(
        ("memory", "autopilot"),
        (),
        {"/mission/status": take_phase, "/mocap/pose": take_pose, "/imu/data_raw": take_imu},
    )
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
        self._began_ns: int | None = None
        self._imu_ns: int | None = None
        """When the last IMU sample came."""
        level = np.array([0.0, 0.0, 0.0, 1.0])
        self.autopilot = new_autopilot(ControlParams(), params, vehicle, np.zeros(3), level)
        self.memory = EstimatorMemory.new()
        reset_estimator(self.memory)
        self.memory.pose_stamp_ns = _NO_STAMP
        self.memory.airborne = True

    def on(self, topic: str, message: Pose | Imu | MissionStatus, now_ns: int) -> None:
        """Take a pose, an IMU sample or the mission's phase."""
        if isinstance(message, Imu):
            self._imu_ns = now_ns
            if topic not in self.contested:
                self._take_imu(message, now_ns)
        elif isinstance(message, Pose):
            if topic not in self.contested:
                self._take_pose(message, now_ns + self.clock_slack_ns)
        else:
            self.take(topic, message, now_ns)

    def _take_pose(self, pose: Pose, now_ns: int) -> None:
        """Correct the estimate by a pose of base_link; report one that is refused.

        Frame names are texts, which compiled code does not see, so they are checked here.
        """
        if is_map(pose.frame_id):
            refusal = self.take("/mocap/pose", pose, now_ns)
        else:
            self.memory.rejected += 1
            refusal = PoseRefusal.WRONG_FRAME
        if refusal:
            self.health.report_event(f"pose_{refusal.key}", refusal.text)

    def _take_imu(self, sample: Imu, now_ns: int) -> None:
        """Carry the estimate on to an IMU sample; report one with NaN or infinity."""
        if not np.isfinite(sample.gyro.sum() + sample.accel.sum()):
            self.health.report_event("imu_not_finite", "imu sample with NaN or infinity")
        self.take("/imu/data_raw", sample, now_ns)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return the messages due since the last step."""
        if self._began_ns is None or now_ns < self._began_ns:
            self._began_ns = now_ns
        memory, health = self.memory, self.health
        if not memory.known:
            waited = now_ns - self._began_ns > START_GRACE_NS
            health.fault("mocap_silent", waited and not memory.initial, "no mocap poses")
        else:
            age = int(now_ns - memory.pose_stamp_ns)
            text = f"the last mocap pose is {age * 1e-9:.2f} s old"
            health.fault("mocap_silent", age > _POSE_SILENT_NS, text)
            health.values["mocap_age_s"] = round(age * 1e-9, 3)
        silent_ns = now_ns - (self._imu_ns or self._began_ns + START_GRACE_NS)
        health.fault("imu_silent", silent_ns > _IMU_SILENT_NS, "no imu samples", ERROR)
        health.values["poses"] = int(memory.poses)
        health.values["poses_rejected"] = int(memory.rejected)
        health.values["imu_lost"] = int(memory.lost_samples)
        return super().step(now_ns)

    def set_params(self, section: str, params: Any) -> None:
        """Take other bandwidths in flight."""
        if section == "estimator":
            fill_record(self.autopilot.observer, params)
