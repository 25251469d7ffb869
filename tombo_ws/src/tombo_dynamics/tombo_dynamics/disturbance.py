"""Forces that no effect describes: what a diagnosis has to call unknown.

They are not in the registry, so no scenario names them and no fit proposes them. Who wants one
sets it on the plant's memory. Without one they cost five comparisons a tick.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.effects.registry import Param
from tombo_dynamics.errors import InputError, unknown_name
from tombo_dynamics.jit import compiled
from tombo_dynamics.params import check_number
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_body
from tombo_dynamics.vectors import add, norm

_TETHER, _PERIODIC, _FADE, _DRY_FRICTION, _PUSH, _WALL, _YAW, _HYSTERESIS = range(1, 9)

_SMOOTH_SPEED = 0.05
"""[m/s] below this dry drag fades."""
_FADED = 0.8
"""Of the thrust is the most that can fade."""


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
        _TETHER,
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
        _PERIODIC,
        (
            Param("amplitude", "N", 0.0, (0.0, 50.0), "of the push", 0.6),
            Param("frequency", "Hz", 0.0, (0.0, 50.0), "of the push", 0.7),
            Param("heading", "rad", 0.0, _TURN, "direction in map, from x to y", 0.6),
        ),
        "Horizontal force that goes to and fro in map.",
    ),
    "thrust_fade": Disturbance(
        _FADE,
        (Param("rate", "1/s", 0.0, (0.0, 1.0), "share of thrust lost per second", 0.004),),
        "Collective thrust is lost with the time since the start, at any voltage.",
    ),
    "dry_drag": Disturbance(
        _DRY_FRICTION,
        (Param("force", "N", 0.0, (0.0, 50.0), "whatever the speed", 0.5),),
        "Force of constant size against the velocity in the disc plane.",
    ),
    "body_push": Disturbance(
        _PUSH,
        (
            Param("x", "N", 0.0, (-50.0, 50.0), "forward", 0.5),
            Param("y", "N", 0.0, (-50.0, 50.0), "to the left", -0.3),
            Param("z", "N", 0.0, (-50.0, 50.0), "upward", 0.0),
        ),
        "Constant force in body axes, as of rotors that stand askew.",
    ),
    "wall_suction": Disturbance(
        _WALL,
        (
            Param("force", "N", 0.0, (0.0, 50.0), "at the wall", 2.0),
            Param("decay", "m", 0.5, (0.01, 10.0), "distance over which it falls to 37 %", 0.5),
            Param("place", "m", 0.0, _METRE, "of the wall, along its heading", 2.0),
            Param("heading", "rad", 0.0, _TURN, "from the origin to the wall", 0.0),
        ),
        "Horizontal force towards a wall, exponential in the distance.",
    ),
    "yaw_spring": Disturbance(
        _YAW,
        (
            Param("moment", "N m", 0.0, (0.0, 5.0), "at a quarter turn", 0.03),
            Param("heading", "rad", 0.0, _TURN, "at which it is slack", 1.0),
        ),
        "Yaw moment with the sine of the heading, as of a stiff cable.",
    ),
    "thrust_hysteresis": Disturbance(
        _HYSTERESIS,
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
    given = values or tuple(p.typical for p in shape.params)
    if len(given) != len(shape.params):
        raise InputError(
            f"disturbance '{name}': {len(given)} parameters; accepted: "
            + ", ".join(f"{p.name} [{p.unit}]" for p in shape.params)
        )
    checked = [
        check_number(f"disturbance.{name}.{p.name}", value, p.unit, p.bounds)
        for p, value in zip(shape.params, given, strict=True)
    ]
    plant.disturbance = np.zeros((), plant.disturbance.dtype)
    plant.disturbance.kind = shape.id
    plant.disturbance.params[: len(checked)] = checked


@compiled
def prepare_disturbance(plant: Plant) -> None:
    """Carry the disturbance's own state over the tick, before its first slope is taken."""
    d = plant.disturbance
    if d.kind == _HYSTERESIS:
        thrust, play = plant.rotors[0].thrust, d.params[0]
        d.trailing_thrust = min(max(d.trailing_thrust, thrust - play), thrust + play)


@compiled
def disturb(plant: Plant, row: int) -> None:
    """Add the disturbance to `force` and `moment`; `row` as in `rigid_body.derivative`."""
    d, p = plant.disturbance, plant.disturbance.params
    position, force, turn = plant.state.position, plant.force, plant.rotation
    time = (plant.ticks + 0.5 * row) * plant.tick_length
    x = y = z = 0.0  # force in map
    if d.kind == _TETHER:
        x, y, z = p[0] - position[0], p[1] - position[1], p[2] - position[2]
        distance = norm((x, y, z))
        pull = p[4] * max(distance - p[3], 0.0) / max(distance, 1e-9)
        x, y, z = pull * x, pull * y, pull * z
    elif d.kind == _PERIODIC:
        push = p[0] * math.sin(2.0 * math.pi * p[1] * time)
        x, y = push * math.cos(p[2]), push * math.sin(p[2])
    elif d.kind == _FADE:
        force[2] -= min(p[0] * time, _FADED) * plant.rotors[row].thrust
    elif d.kind == _DRY_FRICTION:
        u, v = plant.airspeed[0], plant.airspeed[1]
        size = p[0] / math.sqrt(u * u + v * v + _SMOOTH_SPEED * _SMOOTH_SPEED)
        force[0] -= size * u
        force[1] -= size * v
    elif d.kind == _PUSH:
        plant.force = add(force, p)
    elif d.kind == _WALL:
        ex, ey = math.cos(p[3]), math.sin(p[3])
        gap = max(p[2] - ex * position[0] - ey * position[1], 0.0)
        pull = p[0] * math.exp(-gap / p[1])
        x, y = pull * ex, pull * ey
    elif d.kind == _YAW:
        plant.moment[2] -= p[0] * math.sin(math.atan2(turn[1, 0], turn[0, 0]) - p[1])
    elif d.kind == _HYSTERESIS:
        force[2] += d.trailing_thrust - plant.rotors[0].thrust
    plant.force = add(force, to_body(turn, (x, y, z)))
