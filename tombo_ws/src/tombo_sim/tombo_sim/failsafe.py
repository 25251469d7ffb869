"""Fail-safe of the simulated flight controller: without commands it lands where it is.

Stands for the fail-safe of PX4 on loss of offboard commands. It has an estimator of its own, as
PX4 has, fed with the same IMU and poses.
"""

from __future__ import annotations

import numpy as np

from tombo_control.autopilot import new_autopilot
from tombo_control.estimator import correct, predict, store_history, update_body_rates
from tombo_control.loops.cascade import cascade, stop_rotors
from tombo_control.params import ControlParams, EstimatorParams
from tombo_control.planning.leg import store_leg, straight_leg
from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import taking_rows
from tombo_dynamics.messages import Phase
from tombo_dynamics.rotation import yaw_of
from tombo_dynamics.time_base import TICK_HZ, TICK_S
from tombo_dynamics.vehicle import VehicleParams
from tombo_sim.simulator import Simulator

_DESCENT = 0.4
"""[m/s], estimated: as the mission lands."""
_GOAL_DEPTH = 0.6
"""[m] of the descent's goal below the ground, so that the ground is reached for sure."""
_AIRBORNE_HEIGHT = 0.02
"""[m] above the ground, estimated: the estimator takes the vehicle for standing below it."""
_LANDED_HEIGHT, _STILL_SPEED = 0.05, 0.2
"""[m] above the ground and [m/s] on each axis, estimated: lower and slower, it has landed."""
_LANDED_TICKS = TICK_HZ
"""Time this low after which it has landed: without mocap it can float on the ground's cushion."""

_store_history, _cascade = taking_rows(store_history, 2), taking_rows(cascade, 2)
_update_body_rates, _predict = taking_rows(update_body_rates, 1), taking_rows(predict, 1)


class Failsafe:
    """Estimates all the time; commands between `engage` and `release`."""

    def __init__(self, simulator: Simulator, vehicle: VehicleParams) -> None:
        """Begin with the true pose of a vehicle that stands on the ground.

        Its gains are the default ones, not those under test: PX4's fail-safe has its own, too.

        Args:
            simulator: has the vehicle and its sensors.
            vehicle: mass and geometry that its estimator and controller use.
        """
        state = simulator.plant.state
        self._autopilot = new_autopilot(
            ControlParams(), EstimatorParams(), vehicle, state.position, state.attitude
        )
        self._autopilots = self._autopilot.as_array()
        self._maps = simulator.setup.maps.as_array()
        self._ground = float(state.position[2])  # z of base_link on the ground, map [m]
        self._hover = 4.0 * vehicle.hover_thrust()  # of all rotors [N]
        self._low_ticks = 0  # ticks in a row below `_LANDED_HEIGHT`
        self.engaged = False

    def observe(self, simulator: Simulator) -> None:
        """Take the IMU sample and the poses of the present tick."""
        autopilot, tick = self._autopilot, simulator.tick
        state = autopilot.state
        height = simulator.height - self._ground
        airborne = height > _AIRBORNE_HEIGHT
        self._low_ticks = self._low_ticks + 1 if height < _LANDED_HEIGHT else 0
        states = self._autopilots["state"]
        _store_history(states, self._autopilots["history"], tick)
        for sample in simulator.arrived:
            captured = sample.captured * TICK_S
            period = captured - autopilot.mocap_time
            position, attitude = sample.pose[:3], sample.pose[3:]
            if correct(autopilot, position, attitude, sample.captured, tick, period, airborne):
                autopilot.mocap_time = max(float(autopilot.mocap_time), captured)
        _update_body_rates(states, simulator.gyro)
        if self.engaged:
            _cascade(self._autopilots, self._maps, tick)
            low = state.position[2] < self._ground + _LANDED_HEIGHT
            still = float(np.abs(state.velocity).max()) < _STILL_SPEED
            if (low and still) or self._low_ticks > _LANDED_TICKS:
                autopilot.mode_asked = Phase.LANDED
        _predict(states, simulator.accel, airborne)

    def engage(self, tick: int) -> None:
        """Begin to land from where the vehicle is."""
        autopilot = self._autopilot
        state, setpoint = autopilot.state, autopilot.setpoint
        x, y, z = (float(v) for v in state.position)
        goal, yaw = (x, y, self._ground - _GOAL_DEPTH), yaw_of(state.attitude)
        leg = straight_leg((x, y, z), goal, _DESCENT, tick * TICK_S, yaw)
        store_leg(autopilot.leg, leg)
        stop_rotors(state, setpoint, autopilot.loops)
        setpoint.yaw = leg.yaw
        setpoint.attitude = state.attitude
        setpoint.thrust = self._hover
        autopilot.mode_asked = Phase.LAND
        self.engaged = True

    def release(self) -> None:
        """Leave the vehicle to whoever commands it."""
        self.engaged = False

    @property
    def command(self) -> Array:
        """Rotor speeds (4) [rad/s] asked for in the last tick; zeros on the ground."""
        speed: Array = self._autopilot.setpoint.rotor_speed.copy()
        return speed
