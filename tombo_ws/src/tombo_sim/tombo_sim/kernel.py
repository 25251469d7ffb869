"""The fused flight: plant, sensors and all five cores, tick by tick, compiled.

The same functions that the cores' shells call. `tombo_flight.run_wiring` flies the same flight in
plain Python, nodes in lockstep do over DDS; a test holds the three to the last bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tombo_collision.detector import EVENT as COLLISION
from tombo_collision.detector_core import DetectorCore
from tombo_collision.detector_core import take_pose as detector_pose
from tombo_collision.reaction_core import (
    ReactionCore,
    copy_setpoint,
    note_mocap,
    reaction_step,
    take_mission_setpoint,
    take_position,
)
from tombo_control.autopilot import BLIND, IDLE, LANDED, Autopilot
from tombo_control.cascade import cascade
from tombo_control.controller_core import (
    ControllerCore,
    ControllerMemory,
    answer_gyro,
    take_biases,
    take_odometry,
    take_setpoint,
)
from tombo_control.estimator_core import (
    EstimatorCore,
    EstimatorMemory,
    fill_odometry,
    fill_status,
    odometry_due,
    status_due,
    take_imu,
)
from tombo_control.estimator_core import take_pose as estimator_pose
from tombo_control.mission_core import MissionCore, mission_step, take_estimate, take_reaction
from tombo_dynamics import message_records as records
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import apply_imu, apply_mocap
from tombo_dynamics.jit import compiled, compiled_call
from tombo_dynamics.message_records import copy_event, copy_status
from tombo_dynamics.plant import P
from tombo_dynamics.records import Record, field
from tombo_dynamics.rigid_body import begin_tick, finish_tick
from tombo_dynamics.rotation import rotated
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_sim.flight_end import UNDECIDED, FlightEnd, watch_end
from tombo_sim.log_columns import AT

_MISSION_PERIOD_NS, _REACTION_PERIOD_NS = MissionCore.period_ns, ReactionCore.period_ns

NEXT_CAPTURE, OLDEST_UNDELIVERED, LAST_CAPTURED = range(3)
"""Meaning of the capture's integer state."""
STAMPED, ARRIVES, DELIVERED, POSE = 0, 1, 2, 3
"""Columns of the mocap table: capture as the stamp says it [ticks, with fraction], tick of arrival
(-1: dropped), 0/1, pose (7)."""
MOCAP_WIDTH = 10

(
    ODOMETRY,
    ESTIMATOR_STATUS,
    DETECTOR_STATUS,
    EVENT,
    REACTION_STATUS,
    SETPOINT,
    MISSION_SETPOINT,
    MISSION_STATUS,
) = range(8)
"""Index of a topic in `FlightProgress.published`: the fields of `Published` in their order."""


def _entry(message: type[Record], *more: Any) -> np.dtype[Any]:
    return np.dtype([("tick", np.int64), ("message", message.layout), *more], align=True)


class Published(NamedTuple):
    """What the cores have published, a table a topic: tick and message."""

    odometry: Any
    estimator_status: Any
    detector_status: Any
    """Also the row of the pose in the table of samples."""
    event: Any
    reaction_status: Any
    setpoint: Any
    mission_setpoint: Any
    mission_status: Any
    """Also the reason to wait, an index in `mission_core.WAIT_REASONS`."""


class CoreParams(NamedTuple):
    """Parameters of the cores as compiled code takes them."""

    detector: Any
    reaction: Any
    plan: Any
    mission: Any
    controller: Any


class FlightProgress(Record):
    """Where a fused flight stands."""

    tick = field("1", "the next one to fly", kind=int)
    end = field("1", "first tick not to fly", kind=int)
    phase = field("1", "the mission's, as published", kind=int)
    over = field("", "whether it is over", kind=FlightEnd)
    published = field("1", "messages in each table of `Published`", 8, int)
    read_odometry = field("1", "what the mission has taken of them", kind=int)
    read_reaction = field("1", "what the mission has taken of them", kind=int)
    read_setpoint = field("1", "what the mission has taken of them", kind=int)


