"""What a rotor's thrust is off by: coefficient, one weak propeller, scatter of fabrication."""

from __future__ import annotations

from tombo_dynamics.effects.registry import Param, Stage, effect
from tombo_dynamics.plant import Array, P


@effect(
    "thrust_coefficient_error",
    Stage.ROTOR,
    [Param("fraction", "1", 0.0, (-0.6, 0.6), "true thrust over the map's, minus 1", -0.1)],
    signature="specific force along body z off by a factor of thrust",
    separates_from={"mass_error": "weigh the vehicle, or run a thrust stand"},
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
