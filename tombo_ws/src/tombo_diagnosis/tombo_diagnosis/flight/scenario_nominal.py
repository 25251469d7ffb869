"""The nominal model that `tombo diagnose` holds flights against, from a scenario."""

from __future__ import annotations

from pathlib import Path

from tombo_diagnosis.flight.nominal import NominalModel
from tombo_dynamics.propeller.mounted_propeller import thrust_map_of
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_flight.scenario import Scenario, load_scenario, world_of
from tombo_sim.propeller_effects import propulsion_effects

_SCENARIO = "no_obstacle"


def nominal_model(model: Path | None = None) -> NominalModel:
    """Return the suite's own vehicle without an obstacle, extended by a model file if given.

    Raises:
        InputError: the model file can't be used.
    """
    scenario = load_scenario(_SCENARIO, model=None if model is None else str(model))
    return nominal_of(scenario, _SCENARIO if model is None else f"{_SCENARIO} with {model.name}")


def nominal_of(scenario: Scenario, label: str) -> NominalModel:
    """Return the nominal model of a scenario: its vehicle, propeller and effects."""
    world = world_of(scenario)
    return NominalModel(
        label,
        world.vehicle,
        rotor_maps(thrust_map_of(world.propeller), world.vehicle),
        propulsion_effects(world.propeller, world.vehicle, world.effects),
    )
