"""Recover in the propeller's own time: at once to x_r, the controller knowing the folded rotor."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tombo_collision.reactions import Decision, Estimate, Reaction, Reference
from tombo_collision.reactions.bounce import bounce_direction
from tombo_dynamics.arrays import Array
from tombo_dynamics.messages import CollisionEvent
from tombo_dynamics.params import param
from tombo_dynamics.rotation import yaw_of


@dataclass(frozen=True)
class Reflex(Reaction):
    """Back off by d_r as `bounce` does, known by the IMU, with the gains of the recovery.

    The controller knows of a strike within milliseconds, and shares thrust and torques by what
    each rotor can give while one is folded. Yaw follows the vehicle until it turns no more.
    """

    name: ClassVar[str] = "reflex"
    needs: ClassVar[tuple[str, ...]] = ("mocap", "imu")
    recovers: ClassVar[bool] = True

    distance: float = param(0.8, "m", (0.05, 20.0), "d_r, from x_c to x_r", "as bounce")
    height_min: float = param(
        0.7, "m", (0.0, 100.0), "x_r is not put below this height", "clear of ground effect"
    )
    push_share: float = param(
        1.0,
        "1",
        (0.0, 1.0),
        "share of the push's direction in n_r, the rest is against the flight",
        "the push points off the surface: the neighbour's disc leaves it too",
    )
    timeout: float = param(
        4.0,
        "s",
        (0.5, 60.0),
        "after this time the mission holds x_r with the cascade's gains",
        "three times the recovery",
    )

    def begin(self, event: CollisionEvent, estimate: Estimate, last: Decision | None) -> Decision:
        """Return x_r = x_c + d_r n_r."""
        n_r = bounce_direction(event.flight_direction)
        mixed = (1.0 - self.push_share) * n_r + self.push_share * event.push
        size = math.sqrt(float(mixed @ mixed))
        n_r = mixed / size if size > 0.1 else n_r
        x_r = event.contact_position + self.distance * n_r
        x_r[2] = max(x_r[2], self.height_min)
        return Recovering(event.contact_position, n_r, x_r, self, yaw_of(estimate.attitude))


_NEAR, _SLOW, _CALM = 0.15, 0.2, 0.5
"""m, m/s, rad/s: nearer to x_r, slower and turning slower than that, the recovery is over."""


@dataclass
class Recovering(Decision):
    """At x_r at once; the heading is the vehicle's own until it turns no more."""

    guides: ClassVar[bool] = True

    params: Reflex
    yaw: float

    def reference(self, time_s: float, estimate: Estimate) -> Reference:
        """Rest at x_r."""
        if abs(estimate.rates[2]) > _CALM:
            self.yaw = yaw_of(estimate.attitude)
        return Reference(self.x_r, np.zeros(3), np.zeros(3), self.yaw)

    def over(self, time_s: float, estimate: Estimate) -> bool:
        """Return whether it is at x_r and at rest, or time is up."""
        if time_s > self.params.timeout:
            return True
        return (
            _length(estimate.position - self.x_r) < _NEAR
            and _length(estimate.velocity) < _SLOW
            and _length(estimate.rates) < _CALM
        )


def _length(vector: Array) -> float:
    return math.sqrt(float(vector @ vector))
