"""Ground effect: more thrust close to the floor."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant


@effect(
    "ground_effect",
    Stage.ROTOR,
    [Param("strength", "1", 0.0, (0.0, 4.0), "1: Cheeseman and Bennett's single rotor", 1.0)],
    signature="thrust rises below about two rotor diameters of height",
    separates_from={"battery_sag": "two heights at equal voltage"},
)
def ground_effect(plant: Plant, noise: Array, strength: float) -> None:
    """Scale thrust by 1 / (1 - strength (R / 4z)^2), z of the disc (Cheeseman and Bennett 1955).

    The height is not taken below half a rotor radius, where the formula loses its meaning.
    """
    z = max(plant.state.position[2] + plant.vehicle.rotor_height, 0.5 * plant.vehicle.rotor_radius)
    ratio = plant.vehicle.rotor_radius / (4.0 * z)
    gain = 1.0 / (1.0 - min(strength * ratio * ratio, 0.5))
    for i in range(4):
        plant.efficiency[i] *= gain
