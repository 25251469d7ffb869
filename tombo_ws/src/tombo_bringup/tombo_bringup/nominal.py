"""The nominal model that `tombo diagnose` holds flights against, from a scenario."""

from __future__ import annotations

from tombo_bringup.scenario import Scenario, world_of
from tombo_dynamics.rotor_maps import rotor_maps
from tombo_sim.propulsion import propulsion_effects, thrust_map_of
from tombo_sysid.nominal import Nominal


def nominal_of(scenario: Scenario, label: str) -> Nominal:
    """Return the nominal model of a scenario: its vehicle, propeller and effects."""
    world = world_of(scenario)
    return Nominal(
        label,
        world.vehicle,
        rotor_maps(thrust_map_of(world.propeller), world.vehicle),
        propulsion_effects(world.propeller, world.effects),
    )
