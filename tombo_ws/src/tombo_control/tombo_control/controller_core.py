"""The controller as a node sees it: gyro samples, estimates and set points in, commands out.

One call for each gyro sample. Missing or old inputs decide its state, by the table of
`tombo_control.safety.state_machine`; without gyro it says nothing, and the flight controller
behind it takes over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar

import numpy as np

from tombo_control.autopilot import Autopilot, new_autopilot
from tombo_control.estimator import correct_with_estimate, integrate_force, nearest_tick
from tombo_control.loops.cascade import control_tick, stop_rotors
from tombo_control.params import (
    ATTITUDE_TICKS,
    POSITION_TICKS,
    ControlParams,
    EstimatorParams,
    InputLimits,
)
from tombo_control.recovery.contact_watch import ContactWatch, fill_event, watch_contact
from tombo_control.recovery.folded_rotors import observe_folds
from tombo_control.recovery.params import ContactParams, RecoveryParams
from tombo_control.safety.flight_volume import check_volume, clamp_to_volume
from tombo_control.safety.params import FlightVolume, SafetyParams
from tombo_control.safety.state_machine import TABLE, Condition, SafetyState
from tombo_control.safety.watch import (
    NO_PHASE,
    Watch,
    begin_watch,
    rotors_off,
    update_safety_state,
)
from tombo_dynamics.arrays import Array
from tombo_dynamics.core import CLOCK_SET_BACK_NS, ERROR, START_GRACE_NS, Compiled, Core, Output
from tombo_dynamics.input_check import is_finite_setpoint, is_future
from tombo_dynamics.jit import compiled
from tombo_dynamics.message_records import (
    AttitudeSetpointRecord,
    CollisionEventRecord,
    PositionSetpointRecord,
    RatesSetpointRecord,
    RotorSpeedsRecord,
)
from tombo_dynamics.messages import (
    AttitudeSetpoint,
    CollisionEvent,
    EstimatorStatus,
    Imu,
    Odometry,
    Phase,
    PositionSetpoint,
    RatesSetpoint,
    RecoveryMode,
    RotorSpeeds,
)
from tombo_dynamics.propeller.mounted_propeller import (
    PropellerChoice,
    mounted_rotors,
    recovery_time,
)
from tombo_dynamics.records import Record, field, fill_record, parameter_record
from tombo_dynamics.rotation import rotated
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import SECOND_NS, TICK_S
from tombo_dynamics.vectors import ZERO, all_finite, dot, subtract
from tombo_dynamics.vehicle import VehicleParams

_MAX_GAP_TICKS = 100
_BLIND_TEXT = "position unknown (estimate or mocap too old): descent"
_NORMAL = (Condition.COMMANDED, Condition.TAKEOFF, Condition.DOWN, Condition.NEW_FLIGHT)
"""What ends a state without a fault."""


_NEVER = -1
_ANSWER_TIME = 0.5
"""s: time for which the controller recovers after a contact, before the reaction reports it."""


class ControllerMemory(Record):
    """Bookkeeping of the controller's core; its state is an autopilot's memory."""

    tick = field("1", "of the last gyro sample; -1: none, as in the next ones", kind=int)
    position_slot = field("1", "of the last run of the position loop", kind=int)
    attitude_slot = field("1", "of the last run of the attitude loop", kind=int)
    estimate_ns = field("ns", "stamp of the last estimate taken", kind=int)
    pose_ns = field("ns", "stamp of the last pose behind it", kind=int)
    setpoint_ns = field("ns", "when the set point came", kind=int)
    has_setpoint = field("1", "a set point has come", kind=bool)
    setpoint = field("", "the last one, as it came", kind=PositionSetpointRecord)
    blind = field("1", "the position is not known", kind=bool)
    position_ran = field("1", "in the last tick, as the next ones", kind=bool)
    attitude_ran = field("1", "the attitude loop ran", kind=bool)
    setpoint_late = field("1", "holds the last set point: none is coming", kind=bool)
    watch = field("", "which state it is in, and why", kind=Watch)
    contact = field("", "the contact trigger", kind=ContactWatch)
    event = field("", "the last contact", kind=CollisionEventRecord)
    command = field("", "the last one, as the next two", kind=RotorSpeedsRecord)
    command_due = field("1", "it is to be published", kind=bool)
    rates = field("", "of the attitude loop", kind=RatesSetpointRecord)
    rates_due = field("1", "they are to be published", kind=bool)
    attitude = field("", "of the position loop", kind=AttitudeSetpointRecord)
    attitude_due = field("1", "it is to be published", kind=bool)


@compiled(inline=False)
def reset_inputs(memory: ControllerMemory) -> None:
    """Discard all inputs of the previous flight: no set point, so no rotor turns."""
    memory.watch.requests |= 1 << Condition.NEW_FLIGHT
    memory.estimate_ns = _NEVER
    memory.pose_ns = _NEVER
    memory.setpoint_ns = _NEVER
    memory.has_setpoint = False
    memory.blind = False


@compiled(inline=False)
def begin_controller(memory: ControllerMemory) -> None:
    """Begin before the first gyro sample."""
    memory.tick = _NEVER
    memory.position_slot = _NEVER
    memory.attitude_slot = _NEVER
    reset_inputs(memory)
    begin_watch(memory.watch)


@compiled(inline=False)
def take_odometry(
    memory: ControllerMemory,
    autopilot: Autopilot,
    maps: RotorMaps,
    limits: InputLimits,
    odometry: Odometry,
    now_ns: int,
) -> bool:
    """Take an estimate; False: not finite, not a rotation, or old."""
    q = odometry.attitude
    velocity = rotated(q, odometry.velocity)
    square = 0.0
    for i in range(4):
        square += q[i] * q[i]
    if not (all_finite(velocity) and all_finite(odometry.position)):
        return False
    if not abs(square - 1.0) <= 0.01 or odometry.stamp_ns <= memory.estimate_ns:
        return False
    memory.estimate_ns = odometry.stamp_ns
    captured, now = nearest_tick(odometry.stamp_ns), max(memory.tick, 0)
    state, history = autopilot.state, autopilot.history
    correct_with_estimate(state, history, odometry.position, velocity, q, captured, now)
    return True


@compiled(inline=False)
def take_biases(
    memory: ControllerMemory,
    autopilot: Autopilot,
    maps: RotorMaps,
    limits: InputLimits,
    status: EstimatorStatus,
    now_ns: int,
) -> bool:
    """Take the biases and the last pose's capture time; False: NaN or infinity, not taken."""
    if not (all_finite(status.gyro_bias) and all_finite(status.accel_bias)):
        return False
    autopilot.state.gyro_bias = status.gyro_bias
    autopilot.state.accel_bias = status.accel_bias
    memory.pose_ns = status.pose_stamp_ns
    return True