def new_published(ticks: int, captures: int) -> Published:
    """Return empty tables for a flight of so many ticks and poses."""
    fast, slow = ticks // 4 + 64, ticks // 20 + 64
    return Published(
        np.zeros(fast, _entry(records.OdometryRecord)),
        np.zeros(slow, _entry(records.EstimatorStatusRecord)),
        np.zeros(captures + 1, _entry(records.DetectorStatusRecord, ("row", np.int64))),
        np.zeros(captures + 1, _entry(records.CollisionEventRecord)),
        np.zeros(ticks + 64, _entry(records.ReactionStatusRecord)),
        np.zeros(ticks + 64, _entry(records.PositionSetpointRecord)),
        np.zeros(slow, _entry(records.PositionSetpointRecord)),
        np.zeros(slow, _entry(records.MissionStatusRecord, ("wait_reason", np.int64))),
    )


def core_memories(
    estimator: EstimatorCore,
    detector: DetectorCore,
    reaction: ReactionCore,
    mission: MissionCore,
    controller: ControllerCore,
) -> tuple[tuple[Any, ...], CoreParams]:
    """Return memories and parameters of the five cores, as `fly` takes them."""
    memories = (
        estimator.memory,
        estimator.autopilot,
        detector.memory,
        reaction.memory,
        mission.memory,
        controller.memory,
        controller.autopilot,
    )
    return memories, CoreParams(
        detector.params, reaction.limits, mission.plan, mission.limits, controller.limits
    )


@compiled
def fly(
    plant: tuple[Any, ...],
    poses: tuple[Any, ...],
    cores: tuple[Any, ...],
    params: Any,
    published: Any,
    f: FlightProgress,
    log: Array,
    base: int,
    stop: int,
) -> bool:
    """Fly from tick `f.tick` until tick `stop`, the flight's end, or a collision to react to.

    In each tick the simulator senses, every core takes what was published in the tick before, and
    is stepped if its period is due or a message has come; the rotor command acts in the tick. A
    collision is reacted to outside: the tick is then complete but for the reaction's step.

    Args:
        plant: memory of the plant, the rotor's table, parameters of the effects, (B, 9) standard
            normals, a row a tick, the first for tick `base`.
        poses: (M,) ticks of capture, (M, 9) standard normals, (M, 10) table of samples, filled
            here, and the state of the capture.
        cores: memories of estimator (bookkeeping, autopilot), detector, reaction, mission and
            controller (bookkeeping, autopilot).
        params: `CoreParams`.
        published: `Published`, what the cores have published; appended to here.
        f: where the flight stands.
        log: (N, LOG_WIDTH), a row is written for every tick.
        base: tick of the first row of the plant's normals.
        stop: first tick not to fly.

    Returns:
        True if the reaction of tick `f.tick` - 1 is to be stepped outside.
    """
    m, maps, theta, tick_noise = plant
    capture_ticks, mocap_noise, mocap, captured = poses
    e, ea, d, r, mi, c, ca = cores
    p, n = published, f.published
    while f.tick < min(stop, f.end):
        k = f.tick
        now = EPOCH_NS + k * TICK_NS
        noise = tick_noise[k - base]
        read_imu(m, maps, noise, theta)
        if k == capture_ticks[captured[NEXT_CAPTURE]]:
            capture_pose(m, mocap_noise, theta, mocap, captured, k)
        # what others published in the tick before
        heard = now % _REACTION_PERIOD_NS == 0
        if n[MISSION_STATUS] > 0 and p.mission_status[n[MISSION_STATUS] - 1].tick == k - 1:
            phase = p.mission_status[n[MISSION_STATUS] - 1].message.phase
            f.phase = phase
            e.airborne = phase != IDLE and phase != LANDED
        upright = 1.0 - 2.0 * (m[P.body + 6] * m[P.body + 6] + m[P.body + 7] * m[P.body + 7])
        after = watch_end(f.over, m[P.body + 2], upright, f.phase)
        if after != UNDECIDED:
            f.end = min(f.end, k + int(after / TICK_S + 0.5))
        if n[DETECTOR_STATUS] > 0 and p.detector_status[n[DETECTOR_STATUS] - 1].tick == k - 1:
            r.detector_ns = now
            heard = True
        if n[ODOMETRY] > 0 and p.odometry[n[ODOMETRY] - 1].tick == k - 1:
            odometry = p.odometry[n[ODOMETRY] - 1].message
            take_position(r, odometry.position, now)
            take_odometry(c, ca, odometry)
            heard = True
        if n[ESTIMATOR_STATUS] > 0 and p.estimator_status[n[ESTIMATOR_STATUS] - 1].tick == k - 1:
            status = p.estimator_status[n[ESTIMATOR_STATUS] - 1].message
            take_biases(c, ca, status.gyro_bias, status.pose_stamp_ns)
        if n[MISSION_SETPOINT] > 0 and p.mission_setpoint[n[MISSION_SETPOINT] - 1].tick == k - 1:
            take_mission_setpoint(r, p.mission_setpoint[n[MISSION_SETPOINT] - 1].message, now)
            heard = True
        if n[SETPOINT] > 0 and p.setpoint[n[SETPOINT] - 1].tick == k - 1:
            take_setpoint(c, p.setpoint[n[SETPOINT] - 1].message, now)
        collided = n[EVENT] > 0 and p.event[n[EVENT] - 1].tick == k - 1
        if now % _MISSION_PERIOD_NS == 0:
            _step_mission(mi, params, p, f, now)
        # sensors
        i = next_arrival(mocap, captured, k)
        while i >= 0:
            _take_pose(e, ea, d, params.detector, p, n, mocap, i, k)
            note_mocap(r, params.reaction, now)
            heard = True
            i = next_arrival(mocap, captured, k)
        gyro, accel = m[P.imu : P.imu + 3], m[P.imu + 3 : P.imu + 6]
        if take_imu(e, ea, now, gyro, accel):
            if odometry_due(now):
                p.odometry[n[ODOMETRY]].tick = k
                fill_odometry(e, p.odometry[n[ODOMETRY]].message)
                n[ODOMETRY] += 1
            if status_due(now):
                p.estimator_status[n[ESTIMATOR_STATUS]].tick = k
                fill_status(e, p.estimator_status[n[ESTIMATOR_STATUS]].message)
                n[ESTIMATOR_STATUS] += 1
        answer_gyro(c, ca, maps, params.controller, now, now, gyro)
        for i in range(4):
            m[P.command + i] = ca.setpoint.rotor_speed[i]
        write_row(m, e, c, ca, log, k)
        finish_tick(m, noise, theta)
        f.tick = k + 1
        if collided or r.pending > 0:
            return True
        if heard:
            reaction_step(r, params.reaction, now)
            publish_reaction(r, p, f, k)
    return False


