"""From a demand to rotor speeds: the cascade of 50, 250 and 1000 Hz, within PX4's limits."""

from __future__ import annotations

import math

import numpy as np

from tombo_control.attitude_control import attitude_control
from tombo_control.autopilot import A, G, N, part
from tombo_control.cascade import run_control_loops, stop_rotors
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotor_maps import R, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.offboard_setpoint import ControlLevel, ResolvedSetpoint, heading_of
from tombo_px4.autopilot.parameters import ParameterTable

_PERIOD = POSITION_TICKS * 1e-3


class SetpointController:
    """Flies the demand that was last given, in the autopilot's memory `a`."""

    def __init__(self, a: Array, maps: Array, parameters: ParameterTable) -> None:
        self._a = a
        self._maps = maps
        self._parameters = parameters
        self._version = -1
        self.thrust_max = 4.0 * float(maps[R.thrust_highest])
        """Collective thrust [N] at full throttle."""
        self.speed_max = float(speed_for_thrust(maps, maps[R.thrust_highest]))
        """Highest rotor speed [rad/s]."""
        self.weight = float(a[N.mass]) * GRAVITY
        """[N], as the autopilot knows it."""
        self._yaw_rate = 0.0
        self.loops = (False, False, False)
        """Whether position, attitude and rate loop are in use."""

    @property
    def hover(self) -> float:
        """Share of the highest thrust that hovers."""
        return self.weight / self.thrust_max

    def start(self) -> None:
        """Begin from rest: heading and motion as they are."""
        stop_rotors(self._a)
        self._a[A.leg + 9] = heading_of(part(self._a, "attitude"))
        self._yaw_rate = 0.0

    def stop(self) -> None:
        """Rotors off."""
        stop_rotors(self._a)
        self._a[A.thrust_setpoint] = 0.0
        self.loops = (False, False, False)

    def idle(self, speed: float) -> None:
        """Rotors at their idle speed, nothing controlled."""
        stop_rotors(self._a)
        self._a[A.thrust_setpoint] = 0.0
        part(self._a, "command")[:] = speed
        self.loops = (False, False, False)

    def take(self, resolved: ResolvedSetpoint, climb_max: float) -> None:
        """Take a demand for the next period of the position loop, at its tick.

        Args:
            resolved: what to follow.
            climb_max: highest climb rate [m/s], besides MPC_Z_VEL_MAX_UP.
        """
        self._limits()
        a = self._a
        if resolved.kind == ControlLevel.RATES:
            part(a, "rates_setpoint")[:] = resolved.rates
            a[A.thrust_setpoint] = resolved.thrust * self.thrust_max
            self._hold_position_loop()
            self.loops = (False, False, True)
            return
        if resolved.kind == ControlLevel.ATTITUDE:
            part(a, "attitude_setpoint")[:] = resolved.attitude
            a[A.thrust_setpoint] = resolved.thrust * self.thrust_max
            self._yaw_rate = float(resolved.rates[2])
            self._hold_position_loop()
            self.loops = (False, True, True)
            return
        self._apply_position_demand(resolved, climb_max)
        self.loops = (True, True, True)

    def blind(self) -> None:
        """Level and descend, at the next runs of the loops."""
        self._yaw_rate = 0.0
        self.loops = (True, True, True)

    def reduce_thrust_on_ground(self) -> None:
        """Push less until the next run of the position loop: the ground holds it, or it sinks."""
        a = self._a
        a[A.thrust_setpoint] = min(float(a[A.thrust_setpoint]), 0.5 * self.weight)

    def run(self, tick: int, blind: bool) -> None:
        """Run the loops that are due in `tick`."""
        a, maps = self._a, self._maps
        position, attitude, rate = self.loops
        if not rate:
            return
        position = position and tick % POSITION_TICKS == 0
        attitude = attitude and tick % ATTITUDE_TICKS == 0
        if self._yaw_rate == 0.0:
            run_control_loops(a, maps, position, attitude, blind)
            return
        if position:  # the yaw rate is fed forward between the loops
            run_control_loops(a, maps, True, False, blind)
        if attitude:
            attitude_control(a)
            limit = a[G.yaw_rate_max]
            total = a[A.rates_setpoint + 2] + self._yaw_rate
            a[A.rates_setpoint + 2] = min(max(total, -limit), limit)
        if not position:
            run_control_loops(a, maps, False, False, blind)

    def _limits(self) -> None:
        """Take limits from the parameters when they have changed."""
        if self._parameters.version == self._version:
            return
        self._version = self._parameters.version
        get, a = self._parameters.get, self._a
        a[G.velocity_max_xy] = max(get("MPC_XY_VEL_MAX"), 0.01)
        a[G.tilt_max] = math.radians(get("MPC_TILTMAX_AIR"))
        a[G.yaw_rate_max] = math.radians(get("MPC_YAWRAUTO_MAX"))
        a[G.position_p] = get("MPC_XY_P")

    def _hold_position_loop(self) -> None:
        """Keep what the position loop remembers at the present motion."""
        a = self._a
        part(a, "velocity_integral")[:] = 0.0
        part(a, "previous_velocity")[:] = part(a, "velocity")
        part(a, "position_setpoint")[:] = part(a, "position")
        a[A.leg + 9] = heading_of(part(self._a, "attitude"))

    def _apply_position_demand(self, resolved: ResolvedSetpoint, climb_max: float) -> None:
        a = self._a
        position, velocity = part(a, "position"), part(a, "velocity")
        known = np.isfinite(resolved.position)
        moving = np.isfinite(resolved.velocity)
        pushed = np.isfinite(resolved.acceleration)
        part(a, "position_setpoint")[:] = np.where(known, resolved.position, position)
        free = ~known & ~moving
        part(a, "velocity_setpoint")[:] = np.where(
            moving, resolved.velocity, np.where(free, velocity, 0.0)
        )
        part(a, "acceleration_setpoint")[:] = np.where(pushed, resolved.acceleration, 0.0)
        if math.isfinite(resolved.yaw_rate):
            self._yaw_rate = resolved.yaw_rate
            if not math.isfinite(resolved.yaw):
                a[A.leg + 9] = math.remainder(
                    float(a[A.leg + 9]) + resolved.yaw_rate * _PERIOD, 2.0 * math.pi
                )
        else:
            self._yaw_rate = 0.0
        if math.isfinite(resolved.yaw):
            a[A.leg + 9] = resolved.yaw
        get = self._parameters.get
        climb = float(
            a[A.velocity_setpoint + 2]
            + a[G.position_p] * (a[A.position_setpoint + 2] - a[A.position + 2])
        )
        up = min(get("MPC_Z_VEL_MAX_UP"), climb_max)
        a[G.velocity_max_z] = max(up if climb > 0.0 else get("MPC_Z_VEL_MAX_DN"), 0.0)
