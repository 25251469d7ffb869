"""The blade along its span: shape, section coefficients, integrals, mass and moment of inertia.

Ten constants make thrust, drag and torque of the wing closed forms of its twist. A section at
pitch theta on a wing twisted by gamma meets the air at theta - gamma and carries

    dT ~ depth x^2 C_L(theta - gamma) cos(theta - gamma) / cos(theta) dx,   dD likewise with C_D,

and the torque has x^3. Theta stands inside sines, cosines and tan(theta) only, so the addition
theorems take gamma out of the integrals:

    f(gamma) = cos gamma (w0 + w1 cos n gamma + w2 sin n gamma)
             + sin gamma (w3 + w4 cos n gamma + w5 sin n gamma).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown
from tombo_dynamics.propeller.records import Blade, BladeSection


def shape(blade: Blade, x: Array) -> tuple[Array, Array]:
    """Return depth [m] (leading minus trailing edge) and pitch [rad] of sections at `x` [m].

    Args:
        blade: the blade.
        x: distances from the hub's centre, any shape; where two pieces join, the outer one counts.
    """
    x = np.asarray(x, dtype=float)
    depth: Any = np.polyval(blade.pieces[0].depth_m, x)
    pitch: Any = np.polyval(blade.pieces[0].pitch_deg, x)
    for piece in blade.pieces[1:]:
        outer = x >= piece.start_m
        depth = np.where(outer, np.polyval(piece.depth_m, x), depth)
        pitch = np.where(outer, np.polyval(piece.pitch_deg, x), pitch)
    return depth, np.radians(pitch)


def lift_coefficient(section: BladeSection, attack_rad: Array) -> Array:
    """Return C_L at angles of attack [rad]."""
    angle = section.lift_rate * attack_rad + np.radians(section.lift_phase_deg)
    return np.asarray(section.lift_mean + section.lift_swing * np.sin(angle))


def drag_coefficient(section: BladeSection, attack_rad: Array) -> Array:
    """Return C_D at angles of attack [rad]."""
    angle = section.drag_rate * attack_rad + np.radians(section.drag_phase_deg)
    return np.asarray(section.drag_mean + section.drag_swing * np.cos(angle))


@lru_cache(maxsize=4)
def _gauss(order: int) -> tuple[Array, Array]:
    nodes, weights = np.polynomial.legendre.leggauss(order)
    return nodes, weights


def span_quadrature(
    blade: Blade, start: ArrayLike, end: ArrayLike, order: int = 16
) -> tuple[Array, Array]:
    """Return Gauss-Legendre nodes [m] and weights [m] from `start` to `end`, piece by piece.

    16 points a piece integrate the blade's trigonometric functions to rounding.

    Args:
        blade: the blade.
        start: where the stretches begin [m], any shape; nodes and weights have it and one
            dimension more, the last.
        end: where they end [m], broadcast with `start`.
        order: points a piece; a piece that a stretch does not touch gets weights of zero.
    """
    nodes, weights = _gauss(order)
    xs: list[Array] = []
    ws: list[Array] = []
    for piece in blade.pieces:
        a = np.clip(np.asarray(start, dtype=float), piece.start_m, piece.end_m)[..., None]
        b = np.clip(np.asarray(end, dtype=float), piece.start_m, piece.end_m)[..., None]
        half = 0.5 * np.maximum(b - a, 0.0)
        xs.append(half * nodes + (a + half))
        ws.append(half * weights)
    return np.concatenate(xs, axis=-1), np.concatenate(ws, axis=-1)


def volume_moments(blade: Blade, start: ArrayLike, end: ArrayLike) -> tuple[Array, Array, Array]:
    """Return volume, centroid and mean square of the span over stretches, depth x thickness.

    Args:
        blade: the blade; its thickness is Table II's, constant beyond the ends of the table.
        start: where the stretches begin [m], any shape.
        end: where they end [m], broadcast with `start`.
    """
    x, weights = span_quadrature(blade, start, end, order=32)
    depth, _ = shape(blade, x)
    thickness = np.ones_like(x)
    if blade.thickness_at_m:
        thickness = np.interp(x, blade.thickness_at_m, np.asarray(blade.thickness_mm) * 1e-3)
    volume = weights * depth * thickness
    total = volume.sum(-1)
    return total, (volume * x).sum(-1) / total, (volume * x**2).sum(-1) / total


@dataclass(frozen=True, eq=False)
class Wing:
    """The integrals of a blade, without air density and speed; thrust is rho omega^2 times them.

    The whole two-bladed propeller is meant: the paper's Eq. 1 has rho where blade-element theory
    has rho / 2.
    """

    inner_thrust: Array
    """Rigid part inside of the nodus' outer end [m^4]."""
    inner_drag: Array
    """[m^4]."""
    inner_torque: Array
    """[m^5]."""
    lift: Array
    """(6,) weights of the wing's thrust [m^4]."""
    drag: Array
    """(6,) weights of the wing's drag [m^4]."""
    torque: Array
    """(6,) weights of the wing's torque [m^5]."""
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


