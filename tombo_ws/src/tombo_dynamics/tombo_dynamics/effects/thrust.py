"""What a rotor's thrust is off by: coefficient, a weak propeller, scatter, the flow across it."""

from __future__ import annotations

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P


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
def thrust_coefficient_error(m: Array, noise: Array, fraction: float) -> None:
    """Scale thrust and torque of all rotors by 1 + fraction."""
    for i in range(4):
        m[P.efficiency + i] *= 1.0 + fraction


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
)
def weak_propeller(
    m: Array,
    noise: Array,
    front_right: float,
    rear_left: float,
    front_left: float,
    rear_right: float,
) -> None:
    """Take a share of thrust and torque from single rotors."""
    m[P.efficiency] *= 1.0 - front_right
    m[P.efficiency + 1] *= 1.0 - rear_left
    m[P.efficiency + 2] *= 1.0 - front_left
    m[P.efficiency + 3] *= 1.0 - rear_right


@effect(
    "thrust_scatter",
    Stage.ROTOR,
    [Param("deviation", "1", 0.0, (0.0, 0.5), "standard deviation of thrust over its mean", 0.1)],
    signature="a constant moment about a fixed body axis, another one for every set of propellers",
    separates_from={"weak_propeller": "exchange the propellers: scatter goes with them"},
)
def thrust_scatter(m: Array, noise: Array, deviation: float) -> None:
    """Scale each rotor by its own constant draw (paper, Table III: thrust deviation)."""
    for i in range(4):
        m[P.efficiency + i] *= max(0.2, 1.0 + deviation * m[P.draws + i])


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
def translational_lift(m: Array, noise: Array, k: float) -> None:
    """Scale thrust and torque by 1 + k v_h^2, v_h the airspeed in the disc plane, at least 0.2.

    A flow across a rotor lowers its induced velocity: more thrust at the same speed, at first with
    the square (momentum theory, Glauert; the k_h v_h^2 of Faessler et al. 2018).
    """
    r = P.rotation
    ax = m[P.body + 3] - m[P.wind]
    ay = m[P.body + 4] - m[P.wind + 1]
    az = m[P.body + 5] - m[P.wind + 2]
    u = m[r] * ax + m[r + 3] * ay + m[r + 6] * az
    v = m[r + 1] * ax + m[r + 4] * ay + m[r + 7] * az
    gain = max(0.2, 1.0 + k * (u * u + v * v))
    for i in range(4):
        m[P.efficiency + i] *= gain
