"""The vehicle on the ground, ready to fly: everything that seed and world decide beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.compose import SimulatedPlant, new_plant, pack_theta
from tombo_dynamics.errors import InputError
from tombo_dynamics.params import check_seed
from tombo_dynamics.propeller.mounted_propeller import mounted_rotors, mounted_vehicle
from tombo_dynamics.rigid_body import begin_flight
from tombo_dynamics.rotor_maps import RotorMaps
from tombo_dynamics.time_base import TICK_S
from tombo_dynamics.vehicle import VehicleParams
from tombo_sim.propeller_effects import vehicle_effects
from tombo_sim.world import SpreadParams, World

NOISE = 9
"""Standard normals that a tick, and a mocap sample, takes."""


@dataclass(frozen=True)
class FlightSetup:
    """A vehicle at rest at the start, and its random generators."""

    plant: SimulatedPlant
    maps: RotorMaps
    effects: dict[str, dict[str, float]]
    """All effects, those of the propeller included."""
    theta: Array
    """Their parameters, packed."""
    start: Array
    """(3) position in map [m]."""
    obstacle: tuple[float, float, float, float]
    """x, y, radius, top [m], as drawn."""
    mocap_rate: float
    """[Hz], as drawn."""
    tick_noise: np.random.Generator
    mocap_noise: np.random.Generator


def begin(world: World, seed: int) -> FlightSetup:
    """Set up a flight.

    Args:
        world: vehicle, propeller, obstacle, effects.
        seed: all randomness derives from it.

    Raises:
        InputError: the seed is not a whole number from 0; the propeller cannot lift the vehicle or
        does not fit it; or the vehicle would start inside the obstacle.
    """
    seed = check_seed("seed", seed)
    vehicle = mounted_vehicle(world.vehicle, world.propeller)
    maps = mounted_rotors(world.propeller, vehicle)
    draw_seed, tick_seed, mocap_seed, spread_seed = np.random.SeedSequence(seed).spawn(4)
    nominal = vehicle_effects(world.propeller, vehicle, world.effects)
    uniform = np.random.default_rng(spread_seed).uniform(-1.0, 1.0, 4).tolist()
    effects = _spread_effects(nominal, world.spread, vehicle, uniform)
    theta = pack_theta(effects)
    draws = np.random.default_rng(draw_seed).standard_normal(16)
    plant = new_plant(vehicle)
    spread = world.spread
    yaw = spread.yaw * draws[8]
    start = np.array([spread.start * draws[9], spread.start * draws[10], vehicle.leg_height])
    if any(world.start):
        start[:2] += world.start
    plant.state.position = start
    plant.state.attitude = [0.0, 0.0, math.sin(0.5 * yaw), math.cos(0.5 * yaw)]
    plant.draws = draws[:8]
    pole = world.obstacle
    obstacle = (
        float(pole.x + spread.obstacle * draws[11]),
        float(pole.y + spread.obstacle * draws[12]),
        float(pole.radius),
        float(pole.top),
    )
    plant.obstacle = obstacle
    _check_free(vehicle, plant)
    begin_flight(plant, np.zeros(NOISE), theta, TICK_S)
    return FlightSetup(
        plant,
        maps,
        effects,
        theta,
        start,
        obstacle,
        (uniform[3] > 0.0 and spread.mocap_rate) or world.mocap_rate,
        tick_noise=np.random.default_rng(tick_seed),
        mocap_noise=np.random.default_rng(mocap_seed),
    )


def capture_ticks(duration: float, rate: float) -> NDArray[np.int64]:
    """Return the ticks (M) at which poses are captured, at a rate [1/s] for so long [s]."""
    return np.round(np.arange(0.0, duration, 1.0 / rate) / TICK_S).astype(np.int64)


def _spread_effects(
    effects: Mapping[str, Mapping[str, float]],
    spread: SpreadParams,
    vehicle: VehicleParams,
    draws: Sequence[float],
) -> dict[str, dict[str, float]]:
    """Return effects with what differs from flight to flight; `draws` (4) within -1 and 1."""
    drawn = {name: dict(values) for name, values in effects.items()}
    if spread.recovery_time:
        drawn["blade_strike"]["recovery_time"] *= 1.0 + spread.recovery_time * draws[0]
    if spread.motor_lag:
        lag = drawn.setdefault("motor_lag", {})
        change = vehicle.motor_time_constant * spread.motor_lag * draws[1]
        lag["extra_tau"] = lag.get("extra_tau", 0.0) + change
    if spread.wind:
        wind = drawn.setdefault("steady_wind", {})
        wind["east"] = wind.get("east", 0.0) + spread.wind * math.cos(math.pi * draws[2])
        wind["north"] = wind.get("north", 0.0) + spread.wind * math.sin(math.pi * draws[2])
    return drawn


def _check_free(vehicle: VehicleParams, plant: SimulatedPlant) -> None:
    """Refuse a flight that would begin in the obstacle."""
    x, y, radius, _ = plant.obstacle.item()
    free = radius + vehicle.arm_length + vehicle.rotor_radius
    distance = math.hypot(x - plant.state.position[0], y - plant.state.position[1])
    if radius > 0.0 and distance < free:
        raise InputError(
            f"obstacle: the axis of the obstacle is {distance:.2f} m from the start, its radius "
            f"{radius:g} m; accepted: at least {free:.2f} m, so that the vehicle does not start "
            "inside"
        )
