"""The disturbances of `tombo_dynamics.disturbance` by name, and how one is set on a vehicle."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_dynamics import disturbance
from tombo_dynamics.effects.registry import Param
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.params import check_number
from tombo_dynamics.plant import Plant


@dataclass(frozen=True)
class Disturbance:
    """A kind of disturbance."""

    id: int
    params: tuple[Param, ...]
    doc: str


_METRE = (-100.0, 100.0)
_TURN = (-math.pi, math.pi)

DISTURBANCES: dict[str, Disturbance] = {
    "tether": Disturbance(
        disturbance.TETHER,
        (
            Param("x", "m", 0.0, _METRE, "fixed end in map", 0.0),
            Param("y", "m", 0.0, _METRE, "fixed end in map", 0.0),
            Param("z", "m", 0.0, _METRE, "fixed end in map", 0.0),
            Param("length", "m", 0.0, (0.0, 100.0), "of the slack cord", 1.0),
            Param("stiffness", "N/m", 0.0, (0.0, 1000.0), "of the cord", 1.5),
        ),
        "Elastic cord from the centre of mass to a fixed point.",
    ),
    "periodic_push": Disturbance(
        disturbance.PERIODIC_PUSH,
        (
            Param("amplitude", "N", 0.0, (0.0, 50.0), "of the push", 0.6),
            Param("frequency", "Hz", 0.0, (0.0, 50.0), "of the push", 0.7),
            Param("heading", "rad", 0.0, _TURN, "direction in map, from x to y", 0.6),
        ),
        "Horizontal force that goes to and fro in map.",
    ),
    "thrust_fade": Disturbance(
        disturbance.THRUST_FADE,
        (Param("rate", "1/s", 0.0, (0.0, 1.0), "share of thrust lost per second", 0.004),),
        "Collective thrust is lost with the time since the start, at any voltage.",
    ),
    "dry_drag": Disturbance(
        disturbance.DRY_DRAG,
        (Param("force", "N", 0.0, (0.0, 50.0), "whatever the speed", 0.5),),
        "Force of constant size against the velocity in the disc plane.",
    ),
    "body_push": Disturbance(
        disturbance.BODY_PUSH,
        (
            Param("x", "N", 0.0, (-50.0, 50.0), "forward", 0.5),
            Param("y", "N", 0.0, (-50.0, 50.0), "to the left", -0.3),
            Param("z", "N", 0.0, (-50.0, 50.0), "upward", 0.0),
        ),
        "Constant force in body axes, as of rotors that stand askew.",
    ),
    "wall_suction": Disturbance(
        disturbance.WALL_SUCTION,
        (
            Param("force", "N", 0.0, (0.0, 50.0), "at the wall", 2.0),
            Param("decay", "m", 0.5, (0.01, 10.0), "distance over which it falls to 37 %", 0.5),
            Param("place", "m", 0.0, _METRE, "of the wall, along its heading", 2.0),
            Param("heading", "rad", 0.0, _TURN, "from the origin to the wall", 0.0),
        ),
        "Horizontal force towards a wall, exponential in the distance.",
    ),
    "yaw_spring": Disturbance(
        disturbance.YAW_SPRING,
        (
            Param("moment", "N m", 0.0, (0.0, 5.0), "at a quarter turn", 0.03),
            Param("heading", "rad", 0.0, _TURN, "at which it is slack", 1.0),
        ),
        "Yaw moment with the sine of the heading, as of a stiff cable.",
    ),
    "thrust_hysteresis": Disturbance(
        disturbance.THRUST_HYSTERESIS,
        (Param("play", "N", 0.0, (0.0, 10.0), "half width of the loop", 0.4),),
        "Collective thrust trails its changes by a play: less when it rises than when it falls.",
    ),
}
"""Name → shape."""


def set_disturbance(plant: Plant, name: str, *values: float) -> None:
    """Let a disturbance act on the plant from its present state on.

    Args:
        plant: at the start of a tick.
        name: one of `DISTURBANCES`.
        values: its parameters in order; without any, the typical ones.

    Raises:
        InputError: an unknown name, too many or too few parameters, or one out of bounds.
    """
    if name not in DISTURBANCES:
        raise unknown_name("disturbance", name, DISTURBANCES)
    shape = DISTURBANCES[name]
    numbers = values or tuple(p.typical for p in shape.params)
    if len(numbers) != len(shape.params):
        raise InputError(
            f"disturbance '{name}': {len(numbers)} parameters; accepted: "
            + ", ".join(f"{p.name} [{p.unit}]" for p in shape.params)
        )
    checked = [
        check_number(f"disturbance.{name}.{p.name}", value, p.unit, p.bounds)
        for p, value in zip(shape.params, numbers, strict=True)
    ]
    plant.disturbance = np.zeros((), plant.disturbance.dtype)
    plant.disturbance.kind = shape.id
    plant.disturbance.params[: len(checked)] = checked
