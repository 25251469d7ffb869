"""Errors of air, blade and nodus: coefficients, stiffness, load."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects.registry import (
    DRAG,
    LIFT,
    TORQUE,
    Param,
    StandRun,
    StandStage,
    stand_effect,
)
from tombo_dynamics.propeller.laws.parameters import SCALARS

_RELATIVE = (-0.6, 1.5)


@stand_effect(
    "thrust_coefficient",
    StandStage.PROPELLER,
    [Param("error", "1", 0.0, _RELATIVE, "true over model, less 1", 0.10)],
    signature="thrust is off by a share at every speed, torque is not",
    separates_from={
        "thrust_gain": "hang a known weight on the cell",
        "air_density": "torque, or a barometer",
        "rpm_scale": "torque, or a second tachometer",
    },
)
def thrust_coefficient(m: StandRun, error: float) -> None:
    """Multiply the lift of every section, with its bending and twist."""
    if m.plain:
        m.rows[:, 0] *= 1.0 + error
        return
    m.rows[:, LIFT] *= 1.0 + error
    m.scale("inner_thrust", 1.0 + error)


@stand_effect(
    "drag_coefficient",
    StandStage.PROPELLER,
    [Param("error", "1", 0.0, _RELATIVE, "true over model, less 1", 0.15)],
    signature="torque is off by a share at every speed, thrust is nearly not",
    separates_from={"torque_gain": "apply a known torque with arm and weight"},
)
def drag_coefficient(m: StandRun, error: float) -> None:
    """Multiply the drag of every section, and with it the torque."""
    if m.plain:
        m.rows[:, 1] *= 1.0 + error
        return
    m.rows[:, DRAG] *= 1.0 + error
    m.rows[:, TORQUE] *= 1.0 + error
    m.scale("inner_drag", 1.0 + error)
    m.scale("inner_torque", 1.0 + error)


@stand_effect(
    "air_density",
    StandStage.PROPELLER,
    [Param("error", "1", 0.0, (-0.5, 0.5), "true over model, less 1", 0.08)],
    signature="thrust and torque are off by the same share at every speed",
    separates_from={
        "rpm_scale": "a second tachometer, or a barometer",
        "thrust_coefficient": "torque, or a barometer",
    },
)
def air_density(m: StandRun, error: float) -> None:
    """Multiply the density of the air."""
    if m.plain:
        m.rows *= 1.0 + error
    else:
        m.scale("air_density", 1.0 + error)


@stand_effect(
    "inflow",
    StandStage.PROPELLER,
    [Param("coefficient", "1", 0.0, (0.0, 2.0), "of momentum theory's induced speed", 0.4)],
    signature="less thrust by a share, more torque than the thrust's loss would leave",
    separates_from={
        "thrust_coefficient": "torque: inflow takes power",
        "torsion_constant": "a rigid propeller has inflow, but no twist",
    },
    models=("tombo",),
)
def inflow(m: StandRun, coefficient: float) -> None:
    """Turn the air down by the induced velocity of a uniform actuator disc."""
    m.inflow += coefficient


@stand_effect(
    "speed_exponent",
    StandStage.PROPELLER,
    [Param("change", "1", 0.0, (-1.0, 1.0), "added to 2 in T = k omega^2", 0.1)],
    signature="thrust over omega^2 rises or falls steadily with speed",
    separates_from={"thrust_tare": "readings at standstill before and after"},
    models=("plain",),
)
def speed_exponent(m: StandRun, change: float) -> None:
    """Let thrust and torque grow with another power than the square: Reynolds number, flexing."""
    m.exponent += change


@stand_effect(
    "fabrication_scatter",
    StandStage.PROPELLER,
    [
        Param("thrust", "1", 0.0, (0.0, 0.5), "standard deviation of the lift", 0.08),
        Param("torque", "1", 0.0, (0.0, 0.5), "standard deviation of the drag", 0.08),
    ],
    signature="each propeller is off by its own share at every speed, whatever its stiffness",
    separates_from={"thrust_coefficient": "more propellers of one configuration"},
    models=("tombo",),
    stochastic=True,
    healthy_spread=0.125,
)
def fabrication_scatter(m: StandRun, thrust: float, torque: float) -> None:
    """Make each propeller's lift and drag differ by chance."""
    lift = 1.0 + thrust * m.propeller_draws[:, 0]
    drag = 1.0 + torque * m.propeller_draws[:, 1]
    m.rows[:, LIFT] *= lift[:, None]
    m.rows[:, DRAG] *= drag[:, None]
    m.rows[:, TORQUE] *= drag[:, None]
    for name, factor in (("thrust", lift), ("drag", drag), ("torque", drag)):
        m.scale(f"inner_{name}", factor)


