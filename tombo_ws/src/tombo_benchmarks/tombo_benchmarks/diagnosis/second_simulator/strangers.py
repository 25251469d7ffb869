"""Forces and faults that no effect of the registry describes."""

from __future__ import annotations

from dataclasses import dataclass
from math import atan2, cos, exp, pi, sin, sqrt

import numpy as np

from tombo_benchmarks.diagnosis.second_simulator.vehicles import S500, Quadrotor

STRANGERS = (
    "tether", "wall_suction", "slung_load", "thrust_hysteresis", "periodic_push", "dry_friction",
    "yaw_cable",
)  # fmt: skip
"""Elastic cord to the floor; pull to a wall; load on a cord; thrust that trails its changes;
force to and fro; drag of one size at any speed; a cable that resists yaw."""
_WALL_M, _DECAY_M = 2.2, 0.5
"""Of the wall from the origin; over which its pull falls to 37 %."""
_SMOOTH_SPEED = 0.05
"""m/s below which dry friction fades."""


@dataclass
class Stranger:
    """What acts on the vehicle; sizes are zero unless chosen."""

    name: str = ""
    size: float = 0.0
    """N, N/m (tether), N m (yaw cable)"""
    heading: float = 0.0
    """rad: of a push, of the wall, of the slack cable"""
    frequency: float = 0.5
    """Hz"""
    load: float = 0.0
    """kg"""
    cord: float = 0.7
    """m"""
    trailing: float | None = None
    """N: collective thrust behind the play."""

    def wrench(
        self,
        state: list[float],
        air: tuple[float, float],
        nose: tuple[float, float],
        thrust: float,
        time: float,
    ) -> tuple[list[float], list[float], float]:
        """Return force in world and in body axes [N], and moment about the body's z [N m].

        Args:
            state: of the vehicle, position first.
            air: velocity through the air in the disc plane [m/s].
            nose: the body's x axis, its east and its north part.
            thrust: of all rotors [N].
            time: since the start [s].
        """
        world, body, moment = [0.0] * 3, [0.0] * 3, 0.0
        along = cos(self.heading), sin(self.heading)
        if self.name == "tether":
            length = sqrt(sum(x * x for x in state[:3]))
            pull = self.size * max(length - 1.0, 0.0) / length
            world = [-pull * x for x in state[:3]]
        elif self.name == "wall_suction":
            gap = max(_WALL_M - state[0] * along[0] - state[1] * along[1], 0.0)
            world = [self.size * exp(-gap / _DECAY_M) * x for x in (*along, 0.0)]
        elif self.name == "periodic_push":
            push = self.size * sin(2.0 * pi * self.frequency * time)
            world = [push * along[0], push * along[1], 0.0]
        elif self.name == "dry_friction":
            pace = sqrt(air[0] ** 2 + air[1] ** 2 + _SMOOTH_SPEED**2)
            body = [-self.size * air[0] / pace, -self.size * air[1] / pace, 0.0]
        elif self.name == "yaw_cable":
            moment = -self.size * sin(atan2(nose[1], nose[0]) - self.heading)
        elif self.name == "thrust_hysteresis" and self.trailing is not None:
            body[2] = self.trailing - thrust
        return world, body, moment

    def follow(self, collective: float) -> None:
        """Move the play along with the collective thrust [N]."""
        before = collective if self.trailing is None else self.trailing
        self.trailing = max(min(before, collective + self.size), collective - self.size)


def draw_stranger(name: str, factor: float, quad: Quadrotor, rng: np.random.Generator) -> Stranger:
    """Return a stranger `factor` times as strong as one that is clearly felt."""
    heavy = quad.mass / S500.mass
    strength = {
        "tether": 1.5 * heavy, "wall_suction": 2.0 * heavy, "thrust_hysteresis": 0.4 * heavy,
        "periodic_push": 0.6 * heavy, "dry_friction": 0.5 * heavy,
        "yaw_cable": 0.03 * heavy * quad.arm / S500.arm, "slung_load": 0.0,
    }[name]  # fmt: skip
    return Stranger(
        name, factor * strength, float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(0.2, 1.2)),
        load=0.15 * heavy * factor if name == "slung_load" else 0.0,
    )  # fmt: skip
