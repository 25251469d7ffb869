"""The fused flight: plant, sensors and all five cores, tick by tick, compiled.

The same functions that the cores' shells call. `tombo_flight.run_wiring` flies the same flight in
plain Python, nodes in lockstep do over DDS; a test holds the three to the last bit.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tombo_collision.detector_core import DetectorCore
from tombo_collision.detector_core import take_pose as detector_pose
from tombo_collision.reaction_core import (
    ReactionCore,
    note_mocap,
    reaction_step,
    reference_due,
    take_mission_setpoint,
)
from tombo_collision.reaction_core import take_estimate as reaction_estimate
from tombo_control.autopilot import Autopilot
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
from tombo_control.loops.cascade import cascade
from tombo_control.mission_core import MissionCore, mission_step, take_estimate, take_reaction
from tombo_control.planning.mission import Plan
from tombo_dynamics import message_records as records
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled, compiled_call, compiled_loop
from tombo_dynamics.messages import Phase
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rigid_body import begin_tick, finish_tick
from tombo_dynamics.rotation import rotated, upright
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import EPOCH_NS, TICK_NS, TICK_S
from tombo_sim.flight_end import UNDECIDED, FlightEnd, watch_end
from tombo_sim.ground_truth import contact_force
from tombo_sim.sensing import MocapEntry, capture_pose, next_arrival, read_imu

_MISSION_PERIOD_NS, _REACTION_PERIOD_NS = MissionCore.period_ns, ReactionCore.period_ns


(
    ODOMETRY,
    ESTIMATOR_STATUS,
    DETECTOR_STATUS,
    EVENT,
    REACTION_STATUS,
    SETPOINT,
    MISSION_SETPOINT,
    MISSION_STATUS,
    CONTACT,
) = range(9)
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
    """Also the reason to wait, an index in `mission_core.WaitReason`."""
    contact: Any


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
    published = field("1", "messages in each table of `Published`", 9, int)
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
        np.zeros(ticks // 16 + 64, _entry(records.CollisionEventRecord)),
    )


class CoreMemories(NamedTuple):
    """Memories of the five cores."""

    estimator: Any
    estimator_autopilot: Any
    detector: Any
    reaction: Any
    mission: Any
    controller: Any
    controller_autopilot: Any


def core_memories(
    estimator: EstimatorCore,
    detector: DetectorCore,
    reaction: ReactionCore,
    mission: MissionCore,
    controller: ControllerCore,
) -> tuple[CoreMemories, CoreParams]:
    """Return memories and parameters of the five cores, as `fly` takes them."""
    memories = CoreMemories(
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


@compiled_loop
def fly(
    vehicle: tuple[Any, ...],
    poses: tuple[Any, ...],
    cores: CoreMemories,
    params: CoreParams,
    published: Published,
    flight: FlightProgress,
    log: Any,
    base: int,
    stop: int,
) -> bool:
    """Fly from tick `flight.tick` until tick `stop`, its end, or a collision to react to.

    In each tick the simulator senses, every core takes what was published in the tick before, and
    is stepped if its period is due or a message has come; the rotor command acts in the tick. A
    collision is reacted to outside: the tick is then complete but for the reaction's step.

    Args:
        vehicle: plant, rotor table, parameters of the effects, (B, 9) standard normals, a row a
            tick, the first for tick `base`.
        poses: (M,) ticks of capture, (M, 9) standard normals, (M,) `MocapEntry`, filled here, and
            `Captures`.
        cores: memories of the cores, changed.
        params: their parameters.
        published: what the cores have published; appended to here.
        flight: where the flight stands, changed.
        log: `log_columns.Log`, a row is written for every tick that it has room for.
        base: tick of the first row of the plant's normals.
        stop: first tick not to fly.

    Returns:
        True if the reaction of tick `flight.tick` - 1 is to be stepped outside.
    """
    plant, maps, theta, tick_noise = vehicle
    capture_ticks, mocap_noise, entries, captures = poses
    controls = cores.controller_autopilot.setpoint
    while flight.tick < min(stop, flight.end):
        tick = flight.tick
        now = EPOCH_NS + tick * TICK_NS
        noise = tick_noise[tick - base]
        read_imu(plant, maps, noise, theta)
        if tick == capture_ticks[captures.next]:
            capture_pose(plant, mocap_noise, theta, entries, captures, tick)
        _watch_flight(plant, published, flight, cores.estimator)
        has_input = _deliver_messages(cores, published, flight, now)
        collided = _newest(published.event, flight.published[EVENT], tick) >= 0
        if cores.reaction.takes_contacts:
            collided |= _newest(published.contact, flight.published[CONTACT], tick) >= 0
        if now % _MISSION_PERIOD_NS == 0:
            _step_mission(cores.mission, params, published, flight, now)
        i = next_arrival(entries, captures, tick)
        while i >= 0:
            _take_pose(cores, params.detector, published, flight, entries[i], i)
            note_mocap(cores.reaction, params.reaction, now)
            has_input = True
            i = next_arrival(entries, captures, tick)
        if take_imu(cores.estimator, cores.estimator_autopilot, now, plant.gyro, plant.accel):
            _publish_estimate(cores.estimator, published, flight, now)
        answer_gyro(
            cores.controller,
            cores.controller_autopilot,
            maps,
            params.controller,
            now,
            now,
            plant.gyro,
            plant.accel,
        )
        if cores.controller.contact.due:
            _publish_contact(cores.controller, published, flight)
        plant.rotor_command = controls.rotor_speed
        if tick < log.position.shape[0]:
            autopilot = cores.controller_autopilot
            write_row(plant, cores.estimator, cores.controller, autopilot, log, tick)
        finish_tick(plant, noise, theta)
        flight.tick = tick + 1
        if collided or cores.reaction.pending > 0:
            return True
        if has_input or now % _REACTION_PERIOD_NS == 0:
            if reference_due(cores.reaction, now):
                return True
            reaction_step(cores.reaction, params.reaction, now)
            publish_reaction(cores.reaction, published, flight, tick)
    return False


@compiled_loop
def fly_from_python(
    vehicle: tuple[Any, ...],
    poses: tuple[Any, ...],
    cores: CoreMemories,
    params: CoreParams,
    published: Published,
    flight: Any,
    log: Any,
    base: int,
    stop: int,
) -> bool:
    """Fly as `fly` does; each record comes as the array (1) that holds it, see `as_arrays`."""
    plant, maps, theta, noise = vehicle
    ticks, normals, entries, captures = poses
    return fly(
        (plant[0], maps[0], theta, noise),
        (ticks, normals, entries, captures[0]),
        CoreMemories(
            cores.estimator[0],
            cores.estimator_autopilot[0],
            cores.detector[0],
            cores.reaction[0],
            cores.mission[0],
            cores.controller[0],
            cores.controller_autopilot[0],
        ),
        CoreParams(
            params.detector[0],
            params.reaction[0],
            Plan(params.plan.params[0], params.plan.waypoints),
            params.mission[0],
            params.controller[0],
        ),
        published,
        flight[0],
        log,
        base,
        stop,
    )


@compiled_loop
def _newest(table: Any, count: int, tick: int) -> int:
    """Return the index of the message that was published in the tick before `tick`, or -1."""
    return count - 1 if count > 0 and table[count - 1].tick == tick - 1 else -1


@compiled_loop
def _watch_flight(
    plant: Plant, published: Any, flight: FlightProgress, estimator: EstimatorMemory
) -> None:
    """Take the mission's phase, and decide whether the flight is to end."""
    i = _newest(published.mission_status, flight.published[MISSION_STATUS], flight.tick)
    if i >= 0:
        flight.phase = published.mission_status[i].message.phase
        estimator.airborne = flight.phase != Phase.IDLE and flight.phase != Phase.LANDED
    state = plant.state
    after = watch_end(flight.over, state.position[2], upright(state.attitude), flight.phase)
    if after != UNDECIDED:
        flight.end = min(flight.end, flight.tick + int(after / TICK_S + 0.5))


