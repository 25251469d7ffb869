"""The controller as a node sees it: gyro samples, estimates and set points in, commands out.

One call for each gyro sample. What is missing or stale decides how it flies: without set points it
holds the last one; without estimates, or without poses behind them, it levels and descends;
without gyro it says nothing, and the flight controller behind it takes over.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from tombo_control.autopilot import BLIND, IDLE, LANDED, A, G, new_autopilot, part
from tombo_control.cascade import stop_rotors
from tombo_control.estimate import Array, Estimate, Setpoint, nearest_tick
from tombo_control.gyro_propagation import control_tick, correct_with_estimate
from tombo_control.params import (
    ATTITUDE_TICKS,
    POSITION_TICKS,
    ControlParams,
    EstimatorParams,
    InputLimits,
)
from tombo_dynamics.core import ERROR, Core
from tombo_dynamics.messages import (
    AttitudeSetpoint,
    EstimatorStatus,
    Imu,
    Odometry,
    PositionSetpoint,
    RatesSetpoint,
    RotorCommand,
)
from tombo_dynamics.propeller import thrust_map
from tombo_dynamics.propeller.mounted_propeller import PropellerChoice, mounted_configuration
from tombo_dynamics.rotation import rotate_vectors
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_dynamics.vehicle import VehicleParams

_MAX_GAP_TICKS = 100
_AHEAD_NS = 5_000_000
"""An estimate may be stamped so far ahead of the clock."""
_GRACE_NS = 3_000_000_000
"""Nodes start in any order: before its first sample the gyro may be silent for so long."""
_NEW_SIMULATION_NS = 1_000_000_000
"""On a simulated clock: stamps that differ by more are of another simulation."""
_BLIND_TEXT = "position unknown (estimate or mocap too old): level descent"


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
    sections = {
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
        self, control: ControlParams, vehicle: VehicleParams, limits: InputLimits, maps: Array
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
        self._limits = limits
        self._maps = maps
        level = np.array([0.0, 0.0, 0.0, 1.0])
        self._a = new_autopilot(control, EstimatorParams(), vehicle, np.zeros(3), level)
        self._tick = -1
        self._position_slot = self._attitude_slot = -1
        self.reset_inputs()

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
        velocity = rotate_vectors(message.attitude, message.velocity)
        estimate = Estimate(
            message.stamp_ns,
            message.position,
            velocity,
            message.attitude,
            message.rates,
            np.zeros(3),
            np.zeros(3),
            0,
        )
        early = message.stamp_ns > now_ns + _AHEAD_NS + self.clock_slack_ns
        if early or not self.estimate(estimate):
            self._refuse("odometry", "odometry not finite, not a rotation, old or from later")

    def _take_setpoint(self, message: PositionSetpoint, now_ns: int) -> None:
        latest_ns = max(self._gyro_stamp_ns, now_ns) + _NEW_SIMULATION_NS
        if self.clock_slack_ns and message.stamp_ns > latest_ns:
            self._refuse("setpoint", "set point from later: of a simulation before this one?")
            return
        setpoint = Setpoint(
            message.position,
            message.velocity,
            message.acceleration,
            message.yaw,
            message.phase,
            message.stamp_ns,
        )
        if not self.setpoint(setpoint, now_ns):
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
        silent = silent_ns > self._limits.imu_timeout * 1e9
        self.health.fault("imu_silent", silent, "no gyro: no commands", ERROR)
        outputs, self._outputs = self._outputs, []
        return outputs

    def set_params(self, section: str, params: Any) -> None:
        """Take other gains in flight; another vehicle or propeller at the next start only."""
        if section == "control":
            self.params(params, self._limits)
        elif section == "inputs":
            self.params(self._control, params)
        else:
            self.health.fault("not_at_runtime", True, f"{section} is used at the next start")

    def set_multiple_publishers(self, topic: str, several: bool) -> None:
        """Use nothing of a topic with several publishers: nobody can tell which is true."""
        (self._multiple_publishers.add if several else self._multiple_publishers.discard)(topic)

    def reset_inputs(self) -> None:
        """Take all that was said so far for another flight's: no set point, so no rotor turns."""
        self._estimate_ns = self._pose_ns = self._setpoint_ns = -1
        self._setpoint: Setpoint | None = None
        self._blind = False

    def params(self, control: ControlParams, limits: InputLimits) -> None:
        """Take other parameters in flight; state and integrals stay."""
        self._control, self._limits = control, limits
        level = np.array([0.0, 0.0, 0.0, 1.0])
        fresh = new_autopilot(control, EstimatorParams(), self._vehicle, np.zeros(3), level)
        self._a[G[0] :] = fresh[G[0] :]

    def estimate(self, estimate: Estimate) -> bool:
        """Take an estimate (position, velocity, attitude); False: not finite, or old."""
        values = np.concatenate([estimate.position, estimate.velocity, estimate.attitude])
        if not np.isfinite(values.sum()) or estimate.stamp_ns <= self._estimate_ns:
            return False
        if abs(float(estimate.attitude @ estimate.attitude) - 1.0) > 0.01:
            return False
        self._estimate_ns = estimate.stamp_ns
        correct_with_estimate(self._a, values, nearest_tick(estimate.stamp_ns), max(self._tick, 0))
        return True

    def biases(self, gyro_bias: Array, pose_stamp_ns: int) -> bool:
        """Take the gyro's bias (3) [rad/s] and the capture time of the last pose used."""
        if not np.isfinite(gyro_bias.sum()):
            return False
        part(self._a, "gyro_bias")[:] = gyro_bias
        self._pose_ns = pose_stamp_ns
        return True

    def setpoint(self, setpoint: Setpoint, now_ns: int) -> bool:
        """Take a set point that arrived at `now_ns`; False: not finite."""
        if not setpoint.finite():
            return False
        self._setpoint, self._setpoint_ns = setpoint, now_ns
        return True

    def tick(self, now_ns: int, stamp_ns: int, gyro: Array) -> Command | None:
        """Answer a gyro sample; None for one that is not newer than the last.

        Args:
            now_ns: time now, of the stamps' clock.
            stamp_ns: capture time of the sample.
            gyro: (3) [rad/s], base_link; what is not finite is taken from the sample before.
        """
        tick = nearest_tick(stamp_ns)
        ticks = tick - self._tick
        if self._tick < 0 or ticks < -_MAX_GAP_TICKS or ticks > _MAX_GAP_TICKS:
            if ticks < -_MAX_GAP_TICKS:  # the clock was set back
                self._estimate_ns = self._pose_ns = -1
                self._setpoint_ns = min(self._setpoint_ns, now_ns)
            ticks = 1
        elif ticks <= 0:
            return None
        self._tick = tick
        setpoint = self._setpoint
        a = self._a
        if setpoint is None or setpoint.phase in (IDLE, LANDED):
            mode = IDLE if setpoint is None else setpoint.phase
            control_tick(a, self._maps, gyro, tick, ticks, False, False, False)
            stop_rotors(a)
            a[A.mode] = a[A.mode + 1] = mode
            return self._command(stamp_ns, False, False, False)
        position = tick // POSITION_TICKS != self._position_slot
        attitude = tick // ATTITUDE_TICKS != self._attitude_slot
        held = now_ns - self._setpoint_ns > self._limits.setpoint_timeout * 1e9
        if position:
            self._position_slot = tick // POSITION_TICKS
            self._blind = self._is_blind(stamp_ns)
            part(a, "position_setpoint")[:] = setpoint.position
            part(a, "velocity_setpoint")[:] = 0.0 if held else setpoint.velocity
            part(a, "acceleration_setpoint")[:] = 0.0 if held else setpoint.acceleration
            a[A.leg + 9] = setpoint.yaw
            a[A.mode] = setpoint.phase
            a[A.mode + 1] = BLIND if self._blind else setpoint.phase
        if attitude:
            self._attitude_slot = tick // ATTITUDE_TICKS
        control_tick(a, self._maps, gyro, tick, ticks, position, attitude, self._blind)
        return self._command(stamp_ns, position, attitude, held)

    def _is_blind(self, stamp_ns: int) -> bool:
        """Return whether estimate, or the poses behind it, are too old to fly on."""
        odometry = stamp_ns - self._estimate_ns > self._limits.odometry_timeout * 1e9
        poses = stamp_ns - self._pose_ns > self._control.blind_timeout * 1e9
        return odometry or poses

    def _command(self, stamp_ns: int, position: bool, attitude: bool, held: bool) -> Command:
        blind = self._blind and self.flying
        return Command(stamp_ns, part(self._a, "command").copy(), position, attitude, blind, held)

    @property
    def flying(self) -> bool:
        """Whether the rotors are to turn."""
        return bool(self._a[A.mode] != IDLE and self._a[A.mode] != LANDED)

    @property
    def attitude_setpoint(self) -> tuple[Array, float]:
        """Attitude (4) xyzw and collective thrust [N] asked for."""
        return part(self._a, "attitude_setpoint").copy(), float(self._a[A.thrust_setpoint])

    @property
    def rates_setpoint(self) -> tuple[Array, float]:
        """Body rates (3) [rad/s] and collective thrust [N] asked for."""
        return part(self._a, "rates_setpoint").copy(), float(self._a[A.thrust_setpoint])