@compiled
def _is_too_far(memory: ControllerMemory, autopilot: Autopilot, position: Array) -> bool:
    """Return whether a place (3) in map is too far from the vehicle to be flown to."""
    off = subtract(position, autopilot.state.position)
    return bool(dot(off, off) > memory.watch.params.setpoint_distance**2)


@compiled(inline=False)
def take_setpoint(
    memory: ControllerMemory,
    autopilot: Autopilot,
    maps: RotorMaps,
    limits: InputLimits,
    setpoint: PositionSetpoint,
    now_ns: int,
) -> bool:
    """Take a set point that arrived at `now_ns`; False: not finite, or too far to follow."""
    if not is_finite_setpoint(setpoint):
        return False
    if not rotors_off(memory.watch) and _is_too_far(memory, autopilot, setpoint.position):
        return False
    memory.setpoint = setpoint
    memory.has_setpoint = True
    memory.setpoint_ns = now_ns
    return True


@compiled
def take_imu(
    memory: ControllerMemory,
    autopilot: Autopilot,
    maps: RotorMaps,
    limits: InputLimits,
    imu: Imu,
    now_ns: int,
) -> None:
    """Answer a gyro sample: run the loops, and fill in the messages that are due.

    Args:
        memory: the controller's bookkeeping.
        autopilot: as in `control_tick`; its upper set points are those of the last message.
        maps: the rotor's table.
        limits: of the inputs' ages.
        imu: a sample that is not newer than the last is left out; a rate that is not finite is
            taken from the sample before.
        now_ns: time now, of the stamps' clock.
    """
    if not _run_loops(memory, autopilot, maps, limits, imu, now_ns):
        return
    if memory.watch.state == SafetyState.STANDBY:
        return
    setpoint, stamp_ns = autopilot.setpoint, imu.stamp_ns
    memory.command.stamp_ns = stamp_ns
    memory.command.speed = setpoint.rotor_speed
    memory.command_due = True
    if memory.attitude_ran:
        memory.rates.stamp_ns = stamp_ns
        memory.rates.rates = setpoint.rates
        memory.rates.thrust = setpoint.thrust
        memory.rates_due = True
    if memory.position_ran:
        memory.attitude.stamp_ns = stamp_ns
        memory.attitude.orientation = setpoint.attitude
        memory.attitude.thrust = setpoint.thrust
        memory.attitude_due = True


