"""A propeller out of balance: a force that turns with its rotor."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import hub
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.vectors import add, cross
from tombo_dynamics.vehicle import SPIN


class RotorAngles(Record):
    """Where the heavy blades are."""

    angle = field("rad", "of each rotor from body x, at the start of the tick", 4)
    turned = field("rad", "of each rotor in this tick", 4)
    next_tick = field("1", "the tick after the one that `turned` is of", kind=int)


@effect(
    "propeller_unbalance",
    Stage.WRENCH,
    [
        Param("front_right", "kg m", 0.0, (0.0, 1e-3), "mass times its distance off axis", 5e-6),
        Param("rear_left", "kg m", 0.0, (0.0, 1e-3), "mass times its distance off axis", 0.0),
        Param("front_left", "kg m", 0.0, (0.0, 1e-3), "mass times its distance off axis", 0.0),
        Param("rear_right", "kg m", 0.0, (0.0, 1e-3), "mass times its distance off axis", 0.0),
    ],
    signature="vibration of accelerometer and gyro at the speed of one rotor, growing with its "
    "square",
    separates_from={"imu_noise": "the spectrum: a line that moves with the rotor's speed"},
    state=RotorAngles,
    vibration=True,
)
def propeller_unbalance(
    plant: Plant,
    noise: Array,
    state: RotorAngles,
    front_right: float,
    rear_left: float,
    front_left: float,
    rear_right: float,
) -> None:
    """Pull at each hub with m r w^2, turning with the rotor: its mean over the tick.

    A rotor that turns by more than half a turn a tick is seen folded down, as any sensor of that
    rate sees it.
    """
    sizes = (front_right, rear_left, front_left, rear_right)
    if max(sizes) <= 0.0:
        return
    fresh = state.next_tick != plant.ticks + 1
    state.next_tick = plant.ticks + 1
    for i in range(4):
        speed = plant.rotor_speed[i]
        if fresh:
            state.angle[i] = (state.angle[i] + state.turned[i]) % (2.0 * math.pi)
            state.turned[i] = SPIN[i] * speed * plant.tick_length
        half = 0.5 * state.turned[i]
        mean = math.sin(half) / half if abs(half) > 1e-6 else 1.0
        force = sizes[i] * speed * speed * mean
        angle = state.angle[i] + half
        push = (force * math.cos(angle), force * math.sin(angle), 0.0)
        plant.force = add(plant.force, push)
        plant.moment = add(plant.moment, cross(hub(plant, i), push))
