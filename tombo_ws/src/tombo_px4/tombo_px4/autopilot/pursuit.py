"""From a demand to rotor speeds: the cascade of 50, 250 and 1000 Hz, within PX4's limits."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tombo_control.attitude_control import attitude_control
from tombo_control.autopilot import A, G, N, part
from tombo_control.cascade import run_loops, stand_by
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_dynamics.rotor_maps import R, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.targets import Demand, Kind, heading_of

Array = NDArray[np.float64]
_PERIOD = POSITION_TICKS * 1e-3


class Pursuit:
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
        stand_by(self._a)
        self._a[A.leg + 9] = heading_of(part(self._a, "attitude"))
        self._yaw_rate = 0.0

    def stop(self) -> None:
        """Rotors off."""
        stand_by(self._a)
        self._a[A.thrust_setpoint] = 0.0
        self.loops = (False, False, False)

    def idle(self, speed: float) -> None:
        """Rotors at their idle speed, nothing controlled."""
        stand_by(self._a)
        self._a[A.thrust_setpoint] = 0.0
        part(self._a, "command")[:] = speed
        self.loops = (False, False, False)

    def take(self, demand: Demand, climb_max: float) -> None:
        """Take a demand for the next period of the position loop, at its tick.

        Args:
            demand: what to follow.
            climb_max: highest climb rate [m/s], besides MPC_Z_VEL_MAX_UP.
        """
        self._limits()
        a = self._a
        if demand.kind == Kind.RATES:
            part(a, "rates_setpoint")[:] = demand.rates
            a[A.thrust_setpoint] = demand.thrust * self.thrust_max
            self._stay_ready()
            self.loops = (False, False, True)
            return
        if demand.kind == Kind.ATTITUDE:
            part(a, "attitude_setpoint")[:] = demand.attitude
            a[A.thrust_setpoint] = demand.thrust * self.thrust_max
            self._yaw_rate = float(demand.rates[2])
            self._stay_ready()
            self.loops = (False, True, True)
            return
        self._aim(demand, climb_max)
        self.loops = (True, True, True)

    def blind(self) -> None:
        """Level and descend, at the next runs of the loops."""
        self._yaw_rate = 0.0
        self.loops = (True, True, True)

    def settle(self) -> None:
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
            run_loops(a, maps, position, attitude, blind)
            return
        if position:  # the yaw rate is fed forward between the loops
            run_loops(a, maps, True, False, blind)
        if attitude:
            attitude_control(a)
            limit = a[G.yaw_rate_max]
            total = a[A.rates_setpoint + 2] + self._yaw_rate
            a[A.rates_setpoint + 2] = min(max(total, -limit), limit)
        if not position:
            run_loops(a, maps, False, False, blind)

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

    def _stay_ready(self) -> None:
        """Keep what the position loop remembers at the present motion."""
        a = self._a
        part(a, "velocity_integral")[:] = 0.0
        part(a, "previous_velocity")[:] = part(a, "velocity")
        part(a, "position_setpoint")[:] = part(a, "position")
        a[A.leg + 9] = heading_of(part(self._a, "attitude"))

    def _aim(self, demand: Demand, climb_max: float) -> None:
        a = self._a
        position, velocity = part(a, "position"), part(a, "velocity")
        known = np.isfinite(demand.position)
        moving = np.isfinite(demand.velocity)
        pushed = np.isfinite(demand.acceleration)
        part(a, "position_setpoint")[:] = np.where(known, demand.position, position)
        free = ~known & ~moving
        part(a, "velocity_setpoint")[:] = np.where(
            moving, demand.velocity, np.where(free, velocity, 0.0)
        )
        part(a, "acceleration_setpoint")[:] = np.where(pushed, demand.acceleration, 0.0)
        if math.isfinite(demand.yaw_rate):
            self._yaw_rate = demand.yaw_rate
            if not math.isfinite(demand.yaw):
                a[A.leg + 9] = math.remainder(
                    float(a[A.leg + 9]) + demand.yaw_rate * _PERIOD, 2.0 * math.pi
                )
        else:
            self._yaw_rate = 0.0
        if math.isfinite(demand.yaw):
            a[A.leg + 9] = demand.yaw
        get = self._parameters.get
        climb = float(
            a[A.velocity_setpoint + 2]
            + a[G.position_p] * (a[A.position_setpoint + 2] - a[A.position + 2])
        )
        up = min(get("MPC_Z_VEL_MAX_UP"), climb_max)
        a[G.velocity_max_z] = max(up if climb > 0.0 else get("MPC_Z_VEL_MAX_DN"), 0.0)
