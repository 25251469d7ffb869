"""The controller as a node sees it: gyro samples, estimates and set points in, commands out.

One call for each gyro sample. What is missing or stale decides how it flies: without set points it
holds the last one; without estimates, or without poses behind them, it levels and descends;
without gyro it says nothing, and the flight controller behind it takes over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, ClassVar, NamedTuple

import numpy as np

from tombo_control.autopilot import BLIND, IDLE, LANDED, A, G, new_autopilot, part
from tombo_control.cascade import stop_rotors
from tombo_control.estimate import Array, nearest_tick
from tombo_control.gyro_propagation import control_tick, correct_with_estimate
from tombo_control.params import (
    ATTITUDE_TICKS,
    POSITION_TICKS,
    ControlParams,
    EstimatorParams,
    InputLimits,
)
from tombo_dynamics.core import ERROR, Core
from tombo_dynamics.jit import compiled, compiled_call
from tombo_dynamics.message_records import ODOMETRY, POSITION_SETPOINT, fill_record
from tombo_dynamics.messages import (
    AttitudeSetpoint,
    EstimatorStatus,
    Imu,
    Odometry,
    PositionSetpoint,
    RatesSetpoint,
    RotorCommand,
)
from tombo_dynamics.params import as_tuple, tuple_type
from tombo_dynamics.propeller import thrust_map
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_configuration
from tombo_dynamics.rotation import rotated
from tombo_dynamics.rotor_maps import RotorMaps, rotor_maps
from tombo_dynamics.vehicle import VehicleParams

_MAX_GAP_TICKS = 100
_AHEAD_NS = 5_000_000
"""An estimate may be stamped so far ahead of the clock."""
_GRACE_NS = 3_000_000_000
"""Nodes start in any order: before its first sample the gyro may be silent for so long."""
_NEW_SIMULATION_NS = 1_000_000_000
"""On a simulated clock: stamps that differ by more are of another simulation."""
_BLIND_TEXT = "position unknown (estimate or mocap too old): level descent"


_Limits: Any = tuple_type(InputLimits, "_Limits", __name__)
_NEVER = -1

CONTROLLER = np.dtype(
    [
        ("tick", np.int64),  # of the last gyro sample; -1: none, as in the next ones
        ("position_slot", np.int64),  # of the last run of the position loop
        ("attitude_slot", np.int64),
        ("estimate_ns", np.int64),  # stamp of the last estimate taken
        ("pose_ns", np.int64),  # of the last pose behind it
        ("setpoint_ns", np.int64),  # when the set point came
        ("has_setpoint", np.bool_),
        ("setpoint", POSITION_SETPOINT),
        ("blind", np.bool_),  # the position is not known
        ("position_ran", np.bool_),  # in the last tick, as the next ones
        ("attitude_ran", np.bool_),
        ("held", np.bool_),  # holds the last set point: none is coming
    ],
    align=True,
)
"""Bookkeeping of the controller's core; its state is an autopilot's memory."""


@compiled_call
def reset_inputs(r: Any) -> None:
    """Take all that was said so far for another flight's: no set point, so no rotor turns."""
    r.estimate_ns = _NEVER
    r.pose_ns = _NEVER
    r.setpoint_ns = _NEVER
    r.has_setpoint = False
    r.blind = False


@compiled_call
def begin_controller(r: Any) -> None:
    """Begin before the first gyro sample."""
    r.tick = _NEVER
    r.position_slot = _NEVER
    r.attitude_slot = _NEVER
    reset_inputs(r)


@compiled_call
def take_odometry(r: Any, a: Array, odometry: Any) -> bool:
    """Take an estimate; False: not finite, not a rotation, or old."""
    q = odometry.attitude
    vx, vy, vz = rotated(q, odometry.velocity[0], odometry.velocity[1], odometry.velocity[2])
    values = np.empty(10)
    values[3], values[4], values[5] = vx, vy, vz
    total = vx + vy + vz
    for i in range(3):
        values[i] = odometry.position[i]
        total += values[i]
    square = 0.0
    for i in range(4):
        values[6 + i] = q[i]
        square += q[i] * q[i]
    if not math.isfinite(total + square) or odometry.stamp_ns <= r.estimate_ns:
        return False
    if abs(square - 1.0) > 0.01:
        return False
    r.estimate_ns = odometry.stamp_ns
    correct_with_estimate(a, values, nearest_tick(odometry.stamp_ns), max(r.tick, 0))
    return True


