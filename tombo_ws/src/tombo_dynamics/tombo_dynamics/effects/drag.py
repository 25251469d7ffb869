"""Drag of rotors and body against the air, and the moment that comes with it."""

from __future__ import annotations

from tombo_dynamics.arrays import Array
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.vectors import multiply, norm, scale, subtract
from tombo_dynamics.vehicle import AIR_DENSITY


@effect(
    "linear_rotor_drag",
    Stage.WRENCH,
    [
        Param("d_xy", "N s/m", 0.0, (0.0, 3.0), "drag per speed in the disc plane", 0.3),
        Param("d_z", "N s/m", 0.0, (0.0, 3.0), "drag per speed along the rotor axis", 0.1),
    ],
    signature="lateral specific force against the velocity, grows linearly",
    separates_from={
        "quadratic_body_drag": "three speeds",
        "steady_wind": "the same leg both ways",
    },
)
def linear_rotor_drag(plant: Plant, noise: Array, d_xy: float, d_z: float) -> None:
    """Force -D v on the centre of mass, v through the air (Faessler et al. 2018, Eq. 2)."""
    plant.force = subtract(plant.force, multiply((d_xy, d_xy, d_z), plant.airspeed))


@effect(
    "quadratic_body_drag",
    Stage.WRENCH,
    [Param("c_area", "m^2", 0.0, (0.0, 0.5), "drag coefficient times frontal area", 0.05)],
    signature="lateral specific force against the velocity, grows with its square",
    separates_from={"linear_rotor_drag": "three speeds"},
)
def quadratic_body_drag(plant: Plant, noise: Array, c_area: float) -> None:
    """Force -rho/2 c_area |v| v on the centre of mass, rho the air's density."""
    k = 0.5 * AIR_DENSITY * c_area * norm(plant.airspeed)
    plant.force = subtract(plant.force, scale(k, plant.airspeed))


@effect(
    "flapping_moment",
    Stage.WRENCH,
    [Param("k", "N m s/m", 0.0, (-0.2, 0.2), "moment per speed in the disc plane", 0.02)],
    signature="pitch moment that lifts the nose in forward flight, and its like in roll, "
    "proportional to the velocity through the air",
    separates_from={
        "cog_offset": "hover: a centre of gravity off the axis acts at rest, flapping does not",
        "imu_lever_arm": "steady forward flight: a lever arm needs rotation",
    },
)
def flapping_moment(plant: Plant, noise: Array, k: float) -> None:
    """Lean back from the motion: moment k (v, -u, 0), (u, v) the airspeed in the disc plane.

    Rotor discs tilt away from the motion (blade flapping), and their drag acts at the hubs, above
    the centre of mass: both lift the side that goes ahead (Mahony, Kumar and Corke 2012; linear in
    the velocity as in Faessler et al. 2018).
    """
    plant.moment[0] += k * plant.airspeed[1]
    plant.moment[1] -= k * plant.airspeed[0]
