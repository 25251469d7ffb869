"""The paper's experiment in the bare kernel: physics and cascade, truth in place of estimates."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from tombo_collision.reactions.bounce import Bounce
from tombo_control.autopilot import Autopilot, new_autopilot
from tombo_control.loops.cascade import cascade
from tombo_control.planning.leg import Leg, hold_leg, leg_position, store_leg, straight_leg
from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import SimulatedPlant, new_plant, pack_theta
from tombo_dynamics.jit import compiled
from tombo_dynamics.messages import Phase
from tombo_dynamics.plant import Plant
from tombo_dynamics.propeller.mounted_propeller import mounted_rotors
from tombo_dynamics.rigid_body import begin_flight, begin_tick, finish_tick
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import TICK_S
from tombo_flight.scenario import Scenario
from tombo_sim.propeller_effects import vehicle_effects

Stretch = tuple[Leg, int, int, int]
"""A leg, its mode, the first tick and the tick after the last."""

_REACTION_S = 0.04
"""How long after the contact the set point moves: the detector's usual latency."""
_LENGTH_S = 36.0
"""As long as the paper's flight takes until the landing begins."""


@compiled
def fly_with_true_state(
    plant: Plant,
    autopilot: Autopilot,
    maps: RotorMaps,
    theta: Array,
    noise: Array,
    start: int,
    stop: int,
) -> None:
    """Fly the plant and the cascade alone, the true state in place of the estimate; no log.

    The bare loop of benchmarks and tests.
    """
    state, setpoint = autopilot.state, autopilot.setpoint
    for k in range(start, stop):
        begin_tick(plant, maps, noise, theta)
        state.position = plant.state.position
        state.velocity = plant.state.velocity
        state.rates = plant.state.rates
        state.attitude = plant.state.attitude
        autopilot.mocap_time = k * TICK_S
        cascade(autopilot, maps, k)
        plant.rotor_command = setpoint.rotor_speed
        finish_tick(plant, noise, theta)


@compiled(inline=False)
def fly_vehicles(
    plants: Any,
    autopilots: Any,
    maps: RotorMaps,
    theta: Array,
    noise: Array,
    first: int,
    last: int,
    start: int,
    stop: int,
) -> None:
    """Fly vehicles `first` to `last` - 1 of arrays from tick `start` to tick `stop`."""
    for i in range(first, last):
        fly_with_true_state(plants[i], autopilots[i], maps, theta, noise, start, stop)


@dataclass
class KernelFlight:
    """One vehicle on its way: the memories of plant and autopilot, and their parameters."""

    scenario: Scenario
    plant: SimulatedPlant
    autopilot: Autopilot
    maps: RotorMaps
    theta: Array
    zero_noise: Array
    """The standard normal numbers of every tick: none, since the bare kernel takes one row."""

    def stretch(self, leg: Leg, mode: int, start: int, stop: int) -> None:
        """Fly a leg from tick `start` to tick `stop`."""
        store_leg(self.autopilot.leg, leg)
        self.autopilot.mode_asked = mode
        fly_with_true_state(
            self.plant, self.autopilot, self.maps, self.theta, self.zero_noise, start, stop
        )


def new_flight(scenario: Scenario, seed: int) -> KernelFlight:
    """Return a vehicle on the ground; the seed draws its thrust scatter and where it stands."""
    vehicle = scenario.vehicle
    theta = pack_theta(vehicle_effects(scenario.propeller, vehicle, scenario.effects))
    draws = np.random.default_rng(seed).standard_normal(12)
    plant = new_plant(vehicle)
    start = [scenario.spread.start * draws[8], scenario.spread.start * draws[9]]
    plant.state.position = [*start, vehicle.leg_height]
    plant.draws = draws[:8]
    pole = scenario.obstacle
    plant.obstacle = (pole.x, pole.y, pole.radius, pole.top)
    zero_noise = np.zeros(9)
    begin_flight(plant, zero_noise, theta, TICK_S)
    autopilot = new_autopilot(
        scenario.control, scenario.estimator, vehicle, plant.state.position, plant.state.attitude
    )
    maps = mounted_rotors(scenario.propeller, vehicle)
    return KernelFlight(scenario, plant, autopilot, maps, theta, zero_noise)


def stretches(flight: KernelFlight, contact_s: float) -> list[Stretch]:
    """Return the legs of the mission with mode and ticks, from take-off to the hold at x_r.

    Args:
        flight: a vehicle on the ground.
        contact_s: when it will meet the obstacle, see `contact_time`.
    """
    mission, reaction = flight.scenario.mission, Bounce()
    x, y, z = (float(v) for v in flight.plant.state.position)
    top = (x, y, mission.height)
    goal = (mission.goal_x, mission.goal_y, mission.height)
    up = straight_leg((x, y, z), top, mission.climb_speed, mission.takeoff_time)
    ahead = straight_leg(top, goal, mission.approach_speed, mission.approach_time)
    switch = min(contact_s + _REACTION_S, _LENGTH_S)
    x_c, y_c, z_c = leg_position(ahead, min(contact_s, _LENGTH_S))
    back = hold_leg((x_c - reaction.distance, y_c, z_c), switch)
    times = [0.0, up.end_s, mission.approach_time, switch, _LENGTH_S]
    ticks = [round(time / TICK_S) for time in times]
    legs = [
        (up, Phase.TAKEOFF),
        (hold_leg(top, up.end_s), Phase.HOVER),
        (ahead, Phase.APPROACH),
        (back, Phase.REACT),
    ]
    return [
        (leg, mode, ticks[i], ticks[i + 1])
        for i, (leg, mode) in enumerate(legs)
        if ticks[i + 1] > ticks[i]
    ]


def contact_time(scenario: Scenario, seed: int) -> float:
    """Return when the vehicle first touches the obstacle [s]; inf if it never does."""
    flight = new_flight(scenario, seed)
    for leg, mode, start, stop in stretches(flight, math.inf):
        step = 1 if mode == Phase.APPROACH else stop - start
        for k in range(start, stop, step):
            flight.stretch(leg, mode, k, k + step)
            if mode == Phase.APPROACH and flight.plant.contact.touching:
                return k * TICK_S
    return math.inf


def fly_whole(flight: KernelFlight, legs: list[Stretch]) -> int:
    """Fly all stretches; return the number of ticks."""
    for leg, mode, start, stop in legs:
        flight.stretch(leg, mode, start, stop)
    return legs[-1][3] - legs[0][2]