@compiled_call
def take_biases(r: Any, a: Array, gyro_bias: Array, pose_stamp_ns: int) -> bool:
    """Take the gyro's bias (3) [rad/s] and the last pose's capture time; False: not finite."""
    if not math.isfinite(gyro_bias[0] + gyro_bias[1] + gyro_bias[2]):
        return False
    for i in range(3):
        a[A.gyro_bias + i] = gyro_bias[i]
    r.pose_ns = pose_stamp_ns
    return True


@compiled_call
def take_setpoint(r: Any, setpoint: Any, now_ns: int) -> bool:
    """Take a set point that arrived at `now_ns`; False: not finite."""
    total = setpoint.yaw
    for i in range(3):
        total += setpoint.position[i] + setpoint.velocity[i] + setpoint.acceleration[i]
    if not math.isfinite(total):
        return False
    s = r.setpoint
    for i in range(3):
        s.position[i] = setpoint.position[i]
        s.velocity[i] = setpoint.velocity[i]
        s.acceleration[i] = setpoint.acceleration[i]
    s.yaw = setpoint.yaw
    s.phase = setpoint.phase
    r.has_setpoint = True
    r.setpoint_ns = now_ns
    return True


@compiled
def answer_gyro(
    r: Any, a: Array, maps: RotorMaps, limits: Any, now_ns: int, stamp_ns: int, gyro: Array
) -> bool:
    """Set the rotor speeds `A.command`; False for a sample that is not newer than the last.

    Args:
        r: the controller's bookkeeping.
        a: the autopilot's memory.
        maps: the rotor's table.
        limits: `InputLimits`.
        now_ns: time now, of the stamps' clock.
        stamp_ns: capture time of the sample.
        gyro: (3) [rad/s], base_link; what is not finite is taken from the sample before.
    """
    tick = nearest_tick(stamp_ns)
    ticks = tick - r.tick
    if r.tick < 0 or ticks < -_MAX_GAP_TICKS or ticks > _MAX_GAP_TICKS:
        if ticks < -_MAX_GAP_TICKS:  # the clock was set back
            r.estimate_ns = _NEVER
            r.pose_ns = _NEVER
            r.setpoint_ns = min(r.setpoint_ns, now_ns)
        ticks = 1
    elif ticks <= 0:
        return False
    r.tick = tick
    s = r.setpoint
    r.position_ran = False
    r.attitude_ran = False
    r.held = False
    if not r.has_setpoint or s.phase == IDLE or s.phase == LANDED:
        mode = s.phase if r.has_setpoint else IDLE
        control_tick(a, maps, gyro, tick, ticks, False, False, False)
        stop_rotors(a)
        a[A.mode] = mode
        a[A.mode + 1] = mode
        return True
    r.position_ran = tick // POSITION_TICKS != r.position_slot
    r.attitude_ran = tick // ATTITUDE_TICKS != r.attitude_slot
    r.held = now_ns - r.setpoint_ns > limits.setpoint_timeout * 1e9
    if r.position_ran:
        r.position_slot = tick // POSITION_TICKS
        odometry = stamp_ns - r.estimate_ns > limits.odometry_timeout * 1e9
        r.blind = odometry or stamp_ns - r.pose_ns > a[G.blind_timeout] * 1e9
        for i in range(3):
            a[A.position_setpoint + i] = s.position[i]
            a[A.velocity_setpoint + i] = 0.0 if r.held else s.velocity[i]
            a[A.acceleration_setpoint + i] = 0.0 if r.held else s.acceleration[i]
        a[A.leg + 9] = s.yaw
        a[A.mode] = s.phase
        a[A.mode + 1] = BLIND if r.blind else s.phase
    if r.attitude_ran:
        r.attitude_slot = tick // ATTITUDE_TICKS
    control_tick(a, maps, gyro, tick, ticks, r.position_ran, r.attitude_ran, r.blind)
    return True


