"""The disturbances of `tombo_dynamics.disturbance` by name, and how one is set on a vehicle."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from tombo_dynamics import disturbance
from tombo_dynamics.plant import Plant


@dataclass(frozen=True)
class Disturbance:
    """A kind of disturbance."""

    id: int
    strength: tuple[str, ...]
    """Parameters that scale its force or moment."""
    typical: Mapping[str, float]
    """Parameter -> size that clearly matters, in the order of `tombo_dynamics.disturbance`.

    Forces [N], moments [N m], places and lengths in map [m], headings [rad], frequencies [Hz].
    """


DISTURBANCES: Mapping[str, Disturbance] = {
    # an elastic cord to a fixed point; stiffness [N/m]
    "tether": Disturbance(
        disturbance.TETHER, ("stiffness",),
        {"x": 0.0, "y": 0.0, "z": 0.0, "length": 1.0, "stiffness": 1.5},
    ),
    "periodic_push": Disturbance(
        disturbance.PERIODIC_PUSH, ("amplitude",),
        {"amplitude": 0.6, "frequency": 0.7, "heading": 0.6},
    ),
    # share of the thrust that is lost in a second [1/s]
    "thrust_fade": Disturbance(disturbance.THRUST_FADE, ("rate",), {"rate": 0.004}),
    "dry_drag": Disturbance(disturbance.DRY_DRAG, ("force",), {"force": 0.5}),
    "body_push": Disturbance(
        disturbance.BODY_PUSH, ("x", "y", "z"), {"x": 0.5, "y": -0.3, "z": 0.0}
    ),
    # the force falls to 37 % over `decay`
    "wall_suction": Disturbance(
        disturbance.WALL_SUCTION, ("force",),
        {"force": 2.0, "decay": 0.5, "place": 2.0, "heading": 0.0},
    ),
    "yaw_spring": Disturbance(
        disturbance.YAW_SPRING, ("moment",), {"moment": 0.03, "heading": 1.0}
    ),
    "thrust_hysteresis": Disturbance(disturbance.THRUST_HYSTERESIS, ("play",), {"play": 0.4}),
}  # fmt: skip
"""Name -> kind."""


def set_disturbance(plant: Plant, name: str, *values: float) -> None:
    """Let a disturbance act on the plant from its present state on.

    Args:
        plant: at the start of a tick.
        name: one of `DISTURBANCES`.
        values: its parameters in order; without any, the typical ones.

    Raises:
        ValueError: too many or too few parameters.
    """
    kind = DISTURBANCES[name]
    numbers = values or tuple(kind.typical.values())
    if len(numbers) != len(kind.typical):
        raise ValueError(f"disturbance '{name}': {len(numbers)} values for {list(kind.typical)}")
    plant.disturbance = np.zeros((), plant.disturbance.dtype)
    plant.disturbance.kind = kind.id
    plant.disturbance.params[: len(numbers)] = numbers
