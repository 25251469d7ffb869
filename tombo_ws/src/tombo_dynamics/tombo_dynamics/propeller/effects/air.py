"""What can be wrong with the air and the blade's coefficients."""

from __future__ import annotations

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.effects.registry import Param, Stage, stand_effect
from tombo_dynamics.propeller.effects.run_state import DRAG, LIFT, TORQUE, Run
from tombo_dynamics.propeller.laws.parameters import SCALARS

_RELATIVE = (-0.6, 1.5)


@stand_effect(
    "thrust_coefficient",
    Stage.PROPELLER,
    [Param("error", "1", 0.0, _RELATIVE, "true over model, less 1", 0.10)],
    signature="thrust is off by a share at every speed, torque is not",
    separates_from={
        "thrust_gain": "hang a known weight on the cell",
        "air_density": "torque, or a barometer",
        "rpm_scale": "torque, or a second tachometer",
    },
)
def thrust_coefficient(m: Run, error: float) -> None:
    """Multiply the lift of every section, and what it bends and twists."""
    if m.plain:
        m.rows[:, 0] *= 1.0 + error
        return
    m.rows[:, LIFT] *= 1.0 + error
    m.scale("inner_thrust", 1.0 + error)


@stand_effect(
    "drag_coefficient",
    Stage.PROPELLER,
    [Param("error", "1", 0.0, _RELATIVE, "true over model, less 1", 0.15)],
    signature="torque is off by a share at every speed, thrust is nearly not",
    separates_from={"torque_gain": "apply a known torque with arm and weight"},
)
def drag_coefficient(m: Run, error: float) -> None:
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
    Stage.PROPELLER,
    [Param("error", "1", 0.0, (-0.5, 0.5), "true over model, less 1", 0.08)],
    signature="thrust and torque are off by the same share at every speed",
    separates_from={
        "rpm_scale": "a second tachometer, or a barometer",
        "thrust_coefficient": "torque, or a barometer",
    },
)
def air_density(m: Run, error: float) -> None:
    """Multiply the density of the air."""
    if m.plain:
        m.rows *= 1.0 + error
    else:
        m.scale("air_density", 1.0 + error)


@stand_effect(
    "inflow",
    Stage.PROPELLER,
    [Param("coefficient", "1", 0.0, (0.0, 2.0), "of momentum theory's induced speed", 0.4)],
    signature="less thrust by a share, more torque than the thrust's loss would leave",
    separates_from={
        "thrust_coefficient": "torque: inflow takes power",
        "torsion_constant": "a rigid propeller has inflow, but no twist",
    },
    models=("tombo",),
)
def inflow(m: Run, coefficient: float) -> None:
    """Turn the air down by the induced velocity of a uniform actuator disc."""
    m.inflow += coefficient


@stand_effect(
    "speed_exponent",
    Stage.PROPELLER,
    [Param("change", "1", 0.0, (-1.0, 1.0), "added to 2 in T = k omega^2", 0.1)],
    signature="thrust over omega^2 rises or falls steadily with speed",
    separates_from={"thrust_tare": "readings at standstill before and after"},
    models=("plain",),
)
def speed_exponent(m: Run, change: float) -> None:
    """Let thrust and torque grow with another power than the square: Reynolds number, flexing."""
    m.exponent += change


@stand_effect(
    "fabrication_scatter",
    Stage.PROPELLER,
    [
        Param("thrust", "1", 0.0, (0.0, 0.5), "standard deviation of the lift", 0.08),
        Param("torque", "1", 0.0, (0.0, 0.5), "standard deviation of the drag", 0.08),
    ],
    signature="each propeller is off by its own share at every speed, whatever its stiffness",
    separates_from={"thrust_coefficient": "more propellers of one configuration"},
    models=("tombo",),
    stochastic=True,
)
def fabrication_scatter(m: Run, thrust: float, torque: float) -> None:
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
    Stage.LOAD,
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
)
def run_scatter(m: Run, thrust: float, torque: float) -> None:
    """Let each run be off by its own share: air of the day, mount, warmth of the motor."""
    m.thrust *= 1.0 + thrust * m.share_draws[:, 0]
    m.torque *= 1.0 + torque * m.share_draws[:, 1]


def turned(weights: Array, rate: float, angle: Array) -> Array:
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


def turn_inflow(m: Run, thrust: Array, tip: float, radius: float) -> Array:
    """Turn the rows' weights by the inflow of a thrust; return the induced velocity [m/s].

    The angle is that at `radius`, uniform along the wing; the part inside of the nodus' end,
    2.6 % of the thrust, is left alone.
    """
    density = m.rows[:, SCALARS["air_density"]]
    area = np.pi * tip**2
    velocity = m.inflow * np.sqrt(np.maximum(thrust, 0.0) / (2.0 * density * area))
    angle = np.arctan2(velocity, np.maximum(m.speed, 1e-9) * radius)
    for part, rate in ((LIFT, "lift_rate"), (DRAG, "drag_rate"), (TORQUE, "drag_rate")):
        m.rows[:, part] = turned(m.rows[:, part], float(m.rows[0, SCALARS[rate]]), angle)
    return np.asarray(velocity)
