"""The paper's reaction: the set point becomes x_r = x_c + d_r n_r, and stays there."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tombo_collision.decision import Decision, Estimate, against_flight, back_off, length
from tombo_collision.reactions import Reaction
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import param


@dataclass(frozen=True)
class Bounce(Reaction):
    """Back off by d_r against the flight before contact: x_r = x_c + d_r n_r."""

    name: ClassVar[str] = "bounce"

    distance: float = param(0.8, "m", (0.05, 20.0), "d_r, from x_c to x_r", "paper")
    height_min: float = param(
        0.7, "m", (0.0, 100.0), "x_r is not put below this height", "clear of ground effect"
    )
    timeout: float = param(
        12.0,
        "s",
        (1.0, 600.0),
        "the reaction is called off as not settled after this time",
        "more than twice the paper's recovery time",
    )

    def begin(self, event: CollisionEvent, estimate: Estimate, last: Decision | None) -> Decision:
        """Return x_r = x_c + d_r n_r (paper, Eq. of the reaction).

        After a second collision the vehicle leaves along the new n_r; if that leads to within half
        of d_r of the earlier x_c, it leaves along the sum of both directions, or sideways where
        they cancel.
        """
        x_c, n_r = event.contact_position, against_flight(event.flight_direction)
        if last is not None:
            near = x_c + self.distance * n_r - last.x_c
            if length(near) < 0.5 * self.distance:
                total = n_r + last.n_r
                size = length(total)
                n_r = total / size if size > 0.3 else _sideways(n_r)
        return Decision(x_c, n_r, back_off(x_c, n_r, self.distance, self.height_min))


def _sideways(direction: Array) -> Array:
    """Return a horizontal unit vector (3) across `direction`; map x for a vertical one."""
    across = math.hypot(float(direction[0]), float(direction[1]))
    if across < 1e-6:
        return np.array([1.0, 0.0, 0.0])
    return np.array([-direction[1], direction[0], 0.0]) / across