@compiled_call
def publish_reaction(r: Any, p: Any, f: FlightProgress, k: int) -> None:
    """Publish what the reaction's step of tick `k` has left in its memory."""
    n = f.published
    if r.publishes:
        entry = p.setpoint[n[SETPOINT]]
        entry.tick = k
        copy_setpoint(entry.message, r.setpoint)
        entry.message.stamp_ns = r.setpoint.stamp_ns
        n[SETPOINT] += 1
    if r.status_due:
        entry = p.reaction_status[n[REACTION_STATUS]]
        entry.tick = k
        copy_status(entry.message, r.status)
        n[REACTION_STATUS] += 1


@compiled_call
def _step_mission(mi: Any, params: Any, p: Any, f: FlightProgress, now: int) -> None:
    """Hand the mission what has come since its last step, and step it."""
    n, k = f.published, f.tick
    while f.read_odometry < n[ODOMETRY]:
        odometry = p.odometry[f.read_odometry].message
        x, y, z = odometry.velocity[0], odometry.velocity[1], odometry.velocity[2]
        velocity = np.empty(3)
        velocity[0], velocity[1], velocity[2] = rotated(odometry.attitude, x, y, z)
        take_estimate(mi, odometry.position, velocity, now)
        f.read_odometry += 1
    while f.read_reaction < n[REACTION_STATUS]:
        s = p.reaction_status[f.read_reaction].message
        take_reaction(mi, params.mission, s.state, s.x_r, s.collisions, s.stamp_ns, now)
        f.read_reaction += 1
    if f.read_setpoint < n[SETPOINT]:
        mi.answer_ns = now
        f.read_setpoint = n[SETPOINT]
    if not mission_step(mi, params.plan, params.mission, now):
        return
    entry = p.mission_setpoint[n[MISSION_SETPOINT]]
    entry.tick = k
    copy_setpoint(entry.message, mi.setpoint)
    entry.message.stamp_ns = now
    n[MISSION_SETPOINT] += 1
    if mi.status_due:
        status = p.mission_status[n[MISSION_STATUS]]
        status.tick = k
        status.wait_reason = mi.wait_reason
        status.message.stamp_ns = now
        status.message.phase = mi.mode
        n[MISSION_STATUS] += 1