@compiled
def _run_loops(
    memory: ControllerMemory,
    autopilot: Autopilot,
    maps: RotorMaps,
    limits: InputLimits,
    imu: Imu,
    now_ns: int,
) -> bool:
    """Set `setpoint.rotor_speed`; False for a sample that is not newer than the last."""
    gyro, accel = imu.gyro, imu.accel
    tick = nearest_tick(imu.stamp_ns)
    ticks = tick - memory.tick
    if memory.tick < 0 or ticks < -_MAX_GAP_TICKS or ticks > _MAX_GAP_TICKS:
        memory.watch.gap = ticks if memory.tick >= 0 else 0
        if ticks < -_MAX_GAP_TICKS:  # the clock was set back
            memory.estimate_ns = _NEVER
            memory.pose_ns = _NEVER
            memory.setpoint_ns = min(memory.setpoint_ns, now_ns)
            memory.watch.since = min(memory.watch.since, tick)
        ticks = 1
    elif ticks <= 0:
        return False
    memory.tick = tick
    update_safety_inputs(memory, autopilot, limits, imu, now_ns, ticks)
    memory.attitude_ran = False
    flies = memory.watch.state == SafetyState.FLY
    watch_contact(memory.contact, autopilot.state, autopilot.nominal, gyro, accel, tick, flies)
    if memory.contact.due:
        fill_event(memory.contact, imu.stamp_ns, memory.event)
    if rotors_off(memory.watch):
        memory.position_ran = False
        memory.setpoint_late = False
        mode = memory.setpoint.phase if memory.has_setpoint else Phase.IDLE
        control_tick(autopilot, maps, gyro, tick, ticks, False, False, False)
        stop_rotors(autopilot.state, autopilot.setpoint, autopilot.loops)
        autopilot.mode_asked = mode
        autopilot.mode_flown = mode
        return True
    blind = memory.watch.state == SafetyState.BLIND
    memory.attitude_ran = tick // ATTITUDE_TICKS != memory.attitude_slot
    _choose_gains(memory, autopilot, flies, tick, ticks)
    if memory.position_ran:
        memory.position_slot = tick // POSITION_TICKS
        memory.blind = blind
        _follow_setpoint(memory, autopilot)
    if memory.attitude_ran:
        memory.attitude_slot = tick // ATTITUDE_TICKS
    if blind and not integrate_force(autopilot.state, accel, ticks):
        autopilot.loops.accelerometer_lost = True
    control_tick(
        autopilot, maps, gyro, tick, ticks, memory.position_ran, memory.attitude_ran, blind
    )
    return True


@compiled
def _choose_gains(
    memory: ControllerMemory, autopilot: Autopilot, flies: bool, tick: int, ticks: int
) -> None:
    """Carry the folds on, and decide whether the gains of the recovery are flown.

    The position loop then runs as often as the attitude loop.
    """
    recovery, contact, mode = autopilot.recovery, memory.contact, memory.setpoint.recovery
    if contact.due and contact.rotor >= 0:
        recovery.fold[contact.rotor] = 1.0
    observe_folds(recovery, ticks)
    fresh = contact.count > 0 and (tick - contact.tick) * TICK_S < _ANSWER_TIME
    recovery.active = flies and (
        mode == RecoveryMode.ON or (mode == RecoveryMode.ON_CONTACT and fresh)
    )
    if recovery.active:
        memory.position_ran = memory.attitude_ran


@compiled
def update_safety_inputs(
    memory: ControllerMemory,
    autopilot: Autopilot,
    limits: InputLimits,
    imu: Imu,
    now_ns: int,
    ticks: int,
) -> None:
    """Write `position_ran` and `setpoint_late`, then update the safety state."""
    memory.position_ran = memory.tick // POSITION_TICKS != memory.position_slot
    memory.setpoint_late = now_ns - memory.setpoint_ns > limits.setpoint_timeout * 1e9
    lost = imu.stamp_ns - memory.estimate_ns > limits.odometry_timeout * 1e9
    lost = lost or imu.stamp_ns - memory.pose_ns > autopilot.gains.blind_timeout * 1e9
    phase = memory.setpoint.phase if memory.has_setpoint else NO_PHASE
    update_safety_state(
        memory.watch,
        autopilot,
        imu.accel,
        memory.setpoint,
        phase,
        memory.tick,
        ticks,
        memory.position_ran,
        not lost,
        memory.setpoint_late,
    )


