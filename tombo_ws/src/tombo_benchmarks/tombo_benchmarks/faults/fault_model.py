"""A model of the whole suite for the model checker: the real cores around a point that flies.

Mission, reaction and controller are the compiled functions of the flight; vehicle, estimator and
detector are as simple as they can be, so that a minute of flight takes some milliseconds. A
table of faults says which input is lost and when; `Verdict` counts the violations.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from tombo_collision import reaction_core
from tombo_collision.params import ReactionLimits
from tombo_collision.reaction_core import ReactionCore
from tombo_collision.reaction_memory import begin_reaction
from tombo_collision.reactions import DEFAULT, REGISTRY
from tombo_control import controller_core, mission_core
from tombo_control.controller_core import ControllerCore, begin_controller, reset_inputs
from tombo_control.mission_core import MissionCore, land_now, take_off
from tombo_control.params import ControlParams, InputLimits
from tombo_control.planning.mission import MissionParams
from tombo_control.planning.mission_memory import MissionLimits, begin_mission
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_control.safety.state_machine import Condition, SafetyState
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import (
    DetectorStatusRecord,
    EstimatorStatusRecord,
    ImuRecord,
    OdometryRecord,
    PoseRecord,
)
from tombo_dynamics.messages import Phase, Reason
from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import rotated, rotated_back
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_dynamics.time_base import EPOCH_NS, SECOND_NS, TICK_NS
from tombo_dynamics.vehicle import GRAVITY, VehicleParams


class Fault(Reason):
    """The part that is lost, from begin to end of a fault, and what happens."""

    MOCAP = 0, "no poses"
    ESTIMATOR = 1, "the estimator is dead; at the end it is restarted"
    IMU = 2, "no IMU"
    CONTROLLER = 3, "the controller is dead; at the end it is restarted"
    REACTION = 4, "the reaction is dead; at the end it is restarted"
    DETECTOR = 5, "the detector is dead"
    MISSION = 6, "the mission is dead; at the end it is restarted"
    SIMULATOR = 7, "the simulator is restarted: another flight"
    CLOCK_BACK = 8, "all clocks are set back by 0.5 s"
    CLOCK_AHEAD = 9, "all clocks are set ahead by 2 s"
    SETPOINT_FAR = 10, "set points 50 m away"
    ACCELEROMETER = 11, "the accelerometer shows no number"
    MOVED_FRAME = 12, "poses in a frame 5 m away"
    OUT_OF_VOLUME = 13, "set points outside of the flight volume"
    ABORT = 14, "`~/abort`"
    KILL = 15, "`~/kill`"
    LAND_COMMAND = 16, "`~/land`"
    TAKEOFF_COMMAND = 17, "`~/takeoff`"
    COLLISION = 18, "a collision is reacted to"


STEP_TICKS = 5
"""One step of the model."""
_QUIET = 2000
"""Steps without thrust, after the last fault, that end a flight: a mission that could begin again
by itself has its next flight in them."""
_STEP_S = STEP_TICKS * TICK_NS * 1e-9
_LEG = 0.18
"""m: height of a vehicle that stands."""
_BOX = 4.0
"""m: half the width of the flight volume."""
_MISSION, _REACTION, _CONTROLLER = 1, 2, 4
"""Bits of the cores that live, and hear what is delivered."""


class Verdict(Record):
    """What happened, and what must not."""

    commands = field("1", "to take off: those that were obeyed", kind=int)
    lift_offs = field("1", "it left the ground", kind=int)
    thrust_after_touchdown = field("1", "steps with thrust after the latch, without command",
                                   kind=int)  # fmt: skip
    uncommanded = field("1", "lift-offs without a command", kind=int)
    far_setpoints = field("1", "steps with a reference further than allowed", kind=int)
    outside = field("1", "steps with a reference outside of the volume", kind=int)
    fast_falls = field("1", "touches of the ground at more than 2 m/s but for a kill", kind=int)
    longest_ground = field("1", "most steps on end with rotors on at the ground in a descent",
                           kind=int)  # fmt: skip
    still_on = field("1", "rotors turn at the end, without a flight", kind=bool)
    state = field("1", "the controller's state at the end", kind=int)
    rows = field("1", "bits of the rows of the table that decided", kind=int)


class FaultWorld(Record):
    """The point that flies, and its sensors and links to the cores."""

    position = field("m", "true, in map", 3)
    velocity = field("m/s", "true, in map", 3)
    force = field("m/s^2", "specific force, body", 3)
    pose = field("", "message, as the next ones", kind=PoseRecord)
    detector = field("", "its status", kind=DetectorStatusRecord)
    odometry = field("", "of the estimator", kind=OdometryRecord)
    estimator = field("", "its status", kind=EstimatorStatusRecord)
    imu = field("", "sample", kind=ImuRecord)
    sinking = field("m/s", "before the ground stopped it")
    lift = field("m/s^2", "of the rotors, behind their lag")
    shift_ns = field("ns", "of all clocks", kind=int)
    offset = field("m", "of the poses' frame, along x")
    failsafe = field("1", "the flight controller lands by itself", kind=bool)
    silent = field("1", "steps without commands", kind=int)
    aloft = field("1", "it is in the air", kind=bool)
    killed = field("1", "the rotors were stopped by command", kind=bool)
    new_controller = field(
        "1", "it was restarted, or begins another flight, and has not flown since", kind=bool
    )
    new_mission = field("1", "it was restarted, and nobody has told it to fly", kind=bool)
    on_ground = field("1", "steps on the ground with rotors on, in a descent", kind=int)


class Suite(NamedTuple):
    """Arguments of the cores' compiled functions; then what faults and the judge look at."""

    of_mission: tuple[Any, Any, Any, Any]
    of_reaction: tuple[Any, Any]
    of_controller: tuple[Any, Any, Any, Any]
    mission: Any
    plan: Any
    reaction: Any
    controller: Any
    autopilot: Any
    fresh: Any