@compiled_loop
def _deliver_messages(cores: Any, published: Any, flight: FlightProgress, now: int) -> bool:
    """Hand reaction and controller what was published in the tick before.

    Returns:
        True if the reaction has an input.
    """
    counts, tick, has_input = flight.published, flight.tick, False
    if _newest(published.detector_status, counts[DETECTOR_STATUS], tick) >= 0:
        cores.reaction.detector_ns = now
        has_input = True
    i = _newest(published.odometry, counts[ODOMETRY], tick)
    if i >= 0:
        odometry = published.odometry[i].message
        reaction_estimate(cores.reaction, odometry, now)
        take_odometry(cores.controller, cores.controller_autopilot, odometry)
        has_input = True
    i = _newest(published.estimator_status, counts[ESTIMATOR_STATUS], tick)
    if i >= 0:
        status = published.estimator_status[i].message
        take_biases(
            cores.controller,
            cores.controller_autopilot,
            status.gyro_bias,
            status.accel_bias,
            status.pose_stamp_ns,
        )
    i = _newest(published.mission_setpoint, counts[MISSION_SETPOINT], tick)
    if i >= 0:
        take_mission_setpoint(cores.reaction, published.mission_setpoint[i].message, now)
        has_input = True
    i = _newest(published.setpoint, counts[SETPOINT], tick)
    if i >= 0:
        setpoint = published.setpoint[i].message
        take_setpoint(cores.controller, cores.controller_autopilot, setpoint, now)
    return has_input


