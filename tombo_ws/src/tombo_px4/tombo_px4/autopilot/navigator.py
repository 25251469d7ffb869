"""References of the AUTO modes: take-off, hold, return and land, as legs."""

from __future__ import annotations

import math

import numpy as np

from tombo_control.planning.leg import hold_leg, straight_leg
from tombo_control.planning.trapezoidal_profile import trapezoidal_profile
from tombo_dynamics.arrays import Array
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.setpoint_controller import ControlLevel, ResolvedSetpoint
from tombo_px4.modes import AUTO_LAND, AUTO_RTL, AUTO_TAKEOFF, Mode

_BELOW = 3.0
"""[m] the goal of a landing is below the vehicle's own ground, so that it is reached for sure."""
_STILL = 0.3
Point = tuple[float, float, float]


class Navigator:
    """Gives the reference of the mode that is flown."""

    def __init__(self, parameters: ParameterTable) -> None:
        self._parameters = parameters
        self._mode: Mode | None = None
        self._leg = hold_leg((0.0, 0.0, 0.0), 0.0)
        self._yaw = 0.0
        self._stage = 0
        self._goal: Point | None = None
        self._goal_yaw = math.nan
        self.takeoff_height = math.nan
        """Height above home that the next take-off goes to [m]; NaN: MIS_TAKEOFF_ALT."""
        self.takeoff_yaw = math.nan
        self.finished = False
        """The take-off has reached its height, or the return is complete."""

    def leave(self) -> None:
        """Forget the legs: another mode controls the vehicle."""
        self._mode = None
        self.finished = False

    def go_to(self, goal: Array, yaw: float) -> None:
        """Fly to a place in the next call of `follow`, which holds."""
        self._goal = _point(goal)
        self._goal_yaw = yaw
        self._mode = None

    def begin_again(self, now_s: float, position: Array) -> None:
        """Delay the start of a take-off: the rotors are not ready yet."""
        top = self._leg.position(self._leg.end_s)
        here = _point(position)
        self._leg = straight_leg(here, top, self._parameters.get("MPC_TKO_SPEED"), now_s)

    def follow(
        self, mode: Mode, now_s: float, position: Array, velocity: Array, yaw: float, home: Array
    ) -> ResolvedSetpoint:
        """Return the reference in `mode`; the first call in a mode begins its legs."""
        here: Point = _point(position)
        if mode != self._mode:
            self._mode = mode
            self._stage = 0
            self.finished = False
            self._yaw = yaw
            self._begin(mode, now_s, here, velocity, home)
            self._goal = None
        self._go_on(mode, now_s, here, velocity, home)
        leg = self._leg
        whole_s = leg.end_s - leg.begin_s
        way, speed, change = trapezoidal_profile(now_s - leg.begin_s, whole_s, leg.ramp_s)
        start, cruise = np.array(leg.start), np.array(leg.velocity)
        return ResolvedSetpoint(
            ControlLevel.POSITION, start + way * cruise, speed * cruise, change * cruise, self._yaw
        )

    def _begin(self, mode: Mode, now_s: float, here: Point, velocity: Array, home: Array) -> None:
        get = self._parameters.get
        if mode == AUTO_TAKEOFF:
            height = self.takeoff_height
            if not math.isfinite(height):
                height = get("MIS_TAKEOFF_ALT")
            height += float(home[2])
            if math.isfinite(self.takeoff_yaw):
                self._yaw = self.takeoff_yaw
            self.takeoff_height = self.takeoff_yaw = math.nan
            top = (here[0], here[1], max(height, here[2]))
            self._leg = straight_leg(here, top, get("MPC_TKO_SPEED"), now_s)
        elif mode == AUTO_LAND:
            self._sink(now_s, _stopping(here, velocity))
        elif mode == AUTO_RTL:
            self._climb_home(now_s, here, velocity, home)
        elif self._goal is not None:
            self._leg = straight_leg(here, self._goal, get("MPC_XY_CRUISE"), now_s)
            if math.isfinite(self._goal_yaw):
                self._yaw = self._goal_yaw
        else:
            self._leg = hold_leg(_stopping(here, velocity), now_s)

    def _climb_home(self, now_s: float, here: Point, velocity: Array, home: Array) -> None:
        get = self._parameters.get
        x, y, _ = _stopping(here, velocity)
        far = math.hypot(here[0] - float(home[0]), here[1] - float(home[1]))
        height = here[2]
        if far > get("NAV_ACC_RAD"):
            height = max(height, float(home[2]) + get("RTL_RETURN_ALT"))
        self._leg = straight_leg((x, y, here[2]), (x, y, height), get("MPC_Z_V_AUTO_UP"), now_s)

    def _sink(self, now_s: float, here: Point) -> None:
        goal = (here[0], here[1], here[2] - 200.0 - _BELOW)
        self._leg = straight_leg(here, goal, self._parameters.get("MPC_LAND_SPEED"), now_s)

    def _go_on(self, mode: Mode, now_s: float, here: Point, velocity: Array, home: Array) -> None:
        if mode == AUTO_TAKEOFF:
            close = math.dist(here, self._leg.position(self._leg.end_s)) < 0.15
            if self._over(now_s) and close and math.hypot(*velocity) < _STILL:
                self.finished = True
        elif mode == AUTO_RTL:
            self._return(now_s, here, velocity, home)

    def _over(self, now_s: float) -> bool:
        """Return whether the leg is complete; a leg of length 0 is complete at once."""
        return now_s >= self._leg.end_s or self._leg.velocity == (0.0, 0.0, 0.0)

    def _return(self, now_s: float, here: Point, velocity: Array, home: Array) -> None:
        """Climb, go above home, land."""
        get = self._parameters.get
        goal = self._leg.position(self._leg.end_s)
        reached = self._over(now_s) and math.dist(here, goal) < get("NAV_ACC_RAD")
        if self._stage == 0 and reached:
            self._stage = 1
            above = (float(home[0]), float(home[1]), goal[2])
            self._leg = straight_leg(goal, above, get("MPC_XY_CRUISE"), now_s)
        elif self._stage == 1 and reached and math.hypot(*velocity) < _STILL:
            self._stage = 2
            self._sink(now_s, goal)

    @property
    def landing(self) -> bool:
        """Whether the vehicle descends to the ground."""
        return self._mode == AUTO_LAND or (self._mode == AUTO_RTL and self._stage == 2)


def _point(place: Array) -> Point:
    return float(place[0]), float(place[1]), float(place[2])


def _stopping(here: Point, velocity: Array) -> Point:
    """Return about where a vehicle that brakes now comes to rest."""
    lag = 0.7
    return (
        here[0] + lag * float(velocity[0]),
        here[1] + lag * float(velocity[1]),
        here[2] + 0.3 * float(velocity[2]),
    )
