"""From PX4's control of a motor, 0 to 1, to a rotor speed.

PX4 takes thrust for linear in control (THR_MDL_FAC 0) and starts from hovering at 0.5
(MPC_THR_HOVER). With `thrust` it is linear here too, from the idle thrust at 0 to the highest at
1, as in jMAVSim: the default propeller (13) hovers at 0.460. With `speed`, rotor speed is linear
from idle to the highest, as in Gazebo: hover is at 0.573. The rigid propeller is stronger: 0.314
and 0.510. A roll control of 1 gives 236 rad/s^2 with `thrust`, 277 with `speed`; PX4's iris has
about 200, so the gains of its airframe fit.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotor_maps import RotorMaps, speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams
from tombo_px4.frames import PX4_ROTORS

_ROUNDING = 1e-3
"""A control this much outside 0..1 is rounding."""


class MotorMapping:
    """Controls of PX4's motors 1 to 4 to speeds of our rotors."""

    def __init__(self, vehicle: VehicleParams, maps: RotorMaps, mapping: str) -> None:
        self._maps = maps
        self._by_thrust = mapping == "thrust"
        self._lowest = float(maps.thrust_lowest)
        self._range = float(maps.thrust_highest) - self._lowest
        self._idle = vehicle.rotor_speed_min
        top = float(speed_for_thrust(maps, float(maps.thrust_highest)))
        self._span = top - self._idle
        self._hover_thrust = vehicle.hover_thrust()
        self.refused = 0
        """Controls that were no number from 0 to 1; each is taken for 0."""

    @property
    def hover(self) -> float:
        """Control in hover: what MPC_THR_HOVER should be."""
        if self._by_thrust:
            return (self._hover_thrust - self._lowest) / self._range
        speed = float(speed_for_thrust(self._maps, self._hover_thrust))
        return (speed - self._idle) / self._span

    def speeds(self, controls: Sequence[float], armed: bool) -> Array:
        """Return rotor speeds (4) [rad/s] in our order; an unarmed rotor stands still."""
        out = np.zeros(4)
        for rotor, value in zip(PX4_ROTORS, controls, strict=False):
            if not -_ROUNDING <= value <= 1.0 + _ROUNDING:
                self.refused += 1
                value = 0.0
            if armed:
                out[rotor] = self._speed(min(max(value, 0.0), 1.0))
        return out

    def _speed(self, control: float) -> float:
        if not self._by_thrust:
            return self._idle + control * self._span
        return float(speed_for_thrust(self._maps, self._lowest + control * self._range))
