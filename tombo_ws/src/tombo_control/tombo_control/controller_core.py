"""The controller as a node sees it: gyro samples, estimates and set points in, commands out.

One call for each gyro sample. What is missing or stale decides how it flies: without set points it
holds the last one; without estimates, or without poses behind them, it levels and descends;
without gyro it says nothing, and the flight controller behind it takes over.
"""

from __future__ import annotations

from typing import NamedTuple

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
from tombo_dynamics.vehicle import VehicleParams

_MAX_GAP_TICKS = 100


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


class ControllerCore:
    """The cascade of 50, 250 and 1000 Hz behind its inputs."""

    def __init__(
        self, control: ControlParams, vehicle: VehicleParams, limits: InputLimits, maps: Array
    ) -> None:
        self._control = control
        self._vehicle = vehicle
        self._limits = limits
        self._maps = maps
        level = np.array([0.0, 0.0, 0.0, 1.0])
        self._a = new_autopilot(control, EstimatorParams(), vehicle, np.zeros(3), level)
        self._tick = -1
        self._position_slot = self._attitude_slot = -1
        self.reset_inputs()

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
