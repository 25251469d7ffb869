"""What is true, from the plant: pose and twist, and the force of a touch."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import rotated_back, to_map
from tombo_dynamics.vectors import Vector, add, store


@compiled
def contact_force(plant: Plant) -> Vector:
    """Return the force on the vehicle in map [N]: of blade strikes, and of the frame's contact."""
    strike, contact = to_map(plant.rotation, plant.strike_force), plant.contact
    if contact.touching and contact.rotor < 0:
        return add(strike, contact.force)
    return strike


@compiled
def true_state(plant: Plant, out: Array) -> None:
    """Write position (3) and attitude (4) in map, velocity (3) and rates (3) in base_link."""
    state = plant.state
    store(out[0:3], state.position)
    store(out[3:7], state.attitude)
    store(out[7:10], rotated_back(state.attitude, state.velocity))
    store(out[10:13], state.rates)