@compiled_call
def _take_pose(
    e: EstimatorMemory,
    autopilot: Autopilot,
    d: Any,
    params: Any,
    p: Any,
    n: Any,
    mocap: Array,
    row: int,
    k: int,
) -> None:
    """Hand a pose to estimator and detector, and publish what the detector makes of it."""
    now = EPOCH_NS + k * TICK_NS
    sample = mocap[row]
    stamp = EPOCH_NS + int(np.rint(sample[STAMPED] * TICK_NS))
    position, attitude = sample[POSE : POSE + 3], sample[POSE + 3 : POSE + 7]
    estimator_pose(e, autopilot, stamp, now, position, attitude)
    result = detector_pose(d, params, stamp, now, position, attitude)
    entry = p.detector_status[n[DETECTOR_STATUS]]
    entry.tick = k
    entry.row = row
    entry.message.stamp_ns = stamp
    entry.message.statistic = d.status.statistic
    entry.message.threshold = d.status.threshold
    entry.message.poses = d.status.poses
    entry.message.rejected = d.status.rejected
    n[DETECTOR_STATUS] += 1
    if result == COLLISION and n[EVENT] < p.event.shape[0]:
        event = p.event[n[EVENT]]
        event.tick = k
        copy_event(event.message, d.event)
        n[EVENT] += 1


@compiled_call
def next_arrival(mocap: Array, state: NDArray[np.int64], tick: int) -> int:
    """Return the row of a sample that has arrived by `tick`, each once, or -1."""
    head = state[OLDEST_UNDELIVERED]
    end = state[NEXT_CAPTURE]
    while head < end and (mocap[head, ARRIVES] < 0.0 or mocap[head, DELIVERED] > 0.0):
        head += 1
    state[OLDEST_UNDELIVERED] = head
    for i in range(head, end):
        if mocap[i, DELIVERED] == 0.0 and 0.0 <= mocap[i, ARRIVES] <= tick:
            mocap[i, DELIVERED] = 1.0
            mocap[i, ARRIVES] = tick
            return i
    return -1


@compiled
def fly_with_true_state(
    m: Array,
    autopilot: Autopilot,
    maps: RotorMaps,
    theta: Array,
    noise: Array,
    start: int,
    stop: int,
) -> None:
    """Fly the plant and the cascade alone, the true state in place of the estimate; no log.

    The bare loop for benchmarks and for studies of many vehicles.
    """
    state, setpoint = autopilot.state, autopilot.setpoint
    for k in range(start, stop):
        begin_tick(m, maps, noise, theta)
        for i in range(3):
            state.position[i] = m[P.body + i]
            state.velocity[i] = m[P.body + 3 + i]
            state.rates[i] = m[P.body + 10 + i]
        for i in range(4):
            state.attitude[i] = m[P.body + 6 + i]
        autopilot.mocap_time = k * TICK_S
        cascade(autopilot, maps, k)
        for i in range(4):
            m[P.command + i] = setpoint.rotor_speed[i]
        finish_tick(m, noise, theta)


@compiled
def read_imu(m: Array, maps: Array, noise: Array, theta: Array) -> None:
    """Begin the tick and read the IMU: body rates, and force without gravity over mass."""
    begin_tick(m, maps, noise, theta)
    for i in range(3):
        m[P.imu + i] = m[P.body + 10 + i]
        m[P.imu + 3 + i] = m[P.wrench + i] / m[P.inertial]
    apply_imu(m, noise, theta)


