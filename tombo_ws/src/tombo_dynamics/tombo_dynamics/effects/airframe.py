"""Errors of the airframe's own parameters: mass, inertia, centre of gravity."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant


@effect(
    "mass_error",
    Stage.BODY,
    [Param("fraction", "1", 0.0, (-0.5, 1.0), "true mass over nominal mass, minus 1", 0.1)],
    signature="specific force off by one factor on all axes, in hover and in turns alike",
    separates_from={
        "thrust_coefficient_error": "weigh the vehicle, or run a thrust stand",
        "accel_scale": "the reading at rest on the floor, where only a scale shows",
    },
)
def mass_error(plant: Plant, noise: Array, fraction: float) -> None:
    """Scale the mass by 1 + fraction; the inertia stays."""
    plant.mass *= 1.0 + fraction


@effect(
    "inertia_error",
    Stage.BODY,
    [
        Param("xx", "1", 0.0, (-0.5, 1.0), "true inertia about x over the nominal, minus 1", 0.2),
        Param("yy", "1", 0.0, (-0.5, 1.0), "true inertia about y over the nominal, minus 1", 0.2),
        Param("zz", "1", 0.0, (-0.5, 1.0), "true inertia about z over the nominal, minus 1", 0.2),
    ],
    signature="angular acceleration off by a factor of the moment, axis by axis; hover is right",
    separates_from={
        "motor_lag": "slow rate sweeps: a lag vanishes at low frequency, a factor stays",
        "thrust_coefficient_error": "hover: a thrust factor also shows in the specific force",
    },
)
def inertia_error(plant: Plant, noise: Array, xx: float, yy: float, zz: float) -> None:
    """Scale the moments of inertia by 1 + xx, 1 + yy, 1 + zz; the mass stays."""
    plant.inertia[0] *= 1.0 + xx
    plant.inertia[1] *= 1.0 + yy
    plant.inertia[2] *= 1.0 + zz


@effect(
    "cog_offset",
    Stage.BODY,
    [
        Param("x", "m", 0.0, (-0.1, 0.1), "centre of gravity ahead of the centre", 0.01),
        Param("y", "m", 0.0, (-0.1, 0.1), "centre of gravity left of the centre", 0.01),
    ],
    signature="constant roll and pitch moment that grows with collective thrust",
    separates_from={
        "weak_propeller": "yaw step: a weak propeller also changes the yaw moment",
        "flapping_moment": "hover: flapping needs speed",
    },
)
def cog_offset(plant: Plant, noise: Array, x: float, y: float) -> None:
    """Move the centre of gravity by (x, y) in base_link; thrust then acts off centre."""
    plant.centre_of_gravity[0] += x
    plant.centre_of_gravity[1] += y