def new_suite() -> Suite:
    """Return the cores of a short plan: up, along, a hold, down."""
    vehicle = VehicleParams()
    params = MissionParams(
        takeoff_time=1.0,
        height=1.5,
        climb_speed=0.8,
        approach_time=5.0,
        approach_speed=0.7,
        goal_x=2.0,
        hold_time=2.0,
        land_time=14.0,
    )
    mission = MissionCore(params, MissionLimits(ground_height=_LEG))
    reaction = ReactionCore(REGISTRY[DEFAULT](), ReactionLimits())
    controller = ControllerCore(
        ControlParams(),
        vehicle,
        InputLimits(),
        rotor_maps(thrust_map(configuration(13)), vehicle),
        SafetyParams(),
        FlightVolume(x_min=-_BOX, x_max=_BOX, y_min=-_BOX, y_max=_BOX, z_max=3.0),
    )
    autopilot = controller.autopilot
    return Suite(
        mission.arguments(),
        reaction.arguments(),
        controller.arguments(),
        mission.memory,
        mission.plan,
        reaction.memory,
        controller.memory,
        autopilot,
        autopilot.copy(),
    )


def new_world() -> FaultWorld:
    """Return a vehicle at rest on the ground."""
    world = FaultWorld.new()
    world.position[2] = _LEG
    world.force[2] = GRAVITY
    world.odometry.attitude = (0.0, 0.0, 0.0, 1.0)
    return world


@compiled
def _active(faults: Array, kind: int, step: int) -> bool:
    for i in range(faults.shape[0]):
        if faults[i, 0] == kind and faults[i, 1] <= step < faults[i, 2]:
            return True
    return False


@compiled(inline=False)
def _living(faults: Array, step: int) -> int:
    """Return the bits of the cores that are not dead."""
    living = 0
    if not _active(faults, Fault.MISSION, step):
        living |= _MISSION
    if not _active(faults, Fault.REACTION, step):
        living |= _REACTION
    if not _active(faults, Fault.CONTROLLER, step):
        living |= _CONTROLLER
    return living


