"""A nodus of another length, at another place of the blade: what changes in the joint.

Nobody has tried either. The section is taken to scale with the blade where the nodus sits, the
wing's mass and centroid are those of what is left outside of it.
"""

from __future__ import annotations

import dataclasses
import math
from functools import lru_cache

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import Blade
from tombo_dynamics.propeller.blade import shape, span_quadrature

REFERENCE_LENGTH_M = 0.012
"""Length of the nodus that a blade's joint data belong to."""
_LEAST_WING_M = 0.02


@lru_cache(maxsize=256)
def with_nodus_at(blade: Blade, outer_radius_m: float, length_m: float) -> Blade:
    """Return the blade with its nodus elsewhere or of another length; unchanged for its own.

    At the middle of the nodus the chord c and the thickness t differ from those of the blade's own
    nodus. A_N goes with c t, I_f and J with c t^3, I_l with c^3 t; the wing's mass and centroid
    are in the ratio of the volumes (depth times thickness) outside of the nodus. The arms dy, dz
    and the offsets of the centroid stay: nothing says how they change.

    Args:
        blade: its joint data belong to a nodus of REFERENCE_LENGTH_M.
        outer_radius_m: where the wing begins [m].
        length_m: length of the nodus [m].

    Raises:
        InputError: the nodus does not fit on the blade.
    """
    start, end = blade.pieces[0].start_m, blade.pieces[-1].end_m
    inner = outer_radius_m - length_m
    if inner < start - 1e-12 or outer_radius_m > end - _LEAST_WING_M:
        raise InputError(
            f"nodus from {1e3 * inner:g} to {1e3 * outer_radius_m:g} mm on blade {blade.name}; "
            f"accepted: between {1e3 * start:g} and {1e3 * (end - _LEAST_WING_M):g} mm"
        )
    joint = blade.joint
    same = outer_radius_m == joint.outer_radius_m and length_m == REFERENCE_LENGTH_M
    if same:
        return blade
    own = joint.outer_radius_m - 0.5 * REFERENCE_LENGTH_M
    chord, thickness = (
        here / there
        for here, there in zip(
            _section(blade, outer_radius_m - 0.5 * length_m), _section(blade, own), strict=True
        )
    )
    volume, centroid = _volume(blade, outer_radius_m)
    own_volume, own_centroid = _volume(blade, joint.outer_radius_m)
    moved = dataclasses.replace(
        joint,
        outer_radius_m=outer_radius_m,
        section_area_mm2=joint.section_area_mm2 * chord * thickness,
        flap_second_moment_mm4=joint.flap_second_moment_mm4 * chord * thickness**3,
        lag_second_moment_mm4=joint.lag_second_moment_mm4 * chord**3 * thickness,
        torsion_constant_m4=joint.torsion_constant_m4 * chord * thickness**3,
        wing_mass_kg=joint.wing_mass_kg * volume / own_volume,
        wing_centroid_m=joint.wing_centroid_m * centroid / own_centroid,
    )
    name = f"{blade.name}_{1e3 * inner:g}_{1e3 * outer_radius_m:g}mm"
    return dataclasses.replace(blade, name=name, joint=moved, published=None)


def chord_m(blade: Blade, x_m: float) -> float:
    """Return the chord [m] at a distance [m] from the hub's centre."""
    return _section(blade, x_m)[0]


def _section(blade: Blade, x_m: float) -> tuple[float, float]:
    """Return chord [m] and thickness [mm, or 1 where it is not known]."""
    depth, pitch = shape(blade, np.array([x_m]))
    thickness = 1.0
    if blade.thickness_at_m:
        thickness = float(np.interp(x_m, blade.thickness_at_m, blade.thickness_mm))
    return float(depth[0]) / math.cos(float(pitch[0])), thickness


def _volume(blade: Blade, start_m: float) -> tuple[float, float]:
    """Return depth times thickness outside of a radius, and its centroid [m]."""
    x, weights = span_quadrature(blade, start_m, blade.pieces[-1].end_m, order=32)
    depth, _ = shape(blade, x)
    thickness = np.ones_like(x)
    if blade.thickness_at_m:
        thickness = np.interp(x, blade.thickness_at_m, np.asarray(blade.thickness_mm))
    density = weights * depth * thickness
    total = float(density.sum())
    return total, float(density @ x) / total
