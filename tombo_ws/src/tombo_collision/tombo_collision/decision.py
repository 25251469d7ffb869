"""The decision of a reaction: where to go after a collision, and on which way."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.jit import compiled
from tombo_dynamics.rotation import yaw_of
from tombo_dynamics.vectors import AnyVector, norm, subtract


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
    """The answer to a collision: hold x_r at once, until the mission flies there."""

    x_c: Array
    """(3) base_link at contact, map [m]."""
    n_r: Array
    """(3) unit vector, from x_c to x_r, map."""
    x_r: Array
    """(3) where to hold, map [m]."""


_VERTICAL = 0.2
"""A flight with less of its direction across is nearly vertical."""
_SETTLED_M, _SETTLED_M_S, _SETTLED_RAD_S = 0.15, 0.2, 0.5
"""m, m/s, rad/s: nearer to x_r, slower and turning slower than that, the vehicle has arrived."""


@compiled(inline=False)
def turns(rates: Array) -> bool:
    """Return whether a vehicle with body rates (3) [rad/s] turns about its z axis."""
    return bool(abs(rates[2]) > _SETTLED_RAD_S)


@compiled(inline=False)
def at_rest(position: Array, velocity: AnyVector, rates: Array, x_r: Array) -> bool:
    """Return whether a vehicle has arrived at x_r; all (3), map, the rates base_link."""
    return bool(
        norm(subtract(position, x_r)) < _SETTLED_M
        and norm(velocity) < _SETTLED_M_S
        and norm(rates) < _SETTLED_RAD_S
    )


@dataclass
class Guided(Decision):
    """A way to x_r: its reference is the set point until it is over, then the mission holds x_r.

    The heading is the vehicle's own until it turns no more.
    """

    timeout: float
    """Time after the decision at which it ends in any case [s]."""
    yaw: float
    """The heading asked for [rad]."""

    def motion(self, time_s: float, estimate: Estimate) -> tuple[Array, Array, Array]:
        """Return position (3), velocity (3) and acceleration (3) of the way: rest at x_r."""
        return self.x_r, np.zeros(3), np.zeros(3)

    def reference(self, time_s: float, estimate: Estimate) -> Reference:
        """Return the set point at `time_s` after the decision; called at 50 Hz."""
        if turns(estimate.rates):
            self.yaw = yaw_of(estimate.attitude)
        return Reference(*self.motion(time_s, estimate), self.yaw)

    def over(self, time_s: float, estimate: Estimate) -> bool:
        """Return whether the vehicle is at x_r and at rest, or time is up; asked first."""
        if time_s > self.timeout:
            return True
        return at_rest(estimate.position, estimate.velocity, estimate.rates, self.x_r)


_FARTHEST = 120.0
"""m: no x_r is further from x_c; the bounds of a reaction's distance and height together."""
_NOT_UNIT = 0.01


def check_decision(decision: object, contact: Array, near: float) -> None:
    """Raise if the decision on a collision is invalid.

    Args:
        decision: what `begin` has returned, not None.
        contact: (3) position of the collision, map [m].
        near: x_c is not further from it [m].

    Raises:
        InputError: it is none, or has a value that no vehicle is to fly to.
    """
    if not isinstance(decision, Decision):
        raise InputError(f"returned {shown(decision)}; accepted: a Decision, or None")
    x_c = _vector("x_c", decision.x_c, contact, near, "the collision")
    n_r = _vector("n_r", decision.n_r, np.zeros(3), math.inf, "")
    if abs(length(n_r) - 1.0) > _NOT_UNIT:
        raise InputError(f"returned n_r {n_r.tolist()}; accepted: a unit vector")
    _vector("x_r", decision.x_r, x_c, _FARTHEST, "x_c")


def check_reference(reference: object, x_c: Array) -> None:
    """Raise if the reference of a decision with x_c (3) [m] is invalid.

    Raises:
        InputError: it is none, or has a value that no vehicle is to fly to.
    """
    if not isinstance(reference, Reference):
        raise InputError(f"returned {shown(reference)}; accepted: a Reference")
    _vector("position", reference.position, x_c, _FARTHEST, "x_c")
    for name in ("velocity", "acceleration"):
        _vector(name, getattr(reference, name), np.zeros(3), math.inf, "")
    if not math.isfinite(reference.yaw):
        raise InputError(f"returned yaw {reference.yaw}; accepted: a finite number [rad]")


def _vector(name: str, value: object, around: Array, reach: float, of: str) -> Array:
    """Return a vector (3) that is finite and within a reach [m] of a point (3)."""
    vector = np.asarray(value, np.float64)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise InputError(f"returned {name} {shown(vector.tolist())}; accepted: 3 finite numbers")
    away = length(vector - around)
    if away > reach:
        raise InputError(
            f"returned {name} {away:.3g} m away from {of}; accepted: {reach:g} m at most"
        )
    return vector


def against_flight(flight_direction: Array) -> Array:
    """Return n_r (3): opposite to the flight, horizontal unless the flight was nearly vertical."""
    horizontal = np.array([flight_direction[0], flight_direction[1], 0.0])
    across = length(horizontal)
    if across < _VERTICAL:
        return -flight_direction
    escape: Array = -horizontal / across
    return escape


def back_off(x_c: Array, n_r: Array, distance: float, height_min: float) -> Array:
    """Return x_r = x_c + distance n_r (3) [m], no lower than `height_min`."""
    x_r = x_c + distance * n_r
    x_r[2] = max(x_r[2], height_min)
    return x_r


def length(vector: Array) -> float:
    """Return the length of a vector."""
    return math.sqrt(float(vector @ vector))