@compiled(inline=False)
def _deliver_odometry(s: Suite, hearers: int, odometry: Any, now: int) -> None:
    if hearers & _MISSION:
        mission_core.take_odometry(*s.of_mission, odometry, now)
    if hearers & _REACTION:
        reaction_core.take_odometry(*s.of_reaction, odometry, now)
    if hearers & _CONTROLLER:
        controller_core.take_odometry(*s.of_controller, odometry, now)


@compiled(inline=False)
def _sense(s: Suite, world: FaultWorld, faults: Array, living: int, step: int, now: int) -> None:
    """Poses, estimate and status, unless they are lost."""
    odometry = world.odometry
    if step % 7 == 0 and not _active(faults, Fault.MOCAP, step):
        world.estimator.pose_stamp_ns = now
        if living & _REACTION:
            if not _active(faults, Fault.DETECTOR, step):
                reaction_core.take_detector_status(*s.of_reaction, world.detector, now)
            reaction_core.take_pose(*s.of_reaction, world.pose, now)
    if _active(faults, Fault.ESTIMATOR, step) or _active(faults, Fault.IMU, step):
        return
    blind_s = (now - world.estimator.pose_stamp_ns) * 1e-9
    odometry.position = world.position
    odometry.position[0] += world.offset + 0.1 * min(blind_s, 20.0)  # without poses it drifts
    odometry.attitude = s.autopilot.state.attitude
    odometry.velocity = rotated_back(odometry.attitude, world.velocity)
    odometry.stamp_ns = now
    # commands reach a dead mission, too, and it answers by the estimate
    _deliver_odometry(s, living | _MISSION, odometry, now)
    if step % 4 == 0 and living & _CONTROLLER:
        controller_core.take_biases(*s.of_controller, world.estimator, now)


@compiled(inline=False)
def _happen(s: Suite, world: FaultWorld, faults: Array, step: int, verdict: Verdict) -> None:
    """What happens once: restarts, jumps, commands."""
    for i in range(faults.shape[0]):
        kind, begins, ends = faults[i, 0], faults[i, 1] == step, faults[i, 2] == step
        if kind == Fault.CONTROLLER and ends:
            reset_inputs(s.controller)
            s.autopilot.state = s.fresh.state
            s.autopilot.history = s.fresh.history
            s.autopilot.loops = s.fresh.loops
            s.autopilot.setpoint = s.fresh.setpoint
            begin_controller(s.controller)
            world.new_controller = True
        elif kind == Fault.MISSION and ends:
            begin_mission(s.mission, True)  # as the simulator's: `auto_start`
            world.new_mission = True
        elif kind == Fault.REACTION and ends:
            begin_reaction(s.reaction)
        elif kind == Fault.MOVED_FRAME and begins:
            world.offset = 5.0
        elif kind == Fault.CLOCK_BACK and begins:
            world.shift_ns -= SECOND_NS // 2
        elif kind == Fault.CLOCK_AHEAD and begins:
            world.shift_ns += 2 * SECOND_NS
        elif kind == Fault.SIMULATOR and begins:
            for k in range(3):
                world.position[k] = 0.0
                world.velocity[k] = 0.0
            world.position[2] = _LEG
            world.lift = 0.0
            world.aloft = False
            world.failsafe = False
            world.new_controller = True
            world.shift_ns = -step * STEP_TICKS * TICK_NS
            reset_inputs(s.controller)
            begin_reaction(s.reaction)
            s.controller.estimate_ns = -1
            s.controller.pose_ns = -1
            if s.mission.now_ns - EPOCH_NS > CLOCK_SET_BACK_NS:  # a new flight takes a command
                verdict.commands = verdict.lift_offs
        elif kind == Fault.KILL and begins:
            s.controller.watch.requests |= 1 << Condition.KILL
            world.killed = True
        elif kind == Fault.ABORT and begins:
            s.controller.watch.requests |= 1 << Condition.ABORT
        elif kind == Fault.LAND_COMMAND and begins:
            land_now(s.mission, s.plan)
        elif kind == Fault.TAKEOFF_COMMAND and begins:
            before = s.mission.takeoff_commands
            if (
                take_off(s.mission, False) and s.mission.takeoff_commands > before
            ):  # a plan from the ground
                verdict.commands = verdict.lift_offs + 1
        elif kind == Fault.COLLISION and begins and s.reaction.has_mission:
            flies = Phase.TAKEOFF <= s.reaction.mission.phase <= Phase.HOLD
            if flies and not s.reaction.active:
                s.reaction.active = True
                s.reaction.changed = True
                s.reaction.mission_at_x_r = False
                s.reaction.collisions += 1
                s.reaction.x_r = s.reaction.position
                s.reaction.x_r[0] -= 0.8


