"""Set points of the AUTO modes: take-off, hold, return and land."""

from __future__ import annotations

import math

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_px4.autopilot.parameters import ParameterTable
from tombo_px4.autopilot.setpoint_controller import OffboardSetpoint
from tombo_px4.modes import AUTO_LAND, AUTO_RTL, AUTO_TAKEOFF, Mode

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
