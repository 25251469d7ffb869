"""What is true, from the plant: pose and twist, and the force of a touch."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import rotated_back, to_map


@compiled
def contact_force(plant: Plant) -> tuple[float, float, float]:
    """Return the force on the vehicle in map [N]: of blade strikes, and of the frame's contact."""
    strike, contact = plant.strike_force, plant.contact
    x, y, z = to_map(plant.rotation, strike[0], strike[1], strike[2])
    if contact.touching and contact.rotor < 0:
        return x + contact.force[0], y + contact.force[1], z + contact.force[2]
    return x, y, z


@compiled
def true_state(plant: Plant, out: Array) -> None:
    """Write position (3) and attitude (4) in map, velocity (3) and rates (3) in base_link."""
    state = plant.state
    velocity = state.velocity
    for i in range(3):
        out[i] = state.position[i]
        out[10 + i] = state.rates[i]
    for i in range(4):
        out[3 + i] = state.attitude[i]
    out[7], out[8], out[9] = rotated_back(state.attitude, velocity[0], velocity[1], velocity[2])