@compiled_call
def capture_pose(
    m: Array, mocap_noise: Array, theta: Array, mocap: Array, state: NDArray[np.int64], tick: int
) -> None:
    """Take a mocap sample of the true pose and enter it, with its time of arrival."""
    i = state[NEXT_CAPTURE]
    for j in range(3):
        m[P.mocap + j] = m[P.body + j]
    for j in range(4):
        m[P.mocap + 3 + j] = m[P.body + 6 + j]
    m[P.mocap + 7] = 0.0
    m[P.mocap + 8] = 0.0
    m[P.mocap + 10] = 0.0
    m[P.mocap + 9] = max(m[P.mocap + 9] - (tick - state[LAST_CAPTURED]) * m[P.clock + 1], 0.0)
    apply_mocap(m, mocap_noise[i], theta)
    mocap[i, STAMPED] = tick + m[P.mocap + 10] / m[P.clock + 1]
    mocap[i, DELIVERED] = 0.0
    mocap[i, ARRIVES] = -1.0
    if m[P.mocap + 8] == 0.0:
        mocap[i, ARRIVES] = tick + int(m[P.mocap + 7] / m[P.clock + 1] + 0.5)
    for j in range(7):
        mocap[i, POSE + j] = m[P.mocap + j]
    state[NEXT_CAPTURE] = i + 1
    state[LAST_CAPTURED] = tick


@compiled
def stamped_tick(mocap: Array, i: int) -> int:
    """Return the tick nearest to the stamp of sample `i`."""
    return math.floor(float(mocap[i, STAMPED]) + 0.5)


@compiled
def write_row(
    m: Array, e: EstimatorMemory, c: ControllerMemory, autopilot: Autopilot, log: Array, k: int
) -> None:
    """Write the tick into row `k` of the log, in the columns of `log_columns.AT`."""
    r = P.rotation
    touching = m[P.contact]
    estimate, setpoint = e.estimate, autopilot.setpoint
    for i in range(3):
        log[k, AT.position + i] = m[P.body + i]
        log[k, AT.velocity + i] = m[P.body + 3 + i]
        log[k, AT.rates + i] = m[P.body + 10 + i]
        log[k, AT.contact + 2 + i] = m[P.contact + 5 + i]
        log[k, AT.gyro + i] = m[P.imu + i]
        log[k, AT.accel + i] = m[P.imu + 3 + i]
        log[k, AT.est_position + i] = estimate.position[i] if e.known else math.nan
        log[k, AT.est_velocity + i] = estimate.velocity[i] if e.known else math.nan
        log[k, AT.position_setpoint + i] = c.setpoint.position[i]
        log[k, AT.velocity_setpoint + i] = c.setpoint.velocity[i]
        log[k, AT.acceleration_setpoint + i] = c.setpoint.acceleration[i]
        log[k, AT.rates_setpoint + i] = setpoint.rates[i]
        log[k, AT.wind + i] = m[P.wind + i]
        log[k, AT.battery + i] = m[P.supply + i]
        push = 0.0
        if touching > 0.0:
            for j in range(3):
                push += m[r + 3 * i + j] * m[P.strike + j]
            if m[P.contact + 1] < 0.0:
                push += m[P.contact + 2 + i]
        log[k, AT.contact_force + i] = push
    for i in range(4):
        log[k, AT.attitude + i] = m[P.body + 6 + i]
        log[k, AT.rotor_speed + i] = m[P.speed + i]
        log[k, AT.rotor_thrust + i] = m[P.thrust + i]
        log[k, AT.fold + i] = m[P.fold + i]
        log[k, AT.damage + i] = m[P.damage + i]
        log[k, AT.est_attitude + i] = estimate.attitude[i] if e.known else math.nan
        log[k, AT.attitude_setpoint + i] = setpoint.attitude[i]
        log[k, AT.rotor_command + i] = m[P.command + i]
    log[k, AT.contact] = touching
    log[k, AT.contact + 1] = m[P.contact + 1]
    log[k, AT.thrust_setpoint] = setpoint.thrust
    log[k, AT.mode] = BLIND if autopilot.mode_flown == BLIND else c.setpoint.phase
