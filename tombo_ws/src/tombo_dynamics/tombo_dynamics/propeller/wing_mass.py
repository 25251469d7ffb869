"""Mass and centroid of what hangs on the nodus, wherever along the blade the nodus sits."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller.blade import shape, span_quadrature
from tombo_dynamics.propeller.records import Blade


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


def wing_mass_from(blade: Blade, root_m: ArrayLike) -> tuple[Array, Array]:
    """Return mass [kg] and centroid [m] of a wing that begins at `root_m` [m], any shape.

    The published mass and centroid belong to `joint.outer_radius_m`. From there they change as
    volume and centroid of the distribution depth x thickness do.
    """
    joint, tip = blade.joint, blade.pieces[-1].end_m
    volume, centroid, _ = volume_moments(blade, root_m, tip)
    own_volume, own_centroid, _ = volume_moments(blade, joint.outer_radius_m, tip)
    mass = joint.wing_mass_kg * volume / own_volume
    return mass, joint.wing_centroid_m + centroid - own_centroid
