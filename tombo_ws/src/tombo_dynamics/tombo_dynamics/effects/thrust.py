"""Errors of a rotor: thrust coefficient, weakness, scatter, flow across it, balance."""

from __future__ import annotations

import math

from tombo_dynamics.arrays import Array
from tombo_dynamics.body_point import hub
from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Plant
from tombo_dynamics.records import Record, field
from tombo_dynamics.rotation import to_body
from tombo_dynamics.vectors import add, cross, subtract
from tombo_dynamics.vehicle import SPIN


@effect(
    "thrust_coefficient_error",
    Stage.ROTOR,
    [Param("fraction", "1", 0.0, (-0.6, 0.6), "true thrust over the map's, minus 1", -0.1)],
    signature="specific force along body z off by a factor of thrust",
    separates_from={
        "mass_error": "weigh the vehicle, or run a thrust stand",
        "translational_lift": "hover and a fast straight: the coefficient is the same in both",
    },
)
def thrust_coefficient_error(plant: Plant, noise: Array, fraction: float) -> None:
    """Scale thrust and torque of all rotors by 1 + fraction."""
    for i in range(4):
        plant.efficiency[i] *= 1.0 + fraction


@effect(
    "weak_propeller",
    Stage.ROTOR,
    [
        Param("front_right", "1", 0.0, (0.0, 1.0), "lost share of thrust", 0.15),
        Param("rear_left", "1", 0.0, (0.0, 1.0), "lost share of thrust", 0.0),
        Param("front_left", "1", 0.0, (0.0, 1.0), "lost share of thrust", 0.0),
        Param("rear_right", "1", 0.0, (0.0, 1.0), "lost share of thrust", 0.0),
    ],
    signature="roll, pitch and yaw moments in the ratio of one corner, growing with its thrust",
    separates_from={"cog_offset": "yaw step: only a weak propeller changes the yaw moment"},
    confounded_with=("thrust_scatter",),
)
def weak_propeller(
    plant: Plant,
    noise: Array,
    front_right: float,
    rear_left: float,
    front_left: float,
    rear_right: float,
) -> None:
    """Take a share of thrust and torque from single rotors."""
    plant.efficiency[0] *= 1.0 - front_right
    plant.efficiency[1] *= 1.0 - rear_left
    plant.efficiency[2] *= 1.0 - front_left
    plant.efficiency[3] *= 1.0 - rear_right


@effect(
    "thrust_scatter",
    Stage.ROTOR,
    [Param("deviation", "1", 0.0, (0.0, 0.5), "standard deviation of thrust over its mean", 0.1)],
    signature="a constant moment about a fixed body axis, another one for every set of propellers",
    separates_from={"weak_propeller": "exchange the propellers: scatter goes with them"},
    stochastic=True,
    confounded_with=("weak_propeller",),
)
def thrust_scatter(plant: Plant, noise: Array, deviation: float) -> None:
    """Scale each rotor by its own constant draw: propellers of one set differ."""
    for i in range(4):
        plant.efficiency[i] *= max(0.2, 1.0 + deviation * plant.draws[i])


@effect(
    "translational_lift",
    Stage.ROTOR,
    [Param("k", "s^2/m^2", 0.0, (-0.05, 0.2), "gain per square of the speed across", 0.02)],
    signature="specific force along body z off by a factor that grows with the square of the "
    "airspeed in the disc plane, right in hover",
    separates_from={
        "linear_rotor_drag": "climb and descend: lift does not ask for the vertical speed",
        "thrust_coefficient_error": "hover, where only the coefficient shows",
    },
)
def translational_lift(plant: Plant, noise: Array, k: float) -> None:
    """Scale thrust and torque by 1 + k v_h^2, v_h the airspeed in the disc plane, at least 0.2.

    A flow across a rotor lowers its induced velocity: more thrust at the same speed, at first with
    the square (momentum theory, Glauert; the k_h v_h^2 of Faessler et al. 2018).
    """
    u, v, _ = to_body(plant.rotation, subtract(plant.state.velocity, plant.wind))
    gain = max(0.2, 1.0 + k * (u * u + v * v))
    for i in range(4):
        plant.efficiency[i] *= gain


class RotorAngles(Record):
    """Angles of the heavy blades."""

    angle = field("rad", "of each rotor from body x, at the start of the tick", 4)
    angle_step = field("rad", "of each rotor in this tick", 4)
    next_tick = field("1", "the tick after that of `angle_step`", kind=int)


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
            state.angle[i] = (state.angle[i] + state.angle_step[i]) % (2.0 * math.pi)
            state.angle_step[i] = SPIN[i] * speed * plant.tick_length
        half = 0.5 * state.angle_step[i]
        mean = math.sin(half) / half if abs(half) > 1e-6 else 1.0
        force = sizes[i] * speed * speed * mean
        angle = state.angle[i] + half
        push = (force * math.cos(angle), force * math.sin(angle), 0.0)
        plant.force = add(plant.force, push)
        plant.moment = add(plant.moment, cross(hub(plant, i), push))
