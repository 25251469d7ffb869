"""The registry of effects on a flight, for simulation and fit.

An effect takes `(plant, noise, *theta)`: the vehicle (`tombo_dynamics.plant.Plant`), standard
normal numbers of the tick (or of the mocap sample), and its parameters; it is compiled. One with
memory declares `state=`, a `Record`, and takes its own between noise and parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum

from tombo_dynamics.effect_registry import Effect, Param, Registry
from tombo_dynamics.jit import compiled
from tombo_dynamics.vehicle import VehicleParams


class Stage(Enum):
    """Time in a tick at which an effect acts, and the parts of the plant that it may change."""

    BODY = "body"
    """Once, before the flight: mass, inertia, centre of gravity, motor time constant, draws."""
    AIR = "air"
    """Each tick: adds to `wind`."""
    ROTOR = "rotor"
    """Each tick: multiplies `efficiency`, moves `fold` and `damage`, adds strike forces."""
    COMMAND = "command"
    """Each tick: changes `rotor_target`, the speeds that the drives work towards."""
    WRENCH = "wrench"
    """Each evaluation of the dynamics: adds to `force` and `moment`."""
    IMU = "imu"
    """Each tick: changes `gyro` and `accel`."""
    MOCAP = "mocap"
    """Each motion-capture sample: changes `mocap`."""


REGISTRY = Registry("effect", leading=2, prepare=compiled)
effect = REGISTRY.effect
check_theta = REGISTRY.check_theta


def size_factors(mass: float, arm_length: float) -> dict[str, float]:
    """Return unit → factor from the default vehicle's size of an effect to another vehicle's.

    Masses and forces grow with the mass [kg], lengths with the arm, centre to rotor axis [m].
    """
    like = VehicleParams()
    heavy, long = mass / like.mass, arm_length / like.arm_length
    return {
        "kg": heavy,
        "kg m": heavy * long,
        "N/m": heavy,
        "N s/m": heavy,
        "m^2": heavy,
        "N m s/m": heavy * long,
        "m": min(long, 1.0),
    }


def effects_for(
    effects: Mapping[str, Mapping[str, float]], vehicle: VehicleParams
) -> dict[str, dict[str, float]]:
    """Return effects that were given for the default vehicle in the size of another one.

    Forces, that is; an offset of sensors or of the room stays.
    """
    factors = size_factors(vehicle.mass, vehicle.arm_length)
    del factors["m"]
    units = {e.name: {p.name: p.unit for p in e.theta} for e in REGISTRY.values()}
    return {
        name: {
            key: value * factors.get(units.get(name, {}).get(key, ""), 1.0)
            for key, value in theta.items()
        }
        for name, theta in effects.items()
    }


__all__ = [
    "REGISTRY",
    "Effect",
    "Param",
    "Stage",
    "check_theta",
    "effect",
    "effects_for",
    "size_factors",
]
