"""From a set point of OFFBOARD to rotor speeds, as PX4 does.

Which combinations are accepted, the reference of each axis, then the cascade of 50, 250 and
1000 Hz, within PX4's limits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum

import numpy as np

from tombo_control.autopilot import Autopilot
from tombo_control.loops.cascade import stop_rotors
from tombo_control.params import ATTITUDE_TICKS, POSITION_TICKS
from tombo_control.tick_calls import run_control_loops
from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_of
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import GRAVITY
from tombo_px4.autopilot.parameters import ParameterTable

_NONE = np.full(3, math.nan)
_LEVEL = np.array([0.0, 0.0, 0.0, 1.0])
_LARGEST = 1e5
"""[m, m/s, m/s^2]: a larger value is refused as an error of the sender."""
_FASTEST = 100.0
"""[rad/s], the same."""


class ControlLevel(IntEnum):
    """The outermost loop that a set point drives, innermost last."""

    POSITION = 0
    VELOCITY = 1
    ACCELERATION = 2
    ATTITUDE = 3
    RATES = 4


@dataclass(frozen=True)
class OffboardSetpoint:
    """A set point of OFFBOARD: None or NaN means not commanded.

    Either motion (position, velocity, acceleration, yaw, yaw rate) or attitude (attitude, rates,
    thrust); with both, attitude is left out.
    """

    position: Array | None = None
    """(3) map [m]."""
    velocity: Array | None = None
    """(3) map [m/s]."""
    acceleration: Array | None = None
    """(3) map, without gravity [m/s^2]."""
    yaw: float = math.nan
    """Counter-clockwise from east [rad]."""
    attitude: Array | None = None
    """(4) xyzw, map from base_link."""
    rates: Array | None = None
    """(3) base_link [rad/s]."""
    thrust: float | None = None
    """Share of the highest collective thrust, 0 to 1."""


@dataclass(frozen=True)
class ResolvedSetpoint:
    """A set point after all checks: the reference of the cascade, each axis in map."""

    kind: ControlLevel
    position: Array = field(default_factory=lambda: _NONE)
    """(3) [m], NaN: not commanded."""
    velocity: Array = field(default_factory=lambda: _NONE)
    """(3) [m/s]."""
    acceleration: Array = field(default_factory=lambda: _NONE)
    """(3) [m/s^2]."""
    yaw: float = math.nan
    """Counter-clockwise from east [rad]."""
    attitude: Array = field(default_factory=lambda: _LEVEL)
    """(4) xyzw, map from base_link, for ATTITUDE."""
    rates: Array = field(default_factory=lambda: np.zeros(3))
    """(3) base_link [rad/s], for RATES."""
    thrust: float = math.nan
    """Share of the highest collective thrust."""


def resolve_setpoint(target: OffboardSetpoint) -> ResolvedSetpoint | str:
    """Return a set point after all checks, or why it is refused."""
    motion = _axes(target.position), _axes(target.velocity), _axes(target.acceleration)
    if _most(np.array(motion)) > _LARGEST:
        return "set point is out of range"
    if np.isfinite(motion).any():
        return _resolve_motion(target, *motion)
    return _resolve_attitude(target)


def _axes(values: Array | None) -> Array:
    """Return three axes, infinities as not commanded."""
    if values is None:
        return _NONE
    return np.where(np.isfinite(values), values, math.nan)


def _most(axes: Array) -> float:
    """Return the largest absolute value of the commanded axes; 0 if there are none."""
    return float(np.nan_to_num(np.abs(axes)).max())


def finite_or_nan(value: float | None) -> float:
    """Return a number; NaN for None and infinity."""
    return float(value) if value is not None and math.isfinite(value) else math.nan


def _resolve_motion(
    target: OffboardSetpoint, position: Array, velocity: Array, acceleration: Array
) -> ResolvedSetpoint | str:
    commanded = [np.isfinite(axes) for axes in (position, velocity, acceleration)]
    if not (commanded[0] | commanded[1] | commanded[2]).all():
        return "invalid set point: an axis is not commanded"
    if any(axes[0] != axes[1] for axes in commanded):
        return "invalid set point: x and y differ in what is commanded"
    kind = ControlLevel.ACCELERATION
    if commanded[0].any():
        kind = ControlLevel.POSITION
    elif commanded[1].any():
        kind = ControlLevel.VELOCITY
    yaw = finite_or_nan(target.yaw)
    if abs(yaw) > _LARGEST:
        return "set point is out of range"
    return ResolvedSetpoint(kind, position, velocity, acceleration, yaw)


def _resolve_attitude(target: OffboardSetpoint) -> ResolvedSetpoint | str:
    thrust = finite_or_nan(target.thrust)
    rates = _axes(target.rates)
    if _most(rates) > _FASTEST:
        return "set point is out of range"
    kind, attitude = ControlLevel.RATES, _LEVEL
    if target.attitude is None:
        if not np.isfinite(rates).any():
            return "set point commands nothing"
    else:
        kind, attitude = ControlLevel.ATTITUDE, np.array(target.attitude, dtype=float)
        if not np.isfinite(attitude).all():
            return "invalid set point: attitude is not finite"
        length = float(np.linalg.norm(attitude))
        if not 0.5 < length < 2.0:
            return "invalid set point: attitude is no unit quaternion"
        attitude = attitude / length
    if not math.isfinite(thrust):
        return "invalid set point: no thrust"
    rates, thrust = np.nan_to_num(rates), min(max(thrust, 0.0), 1.0)
    return ResolvedSetpoint(kind, attitude=attitude, rates=rates, thrust=thrust)


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
        else:
            setpoint.rates = resolved.rates
        setpoint.thrust = resolved.thrust * self.thrust_max
        self._hold_position_loop()
        self.loops = (False, by_attitude, True)

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
            run_control_loops(self._autopilots, self._maps, position, attitude, blind)

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
        setpoint.yaw = yaw_of(state.attitude)

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
        if math.isfinite(resolved.yaw):
            setpoint.yaw = resolved.yaw
        get = self._parameters.get
        above = setpoint.position[2] - position[2]
        climb = float(setpoint.velocity[2] + gains.position_p * above)
        up = min(get("MPC_Z_VEL_MAX_UP"), climb_max)
        gains.velocity_max_z = max(up if climb > 0.0 else get("MPC_Z_VEL_MAX_DN"), 0.0)
