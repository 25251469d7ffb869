"""From a demand to rotor speeds: the cascade of 50, 250 and 1000 Hz, within PX4's limits."""

from __future__ import annotations

import math

import numpy as np

from tombo_control.autopilot import Autopilot
from tombo_control.loops.attitude_control import attitude_control
from tombo_control.loops.cascade import stop_rotors
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_control.tick_calls import run_control_loops
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.offboard_setpoint import ControlLevel, ResolvedSetpoint, heading_of
from tombo_px4.autopilot.parameters import ParameterTable

_PERIOD = POSITION_TICKS * TICK_S


class SetpointController:
    """Flies the demand that was last given, in the autopilot's memory."""

    def __init__(self, autopilot: Autopilot, maps: RotorMaps, parameters: ParameterTable) -> None:
        self._autopilot = autopilot
        self._autopilots = autopilot.as_array()
        self._maps = maps.as_array()
        self._parameters = parameters
        self._version = -1
        self.thrust_max = 4.0 * float(maps.thrust_highest)
        """Collective thrust [N] at full throttle."""
        self.speed_max = float(speed_for_thrust(maps, maps.thrust_highest))
        """Highest rotor speed [rad/s]."""
        self.weight = float(autopilot.nominal.mass) * GRAVITY
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
        autopilot = self._autopilot
        self._stop_rotors()
        autopilot.setpoint.yaw = heading_of(autopilot.state.attitude)
        self._yaw_rate = 0.0

    def idle(self, speed: float) -> None:
        """Rotors at a fixed speed [rad/s], 0: off; nothing controlled."""
        self._stop_rotors()
        setpoint = self._autopilot.setpoint
        setpoint.thrust = 0.0
        setpoint.rotor_speed = speed
        self.loops = (False, False, False)

    def _stop_rotors(self) -> None:
        autopilot = self._autopilot
        stop_rotors(autopilot.state, autopilot.setpoint, autopilot.loops)

    def take(self, resolved: ResolvedSetpoint, climb_max: float) -> None:
        """Take a demand for the next period of the position loop, at its tick.

        Args:
            resolved: what to follow.
            climb_max: highest climb rate [m/s], besides MPC_Z_VEL_MAX_UP.
        """
        self._limits()
        setpoint = self._autopilot.setpoint
        if resolved.kind < ControlLevel.ATTITUDE:
            self._apply_position_demand(resolved, climb_max)
            self.loops = (True, True, True)
            return
        by_attitude = resolved.kind == ControlLevel.ATTITUDE
        if by_attitude:
            setpoint.attitude = resolved.attitude
            self._yaw_rate = float(resolved.rates[2])
        else:
            setpoint.rates = resolved.rates
        setpoint.thrust = resolved.thrust * self.thrust_max
        self._hold_position_loop()
        self.loops = (False, by_attitude, True)

    def blind(self) -> None:
        """Level and descend, at the next runs of the loops."""
        self._yaw_rate = 0.0
        self.loops = (True, True, True)

    def reduce_thrust_on_ground(self) -> None:
        """Push less until the next run of the position loop: the ground holds it, or it sinks."""
        setpoint = self._autopilot.setpoint
        setpoint.thrust = min(float(setpoint.thrust), 0.5 * self.weight)

    def run(self, tick: int, blind: bool) -> None:
        """Run the loops that are due in `tick`."""
        autopilot = self._autopilot
        position, attitude, rate = self.loops
        if not rate:
            return
        position = position and tick % POSITION_TICKS == 0
        attitude = attitude and tick % ATTITUDE_TICKS == 0
        if self._yaw_rate == 0.0:
            run_control_loops(self._autopilots, self._maps, position, attitude, blind)
            return
        if position:  # the yaw rate is fed forward between the loops
            run_control_loops(self._autopilots, self._maps, True, False, blind)
        if attitude:
            setpoint, gains = autopilot.setpoint, autopilot.gains
            attitude_control(autopilot.state, setpoint, gains)
            limit = gains.yaw_rate_max
            total = setpoint.rates[2] + self._yaw_rate
            setpoint.rates[2] = min(max(total, -limit), limit)
        if not position:
            run_control_loops(self._autopilots, self._maps, False, False, blind)

    def _limits(self) -> None:
        """Take limits from the parameters when they have changed."""
        if self._parameters.version == self._version:
            return
        self._version = self._parameters.version
        get, gains = self._parameters.get, self._autopilot.gains
        gains.velocity_max_xy = max(get("MPC_XY_VEL_MAX"), 0.01)
        gains.tilt_max = math.radians(get("MPC_TILTMAX_AIR"))
        gains.yaw_rate_max = math.radians(get("MPC_YAWRAUTO_MAX"))
        gains.position_p = get("MPC_XY_P")

    def _hold_position_loop(self) -> None:
        """Keep what the position loop remembers at the present motion."""
        autopilot = self._autopilot
        state, setpoint, loops = autopilot.state, autopilot.setpoint, autopilot.loops
        loops.velocity_integral = 0.0
        loops.previous_velocity = state.velocity
        setpoint.position = state.position
        setpoint.yaw = heading_of(state.attitude)

    def _apply_position_demand(self, resolved: ResolvedSetpoint, climb_max: float) -> None:
        setpoint, gains = self._autopilot.setpoint, self._autopilot.gains
        position, velocity = self._autopilot.state.position, self._autopilot.state.velocity
        known = np.isfinite(resolved.position)
        moving = np.isfinite(resolved.velocity)
        pushed = np.isfinite(resolved.acceleration)
        setpoint.position = np.where(known, resolved.position, position)
        free = ~known & ~moving
        setpoint.velocity = np.where(moving, resolved.velocity, np.where(free, velocity, 0.0))
        setpoint.acceleration = np.where(pushed, resolved.acceleration, 0.0)
        if math.isfinite(resolved.yaw_rate):
            self._yaw_rate = resolved.yaw_rate
            if not math.isfinite(resolved.yaw):
                yaw = float(setpoint.yaw) + resolved.yaw_rate * _PERIOD
                setpoint.yaw = math.remainder(yaw, 2.0 * math.pi)
        else:
            self._yaw_rate = 0.0
        if math.isfinite(resolved.yaw):
            setpoint.yaw = resolved.yaw
        get = self._parameters.get
        above = setpoint.position[2] - position[2]
        climb = float(setpoint.velocity[2] + gains.position_p * above)
        up = min(get("MPC_Z_VEL_MAX_UP"), climb_max)
        gains.velocity_max_z = max(up if climb > 0.0 else get("MPC_Z_VEL_MAX_DN"), 0.0)
