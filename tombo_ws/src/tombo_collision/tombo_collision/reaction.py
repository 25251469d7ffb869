"""The reaction: after a collision the set point becomes x_r = x_c + d_r n_r, and stays there."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np

from tombo_collision.detector import CollisionEvent
from tombo_collision.params import ReactionParams
from tombo_dynamics.arrays import Array

IDLE, REACTING, BLIND = "idle", "reacting", "blind"
_VERTICAL = 0.2


def _zeros() -> Array:
    return np.zeros(3)


@dataclass(frozen=True)
class ReactionState:
    """What the reaction has decided. Positions and directions in map."""

    state: str = IDLE
    x_c: Array = field(default_factory=_zeros)
    """Position of the vehicle at contact (3) [m]."""
    n_r: Array = field(default_factory=_zeros)
    """Unit vector, away from the obstacle: opposite to the flight before contact (3)."""
    x_r: Array = field(default_factory=_zeros)
    """Where to hold (3) [m]."""
    since_s: float = math.nan
    """Time of the last switch [s]."""
    collisions: int = 0


def bounce_direction(flight_direction: Array) -> Array:
    """Return n_r (3): opposite to the flight, horizontal unless the flight was nearly vertical."""
    horizontal = np.array([flight_direction[0], flight_direction[1], 0.0])
    length = math.sqrt(float(horizontal @ horizontal))
    if length < _VERTICAL:
        return -flight_direction
    escape: Array = -horizontal / length
    return escape


def react(state: ReactionState, event: CollisionEvent, params: ReactionParams) -> ReactionState:
    """Switch to x_r = x_c + d_r n_r (paper, Eq. of the reaction).

    The decision is latched: only a further event moves x_r. After a second collision the vehicle
    leaves along the new n_r; should that lead back to within half of d_r of an earlier x_c, it
    leaves along the sum of both directions, or sideways where the two cancel.
    """
    n_r = bounce_direction(event.flight_direction)
    x_r = event.x_c + params.distance * n_r
    if state.collisions:
        near = x_r - state.x_c
        if math.sqrt(float(near @ near)) < 0.5 * params.distance:
            both = n_r + state.n_r
            size = math.sqrt(float(both @ both))
            n_r = both / size if size > 0.3 else _sideways(n_r)
            x_r = event.x_c + params.distance * n_r
    x_r[2] = max(x_r[2], params.height_min)
    return ReactionState(REACTING, event.x_c, n_r, x_r, event.stamp_s, state.collisions + 1)


def _sideways(direction: Array) -> Array:
    """Return a horizontal unit vector (3) across `direction`; map x for a vertical one."""
    length = math.hypot(float(direction[0]), float(direction[1]))
    if length < 1e-6:
        return np.array([1.0, 0.0, 0.0])
    return np.array([-direction[1], direction[0], 0.0]) / length


def update_mocap_age(state: ReactionState, age_s: float, limit_s: float) -> ReactionState:
    """Say that mocap is lost (age above the limit) or back; x_r is kept meanwhile."""
    if state.state == REACTING and age_s > limit_s:
        return replace(state, state=BLIND)
    if state.state == BLIND and age_s <= limit_s:
        return replace(state, state=REACTING)
    return state