@compiled(inline=False)
def _plan(s: Suite, faults: Array, living: int, step: int, now: int) -> None:
    """Step the mission; the reaction has its set point at once."""
    mission = s.mission
    mission_core.step_mission(*s.of_mission, now)
    if _active(faults, Fault.SETPOINT_FAR, step):
        mission.setpoint.position[0] += 50.0
    if _active(faults, Fault.OUT_OF_VOLUME, step):
        mission.setpoint.position[0] = -1.5 * _BOX
    if mission.setpoint_due and living & _REACTION:
        reaction_core.take_mission_setpoint(*s.of_reaction, mission.setpoint, now)
    mission.setpoint_due = False
    mission.status_due = False


@compiled(inline=False)
def _react(s: Suite, living: int, now: int) -> None:
    """Step the reaction; mission and controller have its messages at once."""
    reaction = s.reaction
    reaction_core.reaction_step(*s.of_reaction, now)
    if reaction.publishes and living & _MISSION:
        mission_core.take_answer(*s.of_mission, reaction.setpoint, now)
    if reaction.publishes and living & _CONTROLLER:
        controller_core.take_setpoint(*s.of_controller, reaction.setpoint, now)
    reaction.publishes = False
    if reaction.status_due and living & _MISSION:
        mission_core.take_reaction(*s.of_mission, reaction.status, now)
    reaction.status_due = False


@compiled(inline=False)
def _fly_on(world: FaultWorld, attitude: Array, lift: float, failsafe: bool) -> None:
    """Move the point by one step; on the ground it stands, and friction stops it."""
    v, p = world.velocity, world.position
    world.lift += (lift - world.lift) * min(_STEP_S / 0.035, 1.0)
    if failsafe:  # a velocity loop of its own
        world.lift = GRAVITY + 2.5 * (-0.4 - v[2])
        ax, ay, az = -2.0 * v[0], -2.0 * v[1], world.lift
        if p[2] <= _LEG + 0.01:
            world.lift = az = 0.0
    else:
        ax, ay, az = rotated(attitude, (0.0, 0.0, world.lift))
    az -= GRAVITY + 0.1 * v[2]
    ax -= 0.1 * v[0]
    ay -= 0.1 * v[1]
    hit = 0.0
    world.sinking = -v[2]
    if p[2] <= _LEG and (v[2] < 0.0 or az < 0.0):
        hit = max(-v[2], 0.0) / _STEP_S
        push = hit + max(-az, 0.0)
        az = max(az, 0.0)
        v[2] = max(v[2], 0.0)
        grip = max(1.0 - 0.4 * push * _STEP_S / (math.hypot(v[0], v[1]) + 1e-6), 0.0)
        v[0] *= grip
        v[1] *= grip
        ax = ay = 0.0
    for i in range(3):
        acceleration = ax if i == 0 else ay if i == 1 else az
        v[i] += _STEP_S * acceleration
        p[i] += _STEP_S * v[i]
    p[2] = max(p[2], _LEG - 1e-4)
    world.force = rotated_back(attitude, (ax, ay, az + GRAVITY + hit))