class Command(NamedTuple):
    """Answer to one gyro sample."""

    stamp_ns: int
    """Capture time of the gyro sample."""
    speed: Array
    """(4) rotor speeds [rad/s]."""
    position_ran: bool
    attitude_ran: bool
    """Which of the slower loops ran for it; their set points are in the properties below."""
    blind: bool
    """Levels and descends: the position is not known."""
    held: bool
    """Holds the last set point: none is coming."""


class ControllerCore(Core):
    """The cascade of 50, 250 and 1000 Hz behind its inputs."""

    name = "controller"
    inputs = ("/odometry", "/estimator/status", "/setpoint", "/imu/data_raw")
    outputs = ("/rotor_command", "/rates_setpoint", "/attitude_setpoint")
    period_ns = 1_000_000
    sections: ClassVar[Mapping[str, type]] = {
        "control": ControlParams,
        "inputs": InputLimits,
        "vehicle": VehicleParams,
        "propeller": PropellerChoice,
    }

    @classmethod
    def make(cls, records: Mapping[str, Any]) -> ControllerCore:
        """Return a new controller."""
        propeller, vehicle = records["propeller"], records["vehicle"]
        maps = rotor_maps(thrust_map(mounted_configuration(propeller), propeller.law), vehicle)
        return cls(records["control"], vehicle, records["inputs"], maps)

    def __init__(
        self, control: ControlParams, vehicle: VehicleParams, limits: InputLimits, maps: RotorMaps
    ) -> None:
        super().__init__()
        self._outputs: list[tuple[str, Any]] = []
        self._multiple_publishers: set[str] = set()
        self._began_ns: int | None = None
        self._imu_ns: int | None = None
        """When the last gyro sample came."""
        self._gyro_stamp_ns = 0
        self._refused = 0
        self._control = control
        self._vehicle = vehicle
        self.limits = as_tuple(limits, _Limits)
        self.maps = maps
        self.autopilot = self._fresh()
        """Memory of the cascade, `tombo_control.autopilot`."""
        self.memory: Any = np.zeros(1, CONTROLLER)[0]
        begin_controller(self.memory)
        self._odometry: Any = np.zeros(1, ODOMETRY)[0]
        self._setpoint: Any = np.zeros(1, POSITION_SETPOINT)[0]

    def _fresh(self) -> Array:
        level = np.array([0.0, 0.0, 0.0, 1.0])
        return new_autopilot(self._control, EstimatorParams(), self._vehicle, np.zeros(3), level)

    def on(
        self,
        topic: str,
        message: Odometry | EstimatorStatus | PositionSetpoint | Imu,
        now_ns: int,
    ) -> None:
        """Take an estimate, biases, a set point, or a gyro sample, which is answered at once."""
        several = topic in self._multiple_publishers
        if isinstance(message, Imu):
            self._imu_ns = now_ns
            if not several:
                self._answer(message, now_ns)
        elif isinstance(message, EstimatorStatus):
            if not self.biases(message.gyro_bias, message.pose_stamp_ns):
                self._refuse("estimator_status", "gyro bias with NaN")
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
        if self.clock_slack_ns and stamp < self._gyro_stamp_ns - _NEW_SIMULATION_NS:
            self.reset_inputs()  # the last flight's set point would lift the vehicle off
        self._gyro_stamp_ns = stamp
        command = self.tick(now_ns, stamp, sample.gyro)
        if command is None:
            return
        self._outputs.append(("/rotor_command", RotorCommand(stamp, command.speed)))
        if command.attitude_ran:
            rates = RatesSetpoint(stamp, *self.rates_setpoint)
            self._outputs.append(("/rates_setpoint", rates))
        if command.position_ran:
            attitude = AttitudeSetpoint(stamp, *self.attitude_setpoint)
            self._outputs.append(("/attitude_setpoint", attitude))
            health = self.health
            health.fault("blind", command.blind, _BLIND_TEXT, ERROR)
            health.fault("setpoint_silent", command.held, "no set point: holding the last")

    def _take_odometry(self, message: Odometry, now_ns: int) -> None:
        early = message.stamp_ns > now_ns + _AHEAD_NS + self.clock_slack_ns
        if early or not self.estimate(message):
            self._refuse("odometry", "odometry not finite, not a rotation, old or from later")

    def _take_setpoint(self, message: PositionSetpoint, now_ns: int) -> None:
        latest_ns = max(self._gyro_stamp_ns, now_ns) + _NEW_SIMULATION_NS
        if self.clock_slack_ns and message.stamp_ns > latest_ns:
            self._refuse("setpoint", "set point from later: of a simulation before this one?")
        elif not self.setpoint(message, now_ns):
            self._refuse("setpoint", "set point with NaN or infinity: the last one stands")

    def _refuse(self, what: str, text: str) -> None:
        self._refused += 1
        self.health.values["refused"] = self._refused
        self.health.report_event(f"{what}_refused", text)

    def step(self, now_ns: int) -> Sequence[tuple[str, Any]]:
        """Return the answers to the gyro samples since the last step."""
        if self._began_ns is None or now_ns < self._began_ns:
            self._began_ns = now_ns
        silent_ns = now_ns - (self._imu_ns or self._began_ns + _GRACE_NS)
        silent = silent_ns > self.limits.imu_timeout * 1e9
        self.health.fault("imu_silent", silent, "no gyro: no commands", ERROR)
        outputs, self._outputs = self._outputs, []
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take other gains in flight; another vehicle or propeller at the next start only."""
        if section == "control":
            self._control = params
            self.autopilot[G[0] :] = self._fresh()[G[0] :]
        elif section == "inputs":
            self.limits = as_tuple(params, _Limits)
        else:
            self.health.fault("not_at_runtime", True, f"{section} is used at the next start")

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Use nothing of a topic with several publishers: nobody can tell which is true."""
        (self._multiple_publishers.add if several else self._multiple_publishers.discard)(topic)

    def reset_inputs(self) -> None:
        """Take all that was said so far for another flight's: no set point, so no rotor turns."""
        reset_inputs(self.memory)

    def estimate(self, odometry: Odometry) -> bool:
        """Take an estimate as `take_odometry` does; False: not taken."""
        fill_record(self._odometry, odometry)
        return take_odometry(self.memory, self.autopilot, self._odometry)

    def biases(self, gyro_bias: Array, pose_stamp_ns: int) -> bool:
        """Take the gyro's bias (3) [rad/s] and the capture time of the last pose used."""
        return take_biases(self.memory, self.autopilot, gyro_bias, pose_stamp_ns)

    def setpoint(self, setpoint: PositionSetpoint, now_ns: int) -> bool:
        """Take a set point that arrived at `now_ns`; False: not finite."""
        fill_record(self._setpoint, setpoint)
        return take_setpoint(self.memory, self._setpoint, now_ns)

    def tick(self, now_ns: int, stamp_ns: int, gyro: Array) -> Command | None:
        """Answer a gyro sample as `answer_gyro` does; None for one that is not newer."""
        r, a = self.memory, self.autopilot
        if not answer_gyro(r, a, self.maps, self.limits, now_ns, stamp_ns, gyro):
            return None
        ran, blind = bool(r["position_ran"]), bool(r["blind"]) and self.flying
        command = part(a, "command").copy()
        return Command(stamp_ns, command, ran, bool(r["attitude_ran"]), blind, bool(r["held"]))

    @property
    def flying(self) -> bool:
        """Whether the rotors are to turn."""
        return bool(self.autopilot[A.mode] != IDLE and self.autopilot[A.mode] != LANDED)

    @property
    def attitude_setpoint(self) -> tuple[Array, float]:
        """Attitude (4) xyzw and collective thrust [N] asked for."""
        a = self.autopilot
        return part(a, "attitude_setpoint").copy(), float(a[A.thrust_setpoint])

    @property
    def rates_setpoint(self) -> tuple[Array, float]:
        """Body rates (3) [rad/s] and collective thrust [N] asked for."""
        return part(self.autopilot, "rates_setpoint").copy(), float(
            self.autopilot[A.thrust_setpoint]
        )
