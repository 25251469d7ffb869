"""A load that hangs on a thread: it swings, and it may rest on the floor."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import point_velocity, push_point
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import to_map
from tombo_dynamics.vehicle import GRAVITY

_CORD_FREQUENCY, _CORD_DAMPING = 40.0, 0.3
"""[rad/s] and ratio of a load that bounces on its thread: stretched by 6 mm at rest, 1 % of a
thread of 0.6 m. Noise of measured poses pulls at a stiffer one by more than its load weighs."""
_SAG = GRAVITY / _CORD_FREQUENCY**2


class LoadState(Record):
    """What a hanging load remembers."""

    position = field("m", "map", 3)
    velocity = field("m/s", "map", 3)
    pull = field("m/s^2", "of the thread on the vehicle per mass of the load, map", 3)
    next_tick = field("1", "up to which it has moved; 0: it does not hang yet", kind=int)


@compiled
def _move(plant: Plant, state: LoadState, length: float, end: tuple[float, float, float]) -> None:
    """Move the load over a tick, under gravity and the thread that ends at `end` of the body."""
    tick, place, velocity = plant.tick_length, state.position, state.velocity
    ox, oy, oz = to_map(plant.rotation, end[0], end[1], end[2])
    vx, vy, vz = point_velocity(plant, end[0], end[1], end[2])
    at = plant.state.position
    if state.next_tick == 0:  # it hangs still, or lies below
        place[0], place[1] = at[0] + ox, at[1] + oy
        place[2] = max(at[2] + oz - length - _SAG, 0.0)
        if place[2] > 0.0:
            velocity[0], velocity[1], velocity[2] = vx, vy, vz
    x = place[0] - at[0] - ox
    y = place[1] - at[1] - oy
    z = place[2] - at[2] - oz
    distance = max(math.sqrt(x * x + y * y + z * z), 1e-9)
    x, y, z = x / distance, y / distance, z / distance
    parting = x * (velocity[0] - vx) + y * (velocity[1] - vy) + z * (velocity[2] - vz)
    stretch = distance - length
    pull = 0.0
    if stretch > 0.0:
        stiff = _CORD_FREQUENCY * _CORD_FREQUENCY
        damp = 2.0 * _CORD_DAMPING * _CORD_FREQUENCY
        pull = max(0.0, stiff * stretch + damp * parting)
    state.pull[0], state.pull[1], state.pull[2] = pull * x, pull * y, pull * z
    velocity[0] -= tick * pull * x
    velocity[1] -= tick * pull * y
    velocity[2] -= tick * (pull * z + GRAVITY)
    if place[2] <= 0.0 and velocity[2] <= 0.0:  # it lies on the floor
        for i in range(3):
            velocity[i] = 0.0
    for i in range(3):
        place[i] += tick * velocity[i]
    place[2] = max(place[2], 0.0)


@effect(
    "hanging_load",
    Stage.WRENCH,
    [
        Param("mass", "kg", 0.0, (0.0, 5.0), "of the load", 0.15),
        Param("length", "m", 0.5, (0.05, 10.0), "of the thread", 0.7),
        Param("x", "m", 0.0, (-1.0, 1.0), "where it is tied, ahead of the centre", 0.03),
        Param("y", "m", 0.0, (-1.0, 1.0), "where it is tied, left of the centre", 0.02),
    ],
    signature="weight, and a swing of the pendulum's period against the motion, in all forces",
    separates_from={
        "mass_error": "accelerate: a mass follows at once, a load swings after",
        "cog_offset": "stop from a fast straight: a centre of gravity does not swing",
    },
    state=LoadState,
)
def hanging_load(
    plant: Plant, noise: Array, state: LoadState, mass: float, length: float, x: float, y: float
) -> None:
    """Hang a point mass on a thread from (x, y, 0) in base_link.

    Thread: a damped spring that never pushes. The load moves once a tick; its pull stays for the
    tick, for both ends, so momentum is kept. It begins below its place, still as seen from there.
    """
    if mass <= 0.0:
        return
    px, py = x - plant.centre_of_gravity[0], y - plant.centre_of_gravity[1]
    if state.next_tick != plant.ticks + 1:
        _move(plant, state, length, (px, py, 0.0))
        state.next_tick = plant.ticks + 1
    pull = state.pull
    push_point(plant, px, py, 0.0, mass * pull[0], mass * pull[1], mass * pull[2])