@compiled(inline=False)
def fly_faults(s: Suite, world: FaultWorld, faults: Any, steps: int, verdict: Verdict) -> None:
    """Fly `steps` steps of 5 ms with faults: rows of kind, first step, end; write `verdict`."""
    verdict.commands = 1
    volume, allowed = s.controller.watch.volume, s.controller.watch.params.setpoint_distance
    attitude = np.zeros(4)
    last = 0
    for i in range(faults.shape[0]):
        lasts = faults[i, 0] <= Fault.MISSION and faults[i, 2] < steps
        last = max(last, faults[i, 2] if lasts else faults[i, 1])
    rest = 0
    for step in range(steps):
        _happen(s, world, faults, step, verdict)
        now = EPOCH_NS + step * STEP_TICKS * TICK_NS + world.shift_ns
        living = _living(faults, step)
        _sense(s, world, faults, living, step, now)
        if step % 4 == 0:
            if living & _MISSION:
                _plan(s, faults, living, step, now)
            if living & _REACTION:
                _react(s, living, now)
        answered = False
        if living & _CONTROLLER and not _active(faults, Fault.IMU, step):
            noise = math.nan if _active(faults, Fault.ACCELEROMETER, step) else 0.0
            for i in range(3):
                world.imu.accel[i] = world.force[i] + noise
            world.imu.stamp_ns = now
            controller_core.take_imu(*s.of_controller, world.imu, now)
            answered = s.controller.command_due
            s.controller.command_due = False
            s.controller.rates_due = False
            s.controller.attitude_due = False
            s.controller.contact.due = False
        lift = 0.0
        if answered:
            world.silent = 0
            if s.autopilot.setpoint.rotor_speed[0] > 0.0:
                lift = s.autopilot.setpoint.thrust / s.autopilot.nominal.mass
                s.autopilot.state.attitude = s.autopilot.setpoint.attitude
        else:
            world.silent += 1
        if world.silent > 10 and world.position[2] > _LEG + 0.1:
            world.failsafe = True
        turns = lift > 0.0 or world.position[2] < _LEG + 0.1
        if world.failsafe and answered and turns:
            world.failsafe = False
        if world.silent > 10 and not world.failsafe:
            lift = 0.0
        for i in range(4):
            attitude[i] = s.autopilot.setpoint.attitude[i] if lift > 0.0 else i // 3
        _fly_on(world, attitude, lift, world.failsafe)
        _classify_outcome(s, world, verdict, lift, volume, allowed)
        rest = rest + 1 if lift == 0.0 and world.position[2] < _LEG + 0.01 else 0
        if step > last + _QUIET and rest > _QUIET:
            break  # nothing turns, nothing is to come
    verdict.state = s.controller.watch.state


@compiled(inline=False)
def _classify_outcome(
    s: Suite, world: FaultWorld, verdict: Verdict, lift: float, volume: Any, allowed: float
) -> None:
    """Count what must not be."""
    watch, height = s.controller.watch, world.position[2] - _LEG
    if watch.row >= 0:
        verdict.rows |= 1 << watch.row
    if not world.aloft and height > 0.1:
        world.aloft = True
        verdict.lift_offs += 1
        if world.new_controller and world.new_mission and s.mission.takeoff_commands == 0:
            verdict.commands = verdict.lift_offs  # none of them knows of a flight: `auto_start`
        world.new_controller = False
        world.new_mission = False
        if verdict.lift_offs > verdict.commands:
            verdict.uncommanded += 1
    elif world.aloft and height < 0.02 and lift == 0.0 and not world.failsafe:
        world.aloft = False
    if height < 0.02 and world.sinking > 2.0 and not world.killed:
        verdict.fast_falls += 1
    off = watch.state == SafetyState.LATCHED or watch.state == SafetyState.OFF
    if off and lift > 0.0:
        verdict.thrust_after_touchdown += 1
    descends = watch.state == SafetyState.LAND or watch.state == SafetyState.BLIND
    world.on_ground = world.on_ground + 1 if descends and height < 0.02 and lift > 0.0 else 0
    verdict.longest_ground = max(verdict.longest_ground, world.on_ground)
    if watch.state == SafetyState.FLY and s.controller.position_ran:
        square = 0.0
        out = 0.0
        target = s.autopilot.setpoint.position
        for i in range(3):
            square += (target[i] - s.autopilot.state.position[i]) ** 2
        out = max(abs(target[0]) - volume.x_max, abs(target[1]) - volume.y_max)
        if out > 1e-9:
            verdict.outside += 1
        if square > (1.2 * allowed) ** 2:
            verdict.far_setpoints += 1
    verdict.still_on = bool(lift > 0.0)
