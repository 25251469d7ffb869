"""Sizes of effects for a vehicle that is not the default one."""

from __future__ import annotations

from collections.abc import Mapping

from tombo_dynamics.effects.registry import REGISTRY
from tombo_dynamics.vehicle import VehicleParams


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