def lift_weights(section: BladeSection, k: Array) -> Array:
    """Return the weights (..., 6) of lift-like integrals from the ten constants (..., 10)."""
    a, b = section.lift_mean, section.lift_swing
    return np.asarray(k[..., [0, 1, 2, 5, 6, 7]] * np.array([a, b, -b, a, b, -b]))


def drag_weights(section: BladeSection, k: Array) -> Array:
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


@lru_cache(maxsize=64)
def wing(blade: Blade) -> Wing:
    """Return the integrals of a blade, the wing beginning at the nodus' outer end."""
    root, tip = blade.joint.outer_radius_m, blade.pieces[-1].end_m
    second = wing_integrals(blade, 2, root, tip)
    third = wing_integrals(blade, 3, root, tip)
    stations: Array = np.linspace(root, tip, 201, dtype=np.float64)
    _, pitch = shape(blade, stations)
    inner = rigid_integrals(blade, blade.pieces[0].start_m, root)
    return Wing(
        *inner,
        lift=lift_weights(blade.section, second),
        drag=drag_weights(blade.section, second),
        torque=drag_weights(blade.section, third),
        twist_limit=pitch.min() - np.radians(blade.section.lowest_deg),
    )


BLADES = 2
BELL_MASS_KG = 0.025
"""Estimated, because: an X2212-class motor weighs about 57 g, its bell and magnets under half."""
BELL_RADIUS_M = 0.0125
"""Estimated, because: the bell's outer diameter is about 27.5 mm and its mass sits in the ring."""


@dataclass(frozen=True)
class RotorInertia:
    """Moment of inertia about the rotor's axis, by part [kg m^2]."""

    wings: float
    roots: float
    bell: float

    @property
    def total(self) -> float:
        """Sum of the parts [kg m^2]."""
        return self.wings + self.roots + self.bell


def rotor_inertia(blade: Blade) -> RotorInertia:
    """Estimate the rotor's moment of inertia about its axis.

    Wings: 2 m_w (x_c^2 + spread^2) with the published mass and centroid; the spread is that of
    depth times thickness (Table II, constant beyond its ends) along the span. That distribution
    puts the centroid of the nine-inch blade at 66.4 mm, the published one is 66.64 mm.
    Roots: the same mass per length carried on from the wing's root to the blade's start, at the
    wing's own density; the nodus' silicone is taken as heavy. The hub inside is neglected.
    Bell: a ring of BELL_MASS_KG at BELL_RADIUS_M.
    Folding moves the wings inwards and is not in it.

    Raises:
        InputError: no Blade.
    """
    if not isinstance(blade, Blade):
        raise InputError(
            f"blade {shown(blade)}; accepted: a Blade, such as configuration(13).blade or one of "
            "read_library().blades"
        )
    joint = blade.joint
    wing_mass, wing_centroid, wing_square = volume_moments(
        blade, joint.outer_radius_m, blade.pieces[-1].end_m
    )
    root_mass, _, root_square = volume_moments(
        blade, blade.pieces[0].start_m, joint.outer_radius_m
    )
    density = joint.wing_mass_kg / wing_mass
    spread = wing_square - wing_centroid**2
    return RotorInertia(
        wings=float(BLADES * joint.wing_mass_kg * (joint.wing_centroid_m**2 + spread)),
        roots=float(BLADES * density * root_mass * root_square),
        bell=BELL_MASS_KG * BELL_RADIUS_M**2,
    )
