"""From a set point of OFFBOARD, or of an AUTO mode, to rotor speeds, as PX4 does.

Which combinations are accepted, the reference of each axis, then the cascade of 50, 250 and
1000 Hz, within PX4's limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from tombo_control.autopilot import Autopilot
from tombo_control.loops.cascade import run_control_loops, stop_rotors
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import taking_rows
from tombo_dynamics.rotation import yaw_of
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.modes import AUTO_LAND, AUTO_RTL, AUTO_TAKEOFF, Mode

_run_control_loops = taking_rows(run_control_loops, 2)
_NONE = np.full(3, math.nan)
_LARGEST = 1e5
"""[m, m/s, m/s^2]: a larger value is refused as an error of the sender."""
_TILT_MAX, _YAW_RATE_MAX, _POSITION_P = math.radians(45.0), math.radians(60.0), 0.95
"""[rad], [rad/s], [1/s]: defaults of MPC_TILTMAX_AIR, MPC_YAWRAUTO_MAX and MPC_XY_P."""


class ControlLevel(IntEnum):
    """The outermost loop that a set point drives, innermost last."""

    POSITION = 0
    VELOCITY = 1
    ACCELERATION = 2
    ATTITUDE = 3


@dataclass(frozen=True)
class OffboardSetpoint:
    """A set point: None or NaN means not commanded.

    Either motion (position, velocity, acceleration, yaw) or attitude and thrust; with both, the
    attitude is left out.
    """

    position: Array = field(default_factory=lambda: _NONE)
    """(3) map [m]."""
    velocity: Array = field(default_factory=lambda: _NONE)
    """(3) map [m/s]."""
    acceleration: Array = field(default_factory=lambda: _NONE)
    """(3) map, without gravity [m/s^2]."""
    yaw: float = math.nan
    """Counter-clockwise from east [rad]."""
    attitude: Array | None = None
    """(4) xyzw, map from base_link."""
    thrust: float = math.nan
    """Share of the highest collective thrust, 0 to 1."""

    @property
    def kind(self) -> ControlLevel:
        """Outermost loop that is commanded."""
        for kind, axes in enumerate((self.position, self.velocity, self.acceleration)):
            if np.isfinite(axes).any():
                return ControlLevel(kind)
        return ControlLevel.ATTITUDE


def refusal_of(target: OffboardSetpoint) -> str:
    """Return why PX4 refuses a set point; "" if it takes it."""
    motion = np.array([target.position, target.velocity, target.acceleration])
    commanded = np.isfinite(motion)
    too_large = np.abs(motion[commanded]).max(initial=0.0) > _LARGEST
    if too_large or abs(finite_or_nan(target.yaw)) > _LARGEST:
        return "set point is out of range"
    if commanded.any():
        if not commanded.any(axis=0).all():
            return "invalid set point: an axis is not commanded"
        unlike = (commanded[:, 0] != commanded[:, 1]).any()
        return "invalid set point: x and y differ in what is commanded" if unlike else ""
    if target.attitude is None:
        return "set point commands nothing"
    if not np.isfinite(target.attitude).all():
        return "invalid set point: attitude is not finite"
    if not 0.5 < float(np.linalg.norm(target.attitude)) < 2.0:
        return "invalid set point: attitude is no unit quaternion"
    return "" if math.isfinite(target.thrust) else "invalid set point: no thrust"


def finite_or_nan(value: float | None) -> float:
    """Return a number; NaN for None and infinity."""
    return float(value) if value is not None and math.isfinite(value) else math.nan


class SetpointController:
    """Flies the demand that was last given, in the autopilot's memory."""

    def __init__(self, autopilot: Autopilot, maps: RotorMaps, parameters: ParameterTable) -> None:
        self._autopilot = autopilot
        self._autopilots = autopilot.as_array()
        self._maps = maps.as_array()
        self._parameters = parameters
        gains = autopilot.gains
        gains.tilt_max, gains.yaw_rate_max = _TILT_MAX, _YAW_RATE_MAX
        gains.position_p = _POSITION_P
        self.thrust_max = 4.0 * float(maps.thrust_highest)
        """Collective thrust [N] at full throttle."""
        self.weight = float(autopilot.nominal.mass) * GRAVITY
        """[N], as the autopilot knows it."""
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
        autopilot.setpoint.yaw = yaw_of(autopilot.state.attitude)

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

    def take(self, resolved: OffboardSetpoint, climb_max: float, speed_max: float) -> None:
        """Take a demand for the next period of the position loop, at its tick.

        Args:
            resolved: what to follow.
            climb_max: highest climb rate [m/s], besides MPC_Z_VEL_MAX_UP.
            speed_max: highest horizontal speed [m/s], besides MPC_XY_VEL_MAX.
        """
        gains = self._autopilot.gains
        gains.velocity_max_xy = max(min(self._parameters.get("MPC_XY_VEL_MAX"), speed_max), 0.01)
        setpoint = self._autopilot.setpoint
        if resolved.kind < ControlLevel.ATTITUDE:
            self._apply_position_demand(resolved, climb_max)
            self.loops = (True, True, True)
            return
        assert resolved.attitude is not None
        setpoint.attitude = resolved.attitude / np.linalg.norm(resolved.attitude)
        setpoint.thrust = min(max(resolved.thrust, 0.0), 1.0) * self.thrust_max
        self._hold_position_loop()
        self.loops = (False, True, True)

    def blind(self) -> None:
        """Level and descend, at the next runs of the loops."""
        self.loops = (True, True, True)

    def reduce_thrust_on_ground(self) -> None:
        """Push less until the next run of the position loop: the ground holds it, or it sinks."""
        setpoint = self._autopilot.setpoint
        setpoint.thrust = min(float(setpoint.thrust), 0.5 * self.weight)

    def run(self, tick: int, blind: bool) -> None:
        """Run the loops that are due in `tick`."""
        position, attitude, rate = self.loops
        if rate:
            position = position and tick % POSITION_TICKS == 0
            attitude = attitude and tick % ATTITUDE_TICKS == 0
            _run_control_loops(self._autopilots, self._maps, position, attitude, blind)

    def _hold_position_loop(self) -> None:
        """Reset the memory of the position loop to the present motion."""
        autopilot = self._autopilot
        state, setpoint, loops = autopilot.state, autopilot.setpoint, autopilot.loops
        loops.velocity_integral = 0.0
        loops.previous_velocity = state.velocity
        setpoint.position = state.position
        setpoint.yaw = yaw_of(state.attitude)

    def _apply_position_demand(self, resolved: OffboardSetpoint, climb_max: float) -> None:
        setpoint, gains = self._autopilot.setpoint, self._autopilot.gains
        position, velocity = self._autopilot.state.position, self._autopilot.state.velocity
        known = np.isfinite(resolved.position)
        moving = np.isfinite(resolved.velocity)
        pushed = np.isfinite(resolved.acceleration)
        setpoint.position = np.where(known, resolved.position, position)
        free = ~known & ~moving
        setpoint.velocity = np.where(moving, resolved.velocity, np.where(free, velocity, 0.0))
        setpoint.acceleration = np.where(pushed, resolved.acceleration, 0.0)
        if math.isfinite(resolved.yaw):
            setpoint.yaw = resolved.yaw
        get = self._parameters.get
        above = setpoint.position[2] - position[2]
        climb = float(setpoint.velocity[2] + gains.position_p * above)
        up = min(get("MPC_Z_VEL_MAX_UP"), climb_max)
        gains.velocity_max_z = max(up if climb > 0.0 else get("MPC_Z_VEL_MAX_DN"), 0.0)


