"""A load that hangs on a thread: it swings, and it may rest on the floor."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import point_velocity, push_point
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.jit import compiled
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import to_map
from tombo_dynamics.vectors import ZERO, AnyVector, add, add_scaled, dot, norm, scale, subtract
from tombo_dynamics.vehicle import GRAVITY

_CORD_FREQUENCY, _CORD_DAMPING = 40.0, 0.3
"""[rad/s] and ratio of a load that bounces on its thread: stretched by 6 mm at rest, 1 % of a
thread of 0.6 m. Noise of measured poses pulls at a stiffer one by more than its load weighs."""
_SAG = GRAVITY / _CORD_FREQUENCY**2


class LoadState(Record):
    """Memory of a hanging load."""

    position = field("m", "map", 3)
    velocity = field("m/s", "map", 3)
    pull = field("m/s^2", "of the thread on the vehicle per mass of the load, map", 3)
    next_tick = field("1", "up to which it has moved; 0: it does not hang yet", kind=int)


@compiled(inline=False)
def _move(plant: Plant, state: LoadState, length: float, end: AnyVector) -> None:
    """Move the load over a tick, under gravity and the thread that ends at `end` of the body."""
    tick, origin = plant.tick_length, plant.state.position
    lever = to_map(plant.rotation, end)
    end_velocity = point_velocity(plant, end)
    if state.next_tick == 0:  # it hangs still, or lies below
        x, y, z = add(origin, lever)
        state.position = (x, y, max(z - length - _SAG, 0.0))
        if state.position[2] > 0.0:
            state.velocity = end_velocity
    x, y, z = subtract(subtract(state.position, origin), lever)
    distance = max(norm((x, y, z)), 1e-9)
    thread = (x / distance, y / distance, z / distance)
    parting = dot(thread, subtract(state.velocity, end_velocity))
    stretch = distance - length
    pull = 0.0
    if stretch > 0.0:
        stiff = _CORD_FREQUENCY * _CORD_FREQUENCY
        damp = 2.0 * _CORD_DAMPING * _CORD_FREQUENCY
        pull = max(0.0, stiff * stretch + damp * parting)
    state.pull = scale(pull, thread)
    state.velocity[0] -= tick * pull * thread[0]
    state.velocity[1] -= tick * pull * thread[1]
    state.velocity[2] -= tick * (pull * thread[2] + GRAVITY)
    if state.position[2] <= 0.0 and state.velocity[2] <= 0.0:  # it lies on the floor
        state.velocity = ZERO
    state.position = add_scaled(state.position, tick, state.velocity)
    state.position[2] = max(state.position[2], 0.0)


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
    healthy_spread=0.0,
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
    end = (x - plant.centre_of_gravity[0], y - plant.centre_of_gravity[1], 0.0)
    if state.next_tick != plant.ticks + 1:
        _move(plant, state, length, end)
        state.next_tick = plant.ticks + 1
    push_point(plant, end, scale(mass, state.pull))
