"""Errors of the airframe's own parameters: mass and centre of gravity."""

from __future__ import annotations

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P


@effect(
    "mass_error",
    Stage.BODY,
    [Param("fraction", "1", 0.0, (-0.5, 1.0), "true mass over nominal mass, minus 1", 0.1)],
    signature="specific force off by one factor on all axes, in hover and in turns alike",
    separates_from={"thrust_coefficient_error": "weigh the vehicle, or run a thrust stand"},
)
def mass_error(m: Array, noise: Array, fraction: float) -> None:
    """Scale the mass by 1 + fraction; the inertia stays."""
    m[P.inertial] *= 1.0 + fraction


@effect(
    "cog_offset",
    Stage.BODY,
    [
        Param("x", "m", 0.0, (-0.1, 0.1), "centre of gravity ahead of the centre", 0.01),
        Param("y", "m", 0.0, (-0.1, 0.1), "centre of gravity left of the centre", 0.01),
    ],
    signature="constant roll and pitch moment that grows with collective thrust",
    separates_from={"weak_propeller": "yaw step: a weak propeller also changes the yaw moment"},
)
def cog_offset(m: Array, noise: Array, x: float, y: float) -> None:
    """Move the centre of gravity by (x, y) in base_link; thrust then acts off centre."""
    m[P.inertial + 5] += x
    m[P.inertial + 6] += y