@stand_effect(
    "run_scatter",
    StandStage.LOAD,
    [
        Param("thrust", "1", 0.0, (0.0, 0.5), "standard deviation of thrust", 0.04),
        Param("torque", "1", 0.0, (0.0, 0.5), "standard deviation of torque", 0.04),
    ],
    signature="runs of one propeller differ by a share, the same at all speeds of a run",
    separates_from={
        "speed_noise": "two runs of one propeller at the same speeds",
        "fabrication_scatter": "the same propeller mounted again",
    },
    stochastic=True,
    healthy_spread=0.125,
)
def run_scatter(m: StandRun, thrust: float, torque: float) -> None:
    """Let each run be off by its own share: air of the day, mount, warmth of the motor."""
    m.thrust *= 1.0 + thrust * m.share_draws[:, 0]
    m.torque *= 1.0 + torque * m.share_draws[:, 1]


def shift_twist(weights: Array, rate: float, angle: Array) -> Array:
    """Return a wing's weights (N, 6) with the twist counted from `angle` (N,) [rad].

    The closed form of `wing` is closed under shifts of the twist.
    """
    s, c = np.sin(rate * angle)[:, None], np.cos(rate * angle)[:, None]
    inner = [
        np.column_stack([w[:, :1], w[:, 1:2] * c + w[:, 2:] * s, w[:, 2:] * c - w[:, 1:2] * s])
        for w in (weights[:, :3], weights[:, 3:])
    ]
    sine, cosine = np.sin(angle)[:, None], np.cos(angle)[:, None]
    even = cosine * inner[0] + sine * inner[1]
    odd = cosine * inner[1] - sine * inner[0]
    return np.column_stack([even, odd])


def turn_inflow(m: StandRun, thrust: Array, tip: float, radius: float) -> Array:
    """Turn the rows' weights by the inflow of a thrust; return the induced velocity [m/s].

    The angle is that at `radius`, uniform along the wing; the part inside of the nodus' end,
    2.6 % of the thrust, is left alone.
    """
    density = m.rows[:, SCALARS["air_density"]]
    area = np.pi * tip**2
    velocity = m.inflow * np.sqrt(np.maximum(thrust, 0.0) / (2.0 * density * area))
    angle = np.arctan2(velocity, np.maximum(m.speed, 1e-9) * radius)
    for part, rate in ((LIFT, "lift_rate"), (DRAG, "drag_rate"), (TORQUE, "drag_rate")):
        m.rows[:, part] = shift_twist(m.rows[:, part], float(m.rows[0, SCALARS[rate]]), angle)
    return np.asarray(velocity)


_TOMBO = ("tombo",)


@stand_effect(
    "centrifugal_stiffening",
    StandStage.PROPELLER,
    [
        Param(
            "moment",
            "kg m^2",
            0.0,
            (0.0, 2e-5),
            "twist stiffness per omega^2: the wing's propeller moment and the fibres' tension",
            4e-7,
        )
    ],
    signature="soft propellers keep their thrust at speed: the loss by twist stops growing",
    separates_from={
        "torsion_constant": "two speeds far apart: a constant acts at all of them alike",
        "in_plane_term": "a soft and a stiff nodus at high speed, with the flap angle",
    },
    models=_TOMBO,
    saturates=True,
)
def centrifugal_stiffening(m: StandRun, moment: float) -> None:
    """Stiffen the twist with omega^2: 1 / C = 1 / C_0 + moment omega^2."""
    compliance = m.rows[:, SCALARS["twist_compliance"]]
    m.scale("twist_compliance", 1.0 / (1.0 + compliance * moment * m.speed**2))


@stand_effect(
    "torsion_constant",
    StandStage.PROPELLER,
    [Param("factor", "1", 1.0, (0.02, 10.0), "true J over that of the model", 0.6)],
    signature="thrust falls short (or not) by twist, at every speed, most with soft nodi",
    separates_from={"load_sharing": "the flap angle: the load bends, the torsion constant not"},
    models=_TOMBO,
)
def torsion_constant(m: StandRun, factor: float) -> None:
    """Multiply the section's torsion constant J; the drawn camber line may be 13 times off."""
    m.scale("twist_compliance", 1.0 / factor)


@stand_effect(
    "load_sharing",
    StandStage.PROPELLER,
    [Param("share", "1", 1.0, (0.1, 2.0), "of both wings' load that a nodus carries", 0.5)],
    signature="flap, lag and twist are all smaller than the model's, thrust of soft ones higher",
    separates_from={"torsion_constant": "the flap angle"},
    models=_TOMBO,
)
def load_sharing(m: StandRun, share: float) -> None:
    """Let a nodus carry a share of the propeller's load: one of two wings carries half."""
    m.rows[:, LIFT] *= share
    m.rows[:, DRAG] *= share
    m.share *= share


@stand_effect(
    "in_plane_term",
    StandStage.PROPELLER,
    [Param("blend", "1", 0.0, (0.0, 1.0), "0: the law's own term, 1: the other law's", 1.0)],
    signature="no maximum of thrust: at high speed soft propellers gain against the law",
    separates_from={"centrifugal_stiffening": "thrust of a soft nodus towards its maximum"},
    models=_TOMBO,
)
def in_plane_term(m: StandRun, blend: float) -> None:
    """Move from one law's in-plane force in the twist to the other's (repaired, consistent)."""
    m.other_law += blend
