"""What a reaction has decided: where to go after a collision, and on which way."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.rotation import yaw_of


@dataclass(frozen=True)
class Estimate:
    """The newest estimate that has come."""

    position: Array
    """(3) of base_link in map [m]."""
    velocity: Array
    """(3) in map [m/s]."""
    attitude: Array
    """(4) quaternion xyzw, map from base_link."""
    rates: Array
    """(3) [rad/s], base_link."""


@dataclass(frozen=True)
class Reference:
    """Where the vehicle shall be now."""

    position: Array
    """(3) in map [m]."""
    velocity: Array
    """(3) in map, fed forward [m/s]."""
    acceleration: Array
    """(3) in map, fed forward [m/s^2]."""
    yaw: float
    """[rad]"""


@dataclass
class Decision:
    """What a reaction decides on a collision. Positions and directions in map.

    With `guides` the set point is its `reference` until it is `over`; without, x_r at once, until
    the mission flies there.
    """

    guides: ClassVar[bool] = False

    x_c: Array
    """(3) base_link at contact [m]."""
    n_r: Array
    """(3) unit vector, from x_c to x_r."""
    x_r: Array
    """(3) where to hold [m]."""

    def reference(self, time_s: float, estimate: Estimate) -> Reference:
        """Return the set point so long after the decision; asked at 50 Hz while it guides."""
        raise NotImplementedError

    def over(self, time_s: float, estimate: Estimate) -> bool:
        """Return whether the mission holds x_r from now on; asked before each reference."""
        return True


_NEAR, _SLOW, _CALM = 0.15, 0.2, 0.5
"""m, m/s, rad/s: nearer to x_r, slower and turning slower than that, the vehicle has arrived."""


@dataclass
class Guided(Decision):
    """A way to x_r; the heading is the vehicle's own until it turns no more."""

    guides: ClassVar[bool] = True

    timeout: float
    """So long after the decision it is over in any case [s]."""
    yaw: float
    """The heading asked for [rad]."""

    def motion(self, time_s: float, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Return position (3), velocity (3) and acceleration (3) of the way: rest at x_r."""
        return self.x_r, np.zeros(3), np.zeros(3)

    def reference(self, time_s: float, estimate: Estimate) -> Reference:
        """Return the way's point of now."""
        if abs(estimate.rates[2]) > _CALM:
            self.yaw = yaw_of(estimate.attitude)
        return Reference(*self.motion(time_s, estimate), self.yaw)

    def over(self, time_s: float, estimate: Estimate) -> bool:
        """Return whether the vehicle is at x_r and at rest, or time is up."""
        if time_s > self.timeout:
            return True
        return (
            length(estimate.position - self.x_r) < _NEAR
            and length(estimate.velocity) < _SLOW
            and length(estimate.rates) < _CALM
        )


def length(vector: Array) -> float:
    """Return the length of a vector."""
    return math.sqrt(float(vector @ vector))
