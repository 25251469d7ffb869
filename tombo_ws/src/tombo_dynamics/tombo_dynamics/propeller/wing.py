"""Integrals over the wing: ten constants make thrust, drag and torque closed forms of the twist.

A section at pitch theta on a wing twisted by gamma meets the air at theta - gamma and carries

    dT ~ depth x^2 C_L(theta - gamma) cos(theta - gamma) / cos(theta) dx,   dD likewise with C_D,

and the torque has x^3. Theta stands inside sines, cosines and tan(theta) only, so the addition
theorems take gamma out of the integrals:

    f(gamma) = cos gamma (w0 + w1 cos n gamma + w2 sin n gamma)
             + sin gamma (w3 + w4 cos n gamma + w5 sin n gamma).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.propeller.blade import drag_coefficient, lift_coefficient, shape, span_rule
from tombo_dynamics.propeller.records import Blade, Section

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Wing:
    """The integrals of a blade, without air density and speed; thrust is rho omega^2 times them.

    The whole two-bladed propeller is meant: the paper's Eq. 1 has rho where blade-element theory
    has rho / 2.
    """

    inner_thrust: float
    """Rigid part inside of the nodus' outer end [m^4]."""
    inner_drag: float
    """[m^4]."""
    inner_torque: float
    """[m^5]."""
    lift: Array
    """(6,) weights of the wing's thrust [m^4]."""
    drag: Array
    """(6,) weights of the wing's drag [m^4]."""
    torque: Array
    """(6,) weights of the wing's torque [m^5]."""
    twist_limit: float
    """Highest twist [rad]: beyond it some section leaves the coefficients' measured range."""


def ten_constants(blade: Blade, power: int, start: float, end: float) -> Array:
    """Return the integrals of depth x^power times ten functions of the pitch, (10,).

    The functions: 1, sin and cos of the lift's angle, cos and sin of the drag's angle, then the
    same five times tan(theta). Limits in metres.
    """
    x, weights = span_rule(blade, start, end)
    depth, pitch = shape(blade, x)
    lift = blade.section.lift_rate * pitch + np.radians(blade.section.lift_phase_deg)
    drag = blade.section.drag_rate * pitch + np.radians(blade.section.drag_phase_deg)
    five = np.stack([np.ones_like(x), np.sin(lift), np.cos(lift), np.cos(drag), np.sin(drag)])
    both = np.concatenate([five, five * np.tan(pitch)])
    return np.asarray(both @ (weights * depth * x**power), dtype=float)


def lift_weights(section: Section, k: Array) -> Array:
    """Return the weights (6,) of lift-like integrals from the ten constants."""
    a, b = section.lift_mean, section.lift_swing
    return np.array([a * k[0], b * k[1], -b * k[2], a * k[5], b * k[6], -b * k[7]])


def drag_weights(section: Section, k: Array) -> Array:
    """Return the weights (6,) of drag-like integrals from the ten constants."""
    a, b = section.drag_mean, section.drag_swing
    return np.array([a * k[0], b * k[3], b * k[4], a * k[5], b * k[8], b * k[9]])


def rigid_integrals(blade: Blade, start: float, end: float) -> tuple[float, float, float]:
    """Return the untwisted integrals of thrust [m^4], drag [m^4] and torque [m^5]."""
    x, weights = span_rule(blade, start, end)
    depth, pitch = shape(blade, x)
    load = weights * depth * x**2
    lift = lift_coefficient(blade.section, pitch)
    drag = drag_coefficient(blade.section, pitch)
    return float(load @ lift), float(load @ drag), float((load * x) @ drag)


@lru_cache(maxsize=64)
def wing(blade: Blade) -> Wing:
    """Return the integrals of a blade, the wing beginning at the nodus' outer end."""
    root, tip = blade.joint.outer_radius_m, blade.pieces[-1].end_m
    second = ten_constants(blade, 2, root, tip)
    third = ten_constants(blade, 3, root, tip)
    _, pitch = shape(blade, np.linspace(root, tip, 201, dtype=np.float64))
    inner = rigid_integrals(blade, blade.pieces[0].start_m, root)
    return Wing(
        *inner,
        lift=lift_weights(blade.section, second),
        drag=drag_weights(blade.section, second),
        torque=drag_weights(blade.section, third),
        twist_limit=float(pitch.min() - np.radians(blade.section.lowest_deg)),
    )
