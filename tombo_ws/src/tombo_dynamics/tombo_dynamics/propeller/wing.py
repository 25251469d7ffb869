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
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.blade import (
    drag_coefficient,
    lift_coefficient,
    shape,
    span_quadrature,
)
from tombo_dynamics.propeller.records import Blade, Section


@dataclass(frozen=True, eq=False)
class Wing:
    """The integrals of a blade, without air density and speed; thrust is rho omega^2 times them.

    The whole two-bladed propeller is meant: the paper's Eq. 1 has rho where blade-element theory
    has rho / 2. Leading dimensions are those of the radii that the wing was asked to begin at.
    """

    inner_thrust: Array
    """Rigid part inside of the nodus' outer end [m^4]."""
    inner_drag: Array
    """[m^4]."""
    inner_torque: Array
    """[m^5]."""
    lift: Array
    """(..., 6) weights of the wing's thrust [m^4]."""
    drag: Array
    """(..., 6) weights of the wing's drag [m^4]."""
    torque: Array
    """(..., 6) weights of the wing's torque [m^5]."""
    twist_limit: Array
    """Highest twist [rad]: beyond it some section leaves the coefficients' measured range."""


def wing_integrals(blade: Blade, power: int, start: ArrayLike, end: ArrayLike) -> Array:
    """Return the integrals of depth x^power times ten functions of the pitch, (..., 10).

    The functions: 1, sin and cos of the lift's angle, cos and sin of the drag's angle, then the
    same five times tan(theta). Limits in metres.
    """
    x, weights = span_quadrature(blade, start, end)
    depth, pitch = shape(blade, x)
    lift = blade.section.lift_rate * pitch + np.radians(blade.section.lift_phase_deg)
    drag = blade.section.drag_rate * pitch + np.radians(blade.section.drag_phase_deg)
    five = np.stack([np.ones_like(x), np.sin(lift), np.cos(lift), np.cos(drag), np.sin(drag)])
    both = np.concatenate([five, five * np.tan(pitch)])
    return np.asarray(np.einsum("k...m,...m->...k", both, weights * depth * x**power))


def lift_weights(section: Section, k: Array) -> Array:
    """Return the weights (..., 6) of lift-like integrals from the ten constants (..., 10)."""
    a, b = section.lift_mean, section.lift_swing
    return np.asarray(k[..., [0, 1, 2, 5, 6, 7]] * np.array([a, b, -b, a, b, -b]))


def drag_weights(section: Section, k: Array) -> Array:
    """Return the weights (..., 6) of drag-like integrals from the ten constants (..., 10)."""
    a, b = section.drag_mean, section.drag_swing
    return np.asarray(k[..., [0, 3, 4, 5, 8, 9]] * np.array([a, b, b, a, b, b]))


def rigid_integrals(blade: Blade, start: ArrayLike, end: ArrayLike) -> tuple[Array, Array, Array]:
    """Return the untwisted integrals of thrust [m^4], drag [m^4] and torque [m^5]."""
    x, weights = span_quadrature(blade, start, end)
    depth, pitch = shape(blade, x)
    load = weights * depth * x**2
    lift = lift_coefficient(blade.section, pitch)
    drag = drag_coefficient(blade.section, pitch)
    return (load * lift).sum(-1), (load * drag).sum(-1), (load * x * drag).sum(-1)


def wing_from(blade: Blade, root_m: ArrayLike) -> Wing:
    """Return the integrals of a blade whose wing begins at `root_m` [m], any shape."""
    root, tip = np.asarray(root_m, dtype=float), blade.pieces[-1].end_m
    second = wing_integrals(blade, 2, root, tip)
    third = wing_integrals(blade, 3, root, tip)
    _, pitch = shape(blade, np.linspace(root, tip, 201, axis=-1))
    inner = rigid_integrals(blade, blade.pieces[0].start_m, root)
    return Wing(
        *inner,
        lift=lift_weights(blade.section, second),
        drag=drag_weights(blade.section, second),
        torque=drag_weights(blade.section, third),
        twist_limit=pitch.min(-1) - np.radians(blade.section.lowest_deg),
    )


@lru_cache(maxsize=64)
def wing(blade: Blade) -> Wing:
    """Return the integrals of a blade, the wing beginning at the nodus' outer end."""
    return wing_from(blade, blade.joint.outer_radius_m)
