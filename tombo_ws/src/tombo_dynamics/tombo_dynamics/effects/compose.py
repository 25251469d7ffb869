"""Chain all registered effects into one compiled function per stage, over one flat vector theta.

The plant of a simulation has a place for what effects with memory remember.

The chain is written out as source, so that its machine code is kept on disk. An effect whose
parameters are all null costs one comparison.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects import REGISTRY, Stage
from tombo_dynamics.jit import load_generated
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field, fill_record
from tombo_dynamics.vehicle import VehicleParams


def layout() -> dict[str, dict[str, int]]:
    """Return the index in theta of every parameter: effect -> parameter -> index."""
    index = 0
    table: dict[str, dict[str, int]] = {}
    for name, effect in REGISTRY.items():
        table[name] = {}
        for p in effect.theta:
            table[name][p.name] = index
            index += 1
    return table


def null_theta() -> Array:
    """Return theta with every parameter at its null value."""
    return np.array([p.null for effect in REGISTRY.values() for p in effect.theta])


def pack_theta(values: Mapping[str, Mapping[str, float]]) -> Array:
    """Return theta with the given parameters (checked before) and null values elsewhere."""
    theta = null_theta()
    table = layout()
    for name, parameters in values.items():
        for key, value in parameters.items():
            theta[table[name][key]] = value
    return theta


def _source() -> str:
    lines = ['"""Generated from the registry of effects. Do not edit."""', ""]
    for name, effect in REGISTRY.items():
        lines.append(f"from {effect.module} import {effect.function.__name__} as {name}_")
    lines.append("from tombo_dynamics.jit import compiled")
    table = layout()
    for stage in Stage:
        lines += ["", "", "@compiled", f"def apply_{stage.value}(plant, noise, theta):"]
        body = []
        for name, effect in REGISTRY.items():
            if effect.stage is stage:
                index = table[name]
                active = " or ".join(f"theta[{index[p.name]}] != {p.null!r}" for p in effect.theta)
                memory = [f"plant.memories.{name}"] if effect.state else []
                arguments = ", ".join(
                    [*memory, *(f"theta[{index[p.name]}]" for p in effect.theta)]
                )
                body.append(f"    if {active}:")
                body.append(f"        {name}_(plant, noise, {arguments})")
        lines += body or ["    pass"]
    return "\n".join(lines) + "\n"


EffectMemories: Any = type(
    "EffectMemories",
    (Record,),
    {
        name: field("", effect.doc, kind=effect.state)
        for name, effect in REGISTRY.items()
        if effect.state
    },
)
"""A record with the memories of the effects with `state=`, under their names."""


class SimulatedPlant(Plant):
    """A vehicle with the memories of all effects."""

    memories = field("", "of the effects", kind=EffectMemories)


def new_plant(vehicle: VehicleParams) -> SimulatedPlant:
    """Return a vehicle at the origin, upright, everything else zero."""
    plant = SimulatedPlant.new()
    plant.state.attitude[3] = 1.0
    fill_record(plant.vehicle, vehicle)
    return plant


composed = load_generated("tombo_composed_effects", _source())
apply_body = composed.apply_body
apply_air = composed.apply_air
apply_rotor = composed.apply_rotor
apply_command = composed.apply_command
apply_wrench = composed.apply_wrench
apply_imu = composed.apply_imu
apply_mocap = composed.apply_mocap
