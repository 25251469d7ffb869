"""Downwash: the jet of air below another vehicle. It acts through the drag effects, as wind."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant, State
from tombo_dynamics.records import Record, field
from tombo_dynamics.vehicle import AIR_DENSITY

MOST_OTHERS = 8
"""Largest number of other vehicles."""
_DECAY = 6.06
"""Of the speed on the axis of a round turbulent jet (Panchapakesan and Lumley 1993)."""
_SPREAD = 0.096
"""Half-width over distance of the same jet."""
_SHAPE = (math.sqrt(2.0) - 1.0) / (_SPREAD * _SPREAD)


class Jets(Record):
    """Vehicles that blow air down, as of the last tick."""

    position = field("m", "map", (MOST_OTHERS, 3))
    thrust = field("N", "0: none there", MOST_OTHERS)


@effect(
    "downwash",
    Stage.AIR,
    [Param("strength", "1", 0.0, (0.0, 4.0), "1: the jet of the other vehicle's thrust", 1.0)],
    signature="a push down while another vehicle is above",
    state=Jets,
    company=True,
    healthy_spread=0.0,
)
def downwash(plant: Plant, noise: Array, state: Jets, strength: float) -> None:
    """Blow down with the round turbulent jet of each vehicle above (Pope 2000, Eqs. 5.7, 5.82).

    At radius r and distance x below, the speed is U = B K / x (1 + a (r/x)^2)^-2. The thrust T
    gives K = sqrt(4 T / (pi rho)). The far field of quadrotors is such a jet (Bauersfeld et al.
    2024). Nearer than 2 sqrt(2) B R, where U is that of the wake by momentum theory, x is this
    distance. The jet is vertical, and the other vehicle has rotors of the same radius R.
    """
    core = 2.0 * math.sqrt(2.0) * _DECAY * plant.vehicle.rotor_radius
    for k in range(MOST_OTHERS):
        below = state.position[k, 2] - plant.state.position[2]
        if state.thrust[k] <= 0.0 or below <= 0.0:
            continue
        east = plant.state.position[0] - state.position[k, 0]
        north = plant.state.position[1] - state.position[k, 1]
        x = max(below, core)
        momentum = math.sqrt(4.0 * state.thrust[k] / (math.pi * AIR_DENSITY))
        shape = 1.0 + _SHAPE * (east * east + north * north) / (x * x)
        plant.wind[2] -= strength * _DECAY * momentum / (x * shape * shape)


def jet_of(state: State, plant: Any) -> tuple[Array, float]:
    """Return position (3) [m] and thrust [N] of a vehicle, for `set_jets` of the others.

    Args:
        state: the vehicle's at the start of the tick, when its thrust was taken.
        plant: the vehicle.
    """
    return np.array(state.position), float(np.sum(plant.rotor_thrust))


def set_jets(plant: Any, jets: Sequence[tuple[Array, float]]) -> None:
    """Let a vehicle feel the jets of others from its next tick on."""
    state = plant.memories.downwash
    for k, (position, thrust) in enumerate(jets):
        state.position[k] = position
        state.thrust[k] = thrust
