"""What the simulated flight controller does when nobody commands it: it lands where it is.

Stands for the fail-safe of PX4 on loss of offboard commands. It has an estimator of its own, as
PX4 has, fed with the same IMU and poses.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from tombo_control.autopilot import LAND, LANDED, A, new_autopilot, part
from tombo_control.cascade import cascade, stop_rotors
from tombo_control.estimator import correct, predict, store_history, update_body_rates
from tombo_control.leg import straight_leg
from tombo_control.params import ControlParams, EstimatorParams
from tombo_dynamics.vehicle import VehicleParams
from tombo_sim.simulator import Simulator

Array = NDArray[np.float64]
_TICK = 1e-3
_DESCENT = 0.4
"""[m/s], estimated: as the mission lands."""
_BELOW = 0.6
"""[m] the descent's goal is below the ground, so that it is reached for sure."""
_LOW = 0.05
"""[m] above the ground: landed, if at rest."""
_LOW_TICKS = 1000
"""After so long this low it has landed: without mocap it can float on the ground's cushion."""


class Failsafe:
    """Estimates all the time; commands between `engage` and `release`."""

    def __init__(self, simulator: Simulator, vehicle: VehicleParams) -> None:
        state = simulator.plant.state
        self._a = new_autopilot(
            ControlParams(), EstimatorParams(), vehicle, state.position, state.attitude
        )
        self._maps = simulator.setup.maps
        self._ground = float(state.position[2])
        self._hover = 4.0 * vehicle.hover_thrust()
        self._low_ticks = 0
        self.engaged = False

    def observe(self, simulator: Simulator) -> None:
        """Take the IMU sample and the poses of the present tick."""
        a, tick = self._a, simulator.tick
        height = simulator.height - self._ground
        airborne = height > 0.02
        self._low_ticks = self._low_ticks + 1 if height < _LOW else 0
        store_history(a, tick)
        for sample in simulator.arrived:
            period = sample.captured * _TICK - a[A.mode + 2]
            if correct(a, sample.pose, 0, sample.captured, tick, period, airborne):
                a[A.mode + 2] = max(float(a[A.mode + 2]), sample.captured * _TICK)
        update_body_rates(a, simulator.plant.gyro, 0)
        if self.engaged:
            cascade(a, self._maps, tick)
            low = part(a, "position")[2] < self._ground + _LOW
            still = float(np.abs(part(a, "velocity")).max()) < 0.2
            if (low and still) or self._low_ticks > _LOW_TICKS:
                a[A.mode] = LANDED
        predict(a, simulator.plant.accel, 0, airborne)

    def engage(self, tick: int) -> None:
        """Begin to land from where the vehicle is."""
        a = self._a
        x, y, z = (float(v) for v in part(a, "position"))
        leg = straight_leg((x, y, z), (x, y, self._ground - _BELOW), _DESCENT, tick * _TICK)
        part(a, "leg")[:] = leg.as_array()
        forward = part(a, "attitude")
        yaw = np.arctan2(
            2.0 * (forward[3] * forward[2] + forward[0] * forward[1]),
            1.0 - 2.0 * (forward[1] ** 2 + forward[2] ** 2),
        )
        a[A.leg + 9] = float(yaw)
        stop_rotors(a)
        part(a, "attitude_setpoint")[:] = forward
        a[A.thrust_setpoint] = self._hover
        a[A.mode] = LAND
        self.engaged = True

    def release(self) -> None:
        """Leave the vehicle to whoever commands it."""
        self.engaged = False

    @property
    def command(self) -> Array:
        """Rotor speeds (4) [rad/s] asked for in the last tick; zeros on the ground."""
        return part(self._a, "command").copy()