@compiled_call
def publish_reaction(reaction: Any, published: Any, flight: FlightProgress, tick: int) -> None:
    """Publish what the reaction's step of `tick` has left in its memory."""
    counts = flight.published
    if reaction.publishes:
        entry = published.setpoint[counts[SETPOINT]]
        entry.tick = tick
        entry.message = reaction.setpoint
        counts[SETPOINT] += 1
    if reaction.status_due:
        entry = published.reaction_status[counts[REACTION_STATUS]]
        entry.tick = tick
        entry.message = reaction.status
        counts[REACTION_STATUS] += 1


@compiled_call
def _step_mission(
    mission: Any, params: Any, published: Any, flight: FlightProgress, now: int
) -> None:
    """Hand the mission what has come since its last step, and step it."""
    counts = flight.published
    while flight.read_odometry < counts[ODOMETRY]:
        odometry = published.odometry[flight.read_odometry].message
        x, y, z = odometry.velocity[0], odometry.velocity[1], odometry.velocity[2]
        velocity = np.empty(3)
        velocity[0], velocity[1], velocity[2] = rotated(odometry.attitude, x, y, z)
        take_estimate(mission, odometry.position, velocity, now)
        flight.read_odometry += 1
    while flight.read_reaction < counts[REACTION_STATUS]:
        s = published.reaction_status[flight.read_reaction].message
        take_reaction(mission, params.mission, s.state, s.x_r, s.collisions, s.stamp_ns, now)
        flight.read_reaction += 1
    if flight.read_setpoint < counts[SETPOINT]:
        mission.answer_ns = now
        flight.read_setpoint = counts[SETPOINT]
    if not mission_step(mission, params.plan, params.mission, now):
        return
    entry = published.mission_setpoint[counts[MISSION_SETPOINT]]
    entry.tick = flight.tick
    entry.message = mission.setpoint
    entry.message.stamp_ns = now
    counts[MISSION_SETPOINT] += 1
    if mission.status_due:
        status = published.mission_status[counts[MISSION_STATUS]]
        status.tick = flight.tick
        status.wait_reason = mission.wait_reason
        status.message.stamp_ns = now
        status.message.phase = mission.mode
        counts[MISSION_STATUS] += 1


@compiled_loop
def _publish_estimate(
    estimator: EstimatorMemory, published: Any, flight: FlightProgress, now: int
) -> None:
    """Publish the estimator's outputs of the tick's IMU sample."""
    counts = flight.published
    if odometry_due(now):
        entry = published.odometry[counts[ODOMETRY]]
        entry.tick = flight.tick
        fill_odometry(estimator, entry.message)
        counts[ODOMETRY] += 1
    if status_due(now):
        status = published.estimator_status[counts[ESTIMATOR_STATUS]]
        status.tick = flight.tick
        fill_status(estimator, status.message)
        counts[ESTIMATOR_STATUS] += 1


