"""Flights of the control tests: the nominal vehicle with Conf. 13, plant and cascade."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from tombo_benchmarks.speed.kernel_flight import fly_with_true_state
from tombo_control.autopilot import Autopilot, new_autopilot
from tombo_control.params import ControlParams, EstimatorParams
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import SimulatedPlant, new_plant, null_theta, pack_theta
from tombo_dynamics.messages import Phase
from tombo_dynamics.propeller import configuration, thrust_map
from tombo_dynamics.records import numbers
from tombo_dynamics.rigid_body import begin_flight, begin_tick, finish_tick
from tombo_dynamics.rotor_maps import RotorMaps, rotor_maps, speed_for_thrust
from tombo_dynamics.vehicle import VehicleParams

VEHICLE = VehicleParams()
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
STILL = np.zeros(9)
"""A tick's noise: none."""
FOREVER = 1e9


@lru_cache
def rotor_table() -> RotorMaps:
    return rotor_maps(thrust_map(configuration(13), law="repaired"), VEHICLE)


def fresh_autopilot(
    control: ControlParams | None = None,
    position: Any = (0.0, 0.0, 10.0),
    attitude: Any = UPRIGHT,
    estimator: EstimatorParams | None = None,
) -> Autopilot:
    """An autopilot that hovers where it is, with fresh mocap for ever."""
    a = new_autopilot(
        control or ControlParams(),
        estimator or EstimatorParams(),
        VEHICLE,
        np.array(position, dtype=float),
        np.array(attitude, dtype=float),
    )
    a.mode_asked = a.mode_flown = Phase.HOVER
    a.mocap_time = FOREVER
    a.setpoint.thrust = 4.0 * VEHICLE.hover_thrust()
    a.leg.end_s = FOREVER
    return a


@dataclass
class Bench:
    """A vehicle that starts in a perfect hover at 10 m, its cascade flying on the truth."""

    plant: SimulatedPlant
    a: Autopilot
    theta: Array
    tick: int = 0

    def fly(self, seconds: float, every: int = 5) -> Array:
        """Fly on; return position, velocity, attitude, rates (13) every few ticks."""
        rows = []
        end = self.tick + round(seconds * 1000)
        while self.tick < end:
            stop = min(self.tick + every, end)
            maps = rotor_table()
            fly_with_true_state(self.plant, self.a, maps, self.theta, STILL, self.tick, stop)
            self.tick = stop
            rows.append(numbers(self.plant.state))
        return np.array(rows)

    def fly_ticks(self, seconds: float, control: Callable[[Autopilot, int], None]) -> Array:
        """Fly with any controller `control(a, tick)` in place of the cascade."""
        rows = []
        for tick in range(self.tick, self.tick + round(seconds * 1000)):
            begin_tick(self.plant, rotor_table(), STILL, self.theta)
            body = numbers(self.plant.state)
            state = self.a.state
            state.position, state.velocity = body[0:3], body[3:6]
            state.attitude, state.rates = body[6:10], body[10:13]
            control(self.a, tick)
            self.plant.rotor_command = self.a.setpoint.rotor_speed
            finish_tick(self.plant, STILL, self.theta)
            self.tick = tick + 1
            rows.append(body)
        return np.array(rows)


def bench(control: ControlParams | None = None, **effects: dict[str, float]) -> Bench:
    plant = new_plant(VEHICLE)
    plant.state.position[2] = 10.0
    hover = speed_for_thrust(rotor_table(), VEHICLE.hover_thrust())
    plant.rotor_speed = plant.rotor_command = hover
    theta = pack_theta(effects) if effects else null_theta()
    begin_flight(plant, STILL, theta, 1e-3)
    return Bench(plant, fresh_autopilot(control), theta)


def quaternion(axis: Any, angle: float) -> Array:
    """xyzw, about an axis by an angle [rad]."""
    u = np.asarray(axis, dtype=float)
    u = u / np.linalg.norm(u)
    return np.append(math.sin(0.5 * angle) * u, math.cos(0.5 * angle))


def body_z(q: Array) -> Array:
    """Third column of the rotation matrix: body z in map."""
    x, y, z, w = q
    return np.array([2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)])
