"""The fused flight: plant, sensors and all five cores, tick by tick, compiled.

The same functions that the cores' shells call. `tombo_flight.run_wiring` flies the same flight in
plain Python, nodes in lockstep do over DDS; a test holds the three to the last bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

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
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rigid_body import begin_tick, finish_tick
from tombo_dynamics.rotation import rotated
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_sim.flight_end import UNDECIDED, FlightEnd, watch_end
from tombo_sim.ground_truth import contact_force
from tombo_sim.log_columns import LogRow

_MISSION_PERIOD_NS, _REACTION_PERIOD_NS = MissionCore.period_ns, ReactionCore.period_ns


class MocapEntry(Record):
    """A captured pose in the table of a flight."""

    stamp = field("tick", "capture as the stamp says it, with fraction")
    arrives = field("tick", "-1: dropped", kind=int)
    delivered = field("1", "", kind=bool)
    position = field("m", "map", 3)
    attitude = field("1", "quaternion xyzw, map from base_link", 4)


class Captures(Record):
    """How far the table is filled and read."""

    next = field("1", "index of the next sample to capture", kind=int)
    oldest_undelivered = field("1", "index; all before it have arrived or never will", kind=int)
    latest_tick = field("tick", "of the latest capture", kind=int)


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
    vehicle: tuple[Any, ...],
    poses: tuple[Any, ...],
    cores: tuple[Any, ...],
    params: Any,
    published: Any,
    f: FlightProgress,
    log: Any,
    base: int,
    stop: int,
) -> bool:
    """Fly from tick `f.tick` until tick `stop`, the flight's end, or a collision to react to.

    In each tick the simulator senses, every core takes what was published in the tick before, and
    is stepped if its period is due or a message has come; the rotor command acts in the tick. A
    collision is reacted to outside: the tick is then complete but for the reaction's step.

    Args:
        vehicle: plant, rotor table, parameters of the effects, (B, 9) standard normals, a row a
            tick, the first for tick `base`.
        poses: (M,) ticks of capture, (M, 9) standard normals, (M,) `MocapEntry`, filled here, and
            `Captures`.
        cores: memories of estimator (bookkeeping, autopilot), detector, reaction, mission and
            controller (bookkeeping, autopilot).
        params: `CoreParams`.
        published: `Published`, what the cores have published; appended to here.
        f: where the flight stands.
        log: (N,) `LogRow`, one is written for every tick.
        base: tick of the first row of the plant's normals.
        stop: first tick not to fly.

    Returns:
        True if the reaction of tick `f.tick` - 1 is to be stepped outside.
    """
    plant, maps, theta, tick_noise = vehicle
    capture_ticks, mocap_noise, entries, captures = poses
    e, ea, d, r, mi, c, ca = cores
    p, n = published, f.published
    while f.tick < min(stop, f.end):
        k = f.tick
        now = EPOCH_NS + k * TICK_NS
        noise = tick_noise[k - base]
        read_imu(plant, maps, noise, theta)
        if k == capture_ticks[captures.next]:
            capture_pose(plant, mocap_noise, theta, entries, captures, k)
        # what others published in the tick before
        heard = now % _REACTION_PERIOD_NS == 0
        if n[MISSION_STATUS] > 0 and p.mission_status[n[MISSION_STATUS] - 1].tick == k - 1:
            phase = p.mission_status[n[MISSION_STATUS] - 1].message.phase
            f.phase = phase
            e.airborne = phase != IDLE and phase != LANDED
        q = plant.state.attitude
        upright = 1.0 - 2.0 * (q[0] * q[0] + q[1] * q[1])
        after = watch_end(f.over, plant.state.position[2], upright, f.phase)
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
        i = next_arrival(entries, captures, k)
        while i >= 0:
            _take_pose(e, ea, d, params.detector, p, n, entries[i], i, k)
            note_mocap(r, params.reaction, now)
            heard = True
            i = next_arrival(entries, captures, k)
        gyro, accel = plant.gyro, plant.accel
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
            plant.rotor_command[i] = ca.setpoint.rotor_speed[i]
        write_row(plant, e, c, ca, log[k])
        finish_tick(plant, noise, theta)
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
    sample: MocapEntry,
    row: int,
    k: int,
) -> None:
    """Hand a pose to estimator and detector, and publish what the detector makes of it."""
    now = EPOCH_NS + k * TICK_NS
    stamp = EPOCH_NS + int(np.rint(sample.stamp * TICK_NS))
    position, attitude = sample.position, sample.attitude
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
def next_arrival(entries: Any, captures: Captures, tick: int) -> int:
    """Return the index of a sample that has arrived by `tick`, each once, or -1."""
    head = captures.oldest_undelivered
    while head < captures.next and (entries[head].arrives < 0 or entries[head].delivered):
        head += 1
    captures.oldest_undelivered = head
    for i in range(head, captures.next):
        entry = entries[i]
        if not entry.delivered and 0 <= entry.arrives <= tick:
            entry.delivered = True
            entry.arrives = tick
            return i
    return -1


@compiled
def fly_with_true_state(
    plant: Plant,
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
        begin_tick(plant, maps, noise, theta)
        for i in range(3):
            state.position[i] = plant.state.position[i]
            state.velocity[i] = plant.state.velocity[i]
            state.rates[i] = plant.state.rates[i]
        for i in range(4):
            state.attitude[i] = plant.state.attitude[i]
        autopilot.mocap_time = k * TICK_S
        cascade(autopilot, maps, k)
        for i in range(4):
            plant.rotor_command[i] = setpoint.rotor_speed[i]
        finish_tick(plant, noise, theta)


@compiled
def read_imu(plant: Plant, maps: RotorMaps, noise: Array, theta: Array) -> None:
    """Begin the tick and read the IMU: body rates, and force without gravity over mass."""
    begin_tick(plant, maps, noise, theta)
    for i in range(3):
        plant.gyro[i] = plant.state.rates[i]
        plant.accel[i] = plant.force[i] / plant.mass
    apply_imu(plant, noise, theta)


@compiled_call
def capture_pose(
    plant: Plant, mocap_noise: Array, theta: Array, entries: Any, captures: Captures, tick: int
) -> None:
    """Take a mocap sample of the true pose and enter it, with its time of arrival."""
    sample, entry = plant.mocap, entries[captures.next]
    for i in range(3):
        sample.position[i] = plant.state.position[i]
    for i in range(4):
        sample.attitude[i] = plant.state.attitude[i]
    sample.latency = 0.0
    sample.stamp_error = 0.0
    sample.dropped = False
    sample.interval = (tick - captures.latest_tick) * plant.tick_length
    apply_mocap(plant, mocap_noise[captures.next], theta)
    entry.stamp = tick + sample.stamp_error / plant.tick_length
    entry.delivered = False
    entry.arrives = -1
    if not sample.dropped:
        entry.arrives = tick + int(sample.latency / plant.tick_length + 0.5)
    for i in range(3):
        entry.position[i] = sample.position[i]
    for i in range(4):
        entry.attitude[i] = sample.attitude[i]
    captures.next += 1
    captures.latest_tick = tick


@compiled
def write_row(
    plant: Plant, e: EstimatorMemory, c: ControllerMemory, autopilot: Autopilot, row: LogRow
) -> None:
    """Write the tick into a row of the log; `e` and `c` are as in `fly`."""
    contact, supply = plant.contact, plant.supply
    estimate, setpoint = e.estimate, autopilot.setpoint
    for i in range(3):
        row.position[i] = plant.state.position[i]
        row.velocity[i] = plant.state.velocity[i]
        row.rates[i] = plant.state.rates[i]
        row.contact[2 + i] = contact.point[i]
        row.gyro[i] = plant.gyro[i]
        row.accel[i] = plant.accel[i]
        row.est_position[i] = estimate.position[i] if e.known else math.nan
        row.est_velocity[i] = estimate.velocity[i] if e.known else math.nan
        row.position_setpoint[i] = c.setpoint.position[i]
        row.velocity_setpoint[i] = c.setpoint.velocity[i]
        row.acceleration_setpoint[i] = c.setpoint.acceleration[i]
        row.rates_setpoint[i] = setpoint.rates[i]
        row.wind[i] = plant.wind[i]
        row.contact_force[i] = 0.0
    if contact.touching:
        x, y, z = contact_force(plant)
        row.contact_force[0], row.contact_force[1], row.contact_force[2] = x, y, z
    row.contact[0] = contact.touching
    row.contact[1] = contact.rotor
    row.battery[0], row.battery[1], row.battery[2] = supply.charge, supply.current, supply.voltage
    for i in range(4):
        row.attitude[i] = plant.state.attitude[i]
        row.rotor_speed[i] = plant.rotor_speed[i]
        row.rotor_thrust[i] = plant.rotor_thrust[i]
        row.fold[i] = plant.fold[i]
        row.damage[i] = plant.damage[i]
        row.est_attitude[i] = estimate.attitude[i] if e.known else math.nan
        row.attitude_setpoint[i] = setpoint.attitude[i]
        row.rotor_command[i] = plant.rotor_command[i]
    row.thrust_setpoint[0] = setpoint.thrust
    row.mode[0] = BLIND if autopilot.mode_flown == BLIND else c.setpoint.phase
