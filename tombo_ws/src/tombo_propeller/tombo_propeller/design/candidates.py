"""All candidates: the soft propellers of the library, and a grid over the nodus' properties.

Other lengths and places of the nodus have not been tried. The section scales with the blade at the
nodus. Mass and centroid of the wing are those of the blade outside of it.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import product

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import Blade, Configuration, Library, Nodus, nodus_moduli
from tombo_dynamics.propeller.blade import shape, volume_moments
from tombo_dynamics.propeller.nodus import volume_fraction

FIBRE_COUNTS = tuple(range(2, 11))
DIAMETERS_MM = (0.38, 0.5, 0.75, 0.9, 0.94, 1.2)
LENGTHS_MM = (6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 20.0)
OUTER_RADII_MM = (30.0, 35.0, 40.0, 45.0, 50.0, 60.0)
_GRID_TIP_RADIUS_M = 0.1111
"""Tip radius of the blade that these lengths and places are for."""
_CLEARANCE = 2.0
"""Chord that each fibre takes, in diameters: the matrix has to come between them."""
REFERENCE_LENGTH_M = 0.012
"""Length of the nodus that a blade's joint data belong to."""
_LEAST_WING_M = 0.02


PROPERTIES = {
    "E_N_MPa": "E_N [MPa]",
    "G_N_MPa": "G_N [MPa]",
    "fibre_share": "share of fibres in the section",
    "length_mm": "length [mm]",
    "outer_radius_mm": "outer end [mm]",
}
"""Quantities by which a nodus is compared with the tested ones."""


def properties(configuration: Configuration) -> dict[str, float]:
    """Return the properties of a nodus, by the names of `PROPERTIES`."""
    nodus = configuration.nodus
    assert nodus is not None
    moduli = nodus_moduli(configuration)
    area = configuration.blade.joint.section_area_mm2
    return {
        "E_N_MPa": moduli.E_N_MPa,
        "G_N_MPa": moduli.G_N_MPa,
        "fibre_share": float(volume_fraction(nodus.fibres, nodus.fibre_diameter_mm, area)),
        "length_mm": nodus.length_mm,
        "outer_radius_mm": 1e3 * configuration.blade.joint.outer_radius_m,
    }


def measured_soft(
    library: Library, blade: Blade, other_blades: bool = False
) -> tuple[Configuration, ...]:
    """Return the soft propellers of a library with this blade that have a row in Table III.

    Args:
        library: of the configurations.
        blade: of the propellers.
        other_blades: take those of other blades where there is none with this one.

    Raises:
        InputError: there is none.
    """
    soft = [c for c in library.configurations.values() if c.nodus and c.measured]
    measured = [c for c in soft if c.blade.name == blade.name]
    if not measured and other_blades:
        measured = soft
    if not measured:
        raise InputError(
            f"blade {blade.name}: no measured soft propeller has it; accepted: a library whose "
            "measurements.yaml has one (for a new blade, measure one first), or --extrapolate, "
            "which takes the readings of other blades"
        )
    return tuple(measured)


def candidates(library: Library, blade: Blade) -> list[Configuration]:
    """Return the library's soft propellers with a blade, then the grid without those.

    The grid: every matrix with every fibre, 2 to 10 fibres, six diameters, seven lengths, six
    places; lengths and places go with the size of the blade. Left out is what does not fit: a
    nodus off the blade, fibres too close to each other.
    """
    known = [c for c in library.configurations.values() if c.nodus and c.blade.name == blade.name]
    seen = {_key(c) for c in known}
    number = free_number(library)
    nodi = [c.nodus for c in known if c.nodus]
    size = blade.tip_radius_m / _GRID_TIP_RADIUS_M
    lengths = {*(round(x * size, 1) for x in LENGTHS_MM), *(nodus.length_mm for nodus in nodi)}
    diameters = sorted({*DIAMETERS_MM, *(nodus.fibre_diameter_mm for nodus in nodi)})
    own_m = blade.joint.outer_radius_m
    radii = {*(round(x * size, 1) for x in OUTER_RADII_MM), 1e3 * own_m}
    for radius, length in product(sorted(radii), sorted(lengths)):
        outer = own_m if abs(1e-3 * radius - own_m) < 1e-9 else 1e-3 * radius
        try:
            placed = with_nodus_at(blade, outer, 1e-3 * length)
        except InputError:
            continue
        room = 1e3 * _section(blade, outer - 0.5e-3 * length)[0]
        made = (Configuration(number, placed, n) for n in _nodi(library, length, room, diameters))
        known += [candidate for candidate in made if _key(candidate) not in seen]
    return known


def free_number(library: Library) -> int:
    """Return a number for a configuration that no other one of the library has."""
    return max(19, *library.configurations) + 1


def describe(configuration: Configuration) -> str:
    """Return a nodus in words."""
    nodus = configuration.nodus
    if nodus is None:
        return "rigid"
    outer = 1e3 * configuration.blade.joint.outer_radius_m
    return (
        f"{nodus.matrix.name}, {nodus.fibres} {nodus.fibre.name} fibres of "
        f"{nodus.fibre_diameter_mm:g} mm, {nodus.length_mm:g} mm long, "
        f"{outer - nodus.length_mm:g} to {outer:g} mm from the hub's centre"
    )


def _nodi(
    library: Library, length_mm: float, room_mm: float, diameters: Sequence[float]
) -> Iterable[Nodus]:
    matrices, fibres = library.matrices.values(), library.fibres.values()
    for matrix, fibre, count, diameter in product(matrices, fibres, FIBRE_COUNTS, diameters):
        if _CLEARANCE * count * diameter <= room_mm:
            yield Nodus(matrix, fibre, count, diameter, length_mm)


def _key(configuration: Configuration) -> tuple[Nodus | None, float]:
    return configuration.nodus, round(configuration.blade.joint.outer_radius_m, 9)


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
    volume, centroid, _ = volume_moments(blade, outer_radius_m, end)
    own_volume, own_centroid, _ = volume_moments(blade, joint.outer_radius_m, end)
    moved = dataclasses.replace(
        joint,
        outer_radius_m=outer_radius_m,
        section_area_mm2=joint.section_area_mm2 * chord * thickness,
        flap_second_moment_mm4=joint.flap_second_moment_mm4 * chord * thickness**3,
        lag_second_moment_mm4=joint.lag_second_moment_mm4 * chord**3 * thickness,
        torsion_constant_m4=joint.torsion_constant_m4 * chord * thickness**3,
        wing_mass_kg=float(joint.wing_mass_kg * volume / own_volume),
        wing_centroid_m=float(joint.wing_centroid_m * centroid / own_centroid),
    )
    name = f"{blade.name}_{1e3 * inner:g}_{1e3 * outer_radius_m:g}mm"
    return dataclasses.replace(blade, name=name, joint=moved, published=None)


def _section(blade: Blade, x_m: float) -> tuple[float, float]:
    """Return chord [m] and thickness [mm, or 1 where it is not known]."""
    depth, pitch = shape(blade, np.array([x_m]))
    thickness = 1.0
    if blade.thickness_at_m:
        thickness = float(np.interp(x_m, blade.thickness_at_m, blade.thickness_mm))
    return float(depth[0]) / math.cos(float(pitch[0])), thickness
