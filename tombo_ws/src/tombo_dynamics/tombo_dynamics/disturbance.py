"""Forces that no effect describes: a diagnosis has to call them unknown.

They are not in the registry, so no scenario names them and no fit proposes them. Benchmarks and
tests set one on the plant (`tombo_benchmarks.diagnosis.disturbances`). Without one they cost five
comparisons a tick.
"""

from __future__ import annotations

import math

from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.rotation import to_body
from tombo_dynamics.vectors import add, norm

(
    TETHER,
    PERIODIC_PUSH,
    THRUST_FADE,
    DRY_DRAG,
    BODY_PUSH,
    WALL_SUCTION,
    YAW_SPRING,
    THRUST_HYSTERESIS,
) = range(1, 9)
"""Kinds; 0 is none."""

_SMOOTH_SPEED = 0.05
"""[m/s] below this dry drag fades."""
_FADED = 0.8
"""Of the thrust is the most that can fade."""


@compiled
def prepare_disturbance(plant: Plant) -> None:
    """Carry the disturbance's own state over the tick, before its first slope is taken."""
    d = plant.disturbance
    if d.kind == THRUST_HYSTERESIS:
        thrust, play = plant.rotors[0].thrust, d.params[0]
        d.trailing_thrust = min(max(d.trailing_thrust, thrust - play), thrust + play)


@compiled(inline=False)
def disturb(plant: Plant, row: int) -> None:
    """Add the disturbance to `force` and `moment`; `row` as in `rigid_body.derivative`."""
    d, p = plant.disturbance, plant.disturbance.params
    position, force, turn = plant.state.position, plant.force, plant.rotation
    time = (plant.ticks + 0.5 * row) * plant.tick_length
    x = y = z = 0.0  # force in map
    if d.kind == TETHER:
        x, y, z = p[0] - position[0], p[1] - position[1], p[2] - position[2]
        distance = norm((x, y, z))
        pull = p[4] * max(distance - p[3], 0.0) / max(distance, 1e-9)
        x, y, z = pull * x, pull * y, pull * z
    elif d.kind == PERIODIC_PUSH:
        push = p[0] * math.sin(2.0 * math.pi * p[1] * time)
        x, y = push * math.cos(p[2]), push * math.sin(p[2])
    elif d.kind == THRUST_FADE:
        force[2] -= min(p[0] * time, _FADED) * plant.rotors[row].thrust
    elif d.kind == DRY_DRAG:
        u, v = plant.airspeed[0], plant.airspeed[1]
        size = p[0] / math.sqrt(u * u + v * v + _SMOOTH_SPEED * _SMOOTH_SPEED)
        force[0] -= size * u
        force[1] -= size * v
    elif d.kind == BODY_PUSH:
        plant.force = add(force, p)
    elif d.kind == WALL_SUCTION:
        ex, ey = math.cos(p[3]), math.sin(p[3])
        gap = max(p[2] - ex * position[0] - ey * position[1], 0.0)
        pull = p[0] * math.exp(-gap / p[1])
        x, y = pull * ex, pull * ey
    elif d.kind == YAW_SPRING:
        plant.moment[2] -= p[0] * math.sin(math.atan2(turn[1, 0], turn[0, 0]) - p[1])
    elif d.kind == THRUST_HYSTERESIS:
        force[2] += d.trailing_thrust - plant.rotors[0].thrust
    plant.force = add(force, to_body(turn, (x, y, z)))