_CLOSE, _STILL = 0.15, 0.3
"""[m], [m/s]: so close to its place and so slow it is there."""
_BRAKING_S = np.array([0.7, 0.7, 0.3])
"""A vehicle that brakes now comes to rest after about its speed times this."""


class Navigator:
    """Gives the set point of the mode that is flown."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._mode: Mode | None = None
        self._place: Array = np.zeros(3)
        self._yaw = 0.0
        self._goal: tuple[Array, float] | None = None
        self.takeoff_height = math.nan
        """Height above home that the next take-off goes to [m]; NaN: MIS_TAKEOFF_ALT."""
        self.finished = self.landing = False
        """The take-off has reached its height; it descends to the ground."""

    def leave(self) -> None:
        """Forget the place: another mode controls the vehicle."""
        self._mode = None
        self.finished = False

    def go_to(self, goal: Array, yaw: float) -> None:
        """Fly to a place in the next call of `follow`, which holds; yaw NaN: as it is."""
        self._goal, self._mode = (goal, yaw), None

    def follow(
        self, mode: Mode, position: Array, velocity: Array, yaw: float, home: Array
    ) -> OffboardSetpoint:
        """Return the set point in `mode`; the first call in a mode chooses its place."""
        if mode != self._mode:
            self._mode, self._yaw = mode, yaw
            self.finished, self.landing = False, mode == AUTO_LAND
            self._place = self._choose(mode, position, velocity, home)
            self._goal = None
        there = np.linalg.norm(position - self._place) < _CLOSE
        if there and np.linalg.norm(velocity) < _STILL:
            self.finished = mode == AUTO_TAKEOFF
            self.landing = self.landing or mode == AUTO_RTL
        if not self.landing:
            return OffboardSetpoint(self._place, np.zeros(3), yaw=self._yaw)
        x, y, _ = self._place
        down = -self._parameters.get("MPC_LAND_SPEED")
        sinking = (np.array([x, y, math.nan]), np.array([0.0, 0.0, down]))
        return OffboardSetpoint(*sinking, yaw=self._yaw)

    def _choose(self, mode: Mode, position: Array, velocity: Array, home: Array) -> Array:
        """Return the place (3) in map that a mode goes to, or stays at."""
        if mode == AUTO_TAKEOFF:
            height = self.takeoff_height
            if not math.isfinite(height):
                height = self._parameters.get("MIS_TAKEOFF_ALT")
            self.takeoff_height = math.nan
            return np.array([*position[:2], max(height + home[2], position[2])])
        if mode == AUTO_RTL:
            return np.array([*home[:2], position[2]])
        if self._goal is not None and mode != AUTO_LAND:
            goal, yaw = self._goal
            self._yaw = yaw if math.isfinite(yaw) else self._yaw
            return goal
        return np.array(position + _BRAKING_S * velocity)