@compiled_call
def _publish_contact(controller: ControllerMemory, published: Any, flight: FlightProgress) -> None:
    """Publish the contact that the controller has seen in this tick."""
    counts = flight.published
    if counts[CONTACT] < published.contact.shape[0]:
        entry = published.contact[counts[CONTACT]]
        entry.tick = flight.tick
        entry.message = controller.event
        counts[CONTACT] += 1


@compiled_call
def _take_pose(
    cores: Any, params: Any, published: Any, flight: FlightProgress, sample: MocapEntry, row: int
) -> None:
    """Hand a pose to estimator and detector, and publish what the detector makes of it."""
    counts, detector = flight.published, cores.detector
    now = EPOCH_NS + flight.tick * TICK_NS
    stamp = EPOCH_NS + int(np.rint(sample.stamp * TICK_NS))
    position, attitude = sample.position, sample.attitude
    estimator_pose(cores.estimator, cores.estimator_autopilot, stamp, now, position, attitude)
    detector_pose(detector, params, stamp, now, position, attitude)
    entry = published.detector_status[counts[DETECTOR_STATUS]]
    entry.tick = flight.tick
    entry.row = row
    entry.message = detector.status
    counts[DETECTOR_STATUS] += 1
    if detector.detector.collided and counts[EVENT] < published.event.shape[0]:
        event = published.event[counts[EVENT]]
        event.tick = flight.tick
        event.message = detector.event
        counts[EVENT] += 1


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
        state.position = plant.state.position
        state.velocity = plant.state.velocity
        state.rates = plant.state.rates
        state.attitude = plant.state.attitude
        autopilot.mocap_time = k * TICK_S
        cascade(autopilot, maps, k)
        plant.rotor_command = setpoint.rotor_speed
        finish_tick(plant, noise, theta)


@compiled_loop
def write_row(
    plant: Plant,
    estimator: EstimatorMemory,
    controller: ControllerMemory,
    autopilot: Autopilot,
    log: Any,
    tick: int,
) -> None:
    """Write the tick into its row of the `log_columns.Log`; `autopilot` is the controller's."""
    contact, supply, state = plant.contact, plant.supply, plant.state
    estimate, setpoint, wanted = estimator.estimate, autopilot.setpoint, controller.setpoint
    for i in range(3):
        log.position[tick, i] = state.position[i]
        log.velocity[tick, i] = state.velocity[i]
        log.rates[tick, i] = state.rates[i]
        log.gyro[tick, i] = plant.gyro[i]
        log.accel[tick, i] = plant.accel[i]
        log.position_setpoint[tick, i] = wanted.position[i]
        log.velocity_setpoint[tick, i] = wanted.velocity[i]
        log.acceleration_setpoint[tick, i] = wanted.acceleration[i]
        log.rates_setpoint[tick, i] = setpoint.rates[i]
        log.wind[tick, i] = plant.wind[i]
        log.contact[tick, 2 + i] = contact.point[i]
        log.est_position[tick, i] = estimate.position[i] if estimator.known else math.nan
        log.est_velocity[tick, i] = estimate.velocity[i] if estimator.known else math.nan
        log.contact_force[tick, i] = 0.0
    if contact.touching:
        x, y, z = contact_force(plant)
        log.contact_force[tick, 0] = x
        log.contact_force[tick, 1] = y
        log.contact_force[tick, 2] = z
    log.contact[tick, 0] = contact.touching
    log.contact[tick, 1] = contact.rotor
    log.battery[tick, 0] = supply.charge
    log.battery[tick, 1] = supply.current
    log.battery[tick, 2] = supply.voltage
    for i in range(4):
        log.attitude[tick, i] = state.attitude[i]
        log.rotor_speed[tick, i] = plant.rotor_speed[i]
        log.rotor_thrust[tick, i] = plant.rotor_thrust[i]
        log.fold[tick, i] = plant.fold[i]
        log.damage[tick, i] = plant.damage[i]
        log.attitude_setpoint[tick, i] = setpoint.attitude[i]
        log.rotor_command[tick, i] = plant.rotor_command[i]
        log.est_attitude[tick, i] = estimate.attitude[i] if estimator.known else math.nan
    log.thrust_setpoint[tick, 0] = setpoint.thrust
    log.mode[tick, 0] = (
        Phase.DESCEND_BLIND if autopilot.mode_flown == Phase.DESCEND_BLIND else wanted.phase
    )