@compiled
def _follow_setpoint(memory: ControllerMemory, autopilot: Autopilot) -> None:
    """Write the reference of the position loop; unless the controller descends by itself."""
    last, setpoint, state = memory.setpoint, autopilot.setpoint, memory.watch.state
    autopilot.mode_asked = last.phase
    if state == SafetyState.BLIND:
        autopilot.mode_flown = Phase.DESCEND_BLIND
    elif state == SafetyState.LAND:
        autopilot.mode_flown = Phase.LAND
        setpoint.yaw = memory.watch.yaw
    else:
        autopilot.mode_flown = last.phase
        setpoint.position = last.position
        rests = clamp_to_volume(setpoint.position, memory.watch.volume) or memory.setpoint_late
        if _is_too_far(memory, autopilot, setpoint.position):  # the estimate jumped meanwhile
            last.position = autopilot.state.position
            setpoint.position = last.position
            clamp_to_volume(setpoint.position, memory.watch.volume)
            last.velocity = last.acceleration = ZERO
        if rests:
            setpoint.velocity = setpoint.acceleration = ZERO
        else:
            setpoint.velocity = last.velocity
            setpoint.acceleration = last.acceleration
        setpoint.yaw = last.yaw


class ControllerCore(Core):
    """The cascade of 50, 250 and 1000 Hz behind its inputs."""

    name = "controller"
    inputs = ("/odometry", "/estimator/status", "/setpoint", "/imu/data_raw")
    outputs: ClassVar[Mapping[str, Output]] = {
        "/contact_event": Output(CollisionEvent, "event", "contact.due"),
        "/rotor_command": Output(RotorSpeeds, "command", "command_due", logged=True),
        "/rates_setpoint": Output(
            RatesSetpoint, "rates", "rates_due", every=ATTITUDE_TICKS, logged=True
        ),
        "/attitude_setpoint": Output(
            AttitudeSetpoint, "attitude", "attitude_due", every=ATTITUDE_TICKS, logged=True
        ),
    }
    compiled = Compiled(
        ("memory", "autopilot"),
        ("maps", "limits"),
        {
            "/odometry": take_odometry,
            "/estimator/status": take_biases,
            "/setpoint": take_setpoint,
            "/imu/data_raw": take_imu,
        },
    )
    period_ns = 1_000_000
    sections: ClassVar[Mapping[str, type]] = {
        "control": ControlParams,
        "recovery": RecoveryParams,
        "contact": ContactParams,
        "inputs": InputLimits,
        "safety": SafetyParams,
        "volume": FlightVolume,
        "vehicle": VehicleParams,
        "propeller": PropellerChoice,
    }
    commands: ClassVar[Mapping[str, str]] = {
        "abort": "land here, at once and for good: no set point is obeyed any more",
        "kill": "stop the rotors, wherever the vehicle is",
    }

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> ControllerCore:
        """Return a new controller."""
        propeller, vehicle = records["propeller"], records["vehicle"]
        maps = mounted_rotors(propeller, vehicle)
        safety, volume = records["safety"], records["volume"]
        core = cls(records["control"], vehicle, records["inputs"], maps, safety, volume)
        core.autopilot.recovery.recovery_time = recovery_time(propeller)
        for section in ("recovery", "contact"):
            core.set_params(section, records[section])
        return core

    def __init__(
        self,
        control: ControlParams,
        vehicle: VehicleParams,
        limits: InputLimits,
        maps: RotorMaps,
        safety: SafetyParams | None = None,
        volume: FlightVolume | None = None,
    ) -> None:
        super().__init__()
        self._began_ns: int | None = None
        self._imu_ns: int | None = None
        """When the last gyro sample came."""
        self._gyro_stamp_ns = 0
        self._changes = 0
        self.limits = parameter_record(limits)
        self.maps = maps
        level = np.array([0.0, 0.0, 0.0, 1.0])
        self.autopilot = new_autopilot(control, EstimatorParams(), vehicle, np.zeros(3), level)
        self.memory = ControllerMemory.new()
        begin_controller(self.memory)
        self.set_params("safety", safety or SafetyParams())
        self.set_params("recovery", RecoveryParams())
        self.set_params("contact", ContactParams())
        self.set_params("volume", volume or FlightVolume())

    def on(
        self, topic: str, message: Odometry | EstimatorStatus | PositionSetpoint | Imu, now_ns: int
    ) -> None:
        """Take an estimate, biases, a set point, or a gyro sample, which is answered at once."""
        several = topic in self.contested
        if isinstance(message, Imu):
            self._imu_ns = now_ns
            if not several:
                self._answer(message, now_ns)
        elif isinstance(message, EstimatorStatus):
            if not self.take(topic, message, now_ns):
                self.health.refuse("estimator_status_refused", "bias with NaN")
        elif several:
            return
        elif isinstance(message, Odometry):
            self._take_odometry(message, now_ns)
        else:
            self._take_setpoint(message, now_ns)

    def _answer(self, sample: Imu, now_ns: int) -> None:
        stamp = sample.stamp_ns
        if not math.isfinite(sample.gyro.sum()):
            self.health.report_event("imu_not_finite", "gyro sample with NaN or infinity")
        if self.clock_slack_ns and stamp < self._gyro_stamp_ns - CLOCK_SET_BACK_NS:
            reset_inputs(self.memory)  # the last flight's set point would lift the vehicle off
        self._gyro_stamp_ns = stamp
        self.take("/imu/data_raw", sample, now_ns)

    def _take_odometry(self, message: Odometry, now_ns: int) -> None:
        early = is_future(message.stamp_ns, now_ns + self.clock_slack_ns)
        if early or not self.take("/odometry", message, now_ns):
            self.health.refuse(
                "odometry_refused", "odometry not finite, not a rotation, old or in the future"
            )

    def _take_setpoint(self, message: PositionSetpoint, now_ns: int) -> None:
        latest_ns = max(self._gyro_stamp_ns, now_ns) + self.clock_slack_ns
        if self.clock_slack_ns and is_future(message.stamp_ns, latest_ns):
            self.health.refuse(
                "setpoint_refused", "set point: stamp in the future; restarted simulation?"
            )
            return
        if not self.take("/setpoint", message, now_ns):
            self.health.refuse(
                "setpoint_refused",
                "set point not finite, or too far from the vehicle: the last one stands",
            )

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return the answers to the gyro samples since the last step."""
        if self._began_ns is None or now_ns < self._began_ns:
            self._began_ns = now_ns
        silent_ns = now_ns - (self._imu_ns or self._began_ns + START_GRACE_NS)
        silent = silent_ns > self.limits.imu_timeout * SECOND_NS
        self.health.fault("imu_silent", silent, "no gyro: no commands", ERROR)
        self._report_state()
        return super().step(now_ns)

    def _report_state(self) -> None:
        watch, health = self.memory.watch, self.health
        state = SafetyState(int(watch.state))
        health.fault("blind", state == SafetyState.BLIND, _BLIND_TEXT, ERROR)
        health.fault("setpoint_silent", state == SafetyState.HOLD, "no set point: holding")
        lands = state == SafetyState.LAND
        health.fault("lands", lands, "the controller lands by itself: set points ignored", ERROR)
        standby = state == SafetyState.STANDBY
        why = "started in flight, or away for long: no commands until a take-off"
        health.fault("standby", standby, why)
        health.values["safety"] = state.name.lower()
        if watch.changes != self._changes:
            self._changes = int(watch.changes)
            if watch.row >= 0:
                row = TABLE[watch.row]
                health.values["safety_reason"] = row.condition.name.lower()
                if row.condition not in _NORMAL:
                    text = (
                        f"{row.state.name.lower()} to {state.name.lower()}: {row.condition.text}"
                    )
                    health.report_event(f"safety_{row.condition.name.lower()}", text)

    def command(self, name: str) -> str:
        """Obey an operator: a name of `commands`; return why not, empty: it is obeyed."""
        watch = self.memory.watch
        if name == "abort" and bool(rotors_off(watch)):
            return f"the rotors are off: {SafetyState(int(watch.state)).name.lower()}"
        watch.requests |= 1 << Condition[name.upper()]
        return ""

    def set_params(self, section: str, params: Any) -> None:
        """Take other gains or limits in flight."""
        if section == "volume":
            check_volume(params)
        records = {
            "control": self.autopilot.gains,
            "recovery": self.autopilot.recovery.gains,
            "contact": self.memory.contact.params,
            "safety": self.memory.watch.params,
            "volume": self.memory.watch.volume,
            "inputs": self.limits,
        }
        fill_record(records[section], params)
