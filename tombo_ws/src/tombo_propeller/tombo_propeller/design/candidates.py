"""All candidates: the soft propellers of the library, and a grid over the nodus' properties."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import product
from typing import TYPE_CHECKING

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller import Configuration, Nodus, nodus_moduli
from tombo_dynamics.propeller.moduli import volume_fraction
from tombo_propeller.design.nodus_placement import chord_m, with_nodus_at

if TYPE_CHECKING:
    from tombo_dynamics.propeller import Blade, Library

FIBRE_COUNTS = tuple(range(2, 11))
DIAMETERS_MM = (0.38, 0.5, 0.75, 0.9, 0.94, 1.2)
LENGTHS_MM = (6.0, 8.0, 10.0, 12.0, 14.0, 16.0, 20.0)
OUTER_RADII_MM = (30.0, 35.0, 40.0, 45.0, 50.0, 60.0)
_CLEARANCE = 2.0
"""Chord that each fibre takes, in diameters: the matrix has to come between them."""


@dataclass(frozen=True)
class TestedRange:
    """Ranges that soft propellers were measured in (Table III), lowest and highest."""

    E_N_MPa: tuple[float, float]
    G_N_MPa: tuple[float, float]
    fibre_share: tuple[float, float]
    length_mm: tuple[float, float]
    outer_radius_mm: tuple[float, float]

    def outside(self, configuration: Configuration) -> tuple[str, ...]:
        """Return in what a nodus is outside of what was tested, in words."""
        found = []
        for name, value in properties(configuration).items():
            low, high = getattr(self, name)
            slack = 1e-9 * abs(high)
            if not low - slack <= value <= high + slack:
                span = f"{low:.4g}" if low == high else f"{low:.4g} to {high:.4g}"
                found.append(f"{_WORDS[name]} {value:.4g}, tested {span}")
        return tuple(found)

    def distance(self, configuration: Configuration) -> float:
        """Return how far outside a nodus is: shares beyond the nearer end, summed; 0 inside."""
        total = 0.0
        for name, value in properties(configuration).items():
            low, high = getattr(self, name)
            beyond = max(low - value, value - high)
            total += beyond / high if beyond > 1e-9 * abs(high) else 0.0
        return total


_WORDS = {
    "E_N_MPa": "E_N [MPa]",
    "G_N_MPa": "G_N [MPa]",
    "fibre_share": "share of fibres in the section",
    "length_mm": "length [mm]",
    "outer_radius_mm": "outer end [mm]",
}


def properties(configuration: Configuration) -> dict[str, float]:
    """Return the properties of a nodus, by the names of `TestedRange`."""
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


def measured_soft(library: Library, blade: Blade) -> tuple[Configuration, ...]:
    """Return the soft propellers of a library with this blade that have a row in Table III.

    Raises:
        InputError: there is none.
    """
    found = tuple(
        c
        for c in library.configurations.values()
        if c.nodus and c.measured and c.blade.name == blade.name
    )
    if not found:
        raise InputError(
            f"blade {blade.name}: no measured soft propeller has it; accepted: a library whose "
            "measurements.yaml has one (for a new blade, measure one first)"
        )
    return found


def tested(measured: Iterable[Configuration]) -> TestedRange:
    """Return the ranges that measured propellers span."""
    rows = [properties(c) for c in measured]
    return TestedRange(
        **{name: (min(r[name] for r in rows), max(r[name] for r in rows)) for name in _WORDS}
    )


def candidates(library: Library, blade: Blade) -> list[Configuration]:
    """Return the library's soft propellers with a blade, then the grid without those.

    The grid: every matrix with every fibre, 2 to 10 fibres, six diameters, seven lengths, six
    places. Left out is what does not fit: a nodus off the blade, fibres too close to each other.
    """
    known = [c for c in library.configurations.values() if c.nodus and c.blade.name == blade.name]
    seen = {_key(c) for c in known}
    number = free_number(library)
    nodi = [c.nodus for c in known if c.nodus]
    lengths = sorted({*LENGTHS_MM, *(nodus.length_mm for nodus in nodi)})
    diameters = sorted({*DIAMETERS_MM, *(nodus.fibre_diameter_mm for nodus in nodi)})
    radii = sorted({*OUTER_RADII_MM, 1e3 * blade.joint.outer_radius_m})
    own_radius = blade.joint.outer_radius_m
    for radius in radii:
        outer = own_radius if abs(1e-3 * radius - own_radius) < 1e-9 else 1e-3 * radius
        for length in lengths:
            try:
                placed = with_nodus_at(blade, outer, 1e-3 * length)
            except InputError:
                continue
            room = 1e3 * chord_m(blade, outer - 0.5e-3 * length)
            for nodus in _nodi(library, length, room, diameters):
                made = Configuration(number, placed, nodus)
                if _key(made) not in seen:
                    known.append(made)
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


def short(configuration: Configuration) -> str:
    """Return a nodus in a few characters: matrix, fibres x diameter, from and to [mm]."""
    nodus = configuration.nodus
    if nodus is None:
        return "rigid"
    outer = 1e3 * configuration.blade.joint.outer_radius_m
    return (
        f"{nodus.matrix.name} {nodus.fibres}x{nodus.fibre_diameter_mm:g} "
        f"{outer - nodus.length_mm:g}-{outer:g}"
    )


def _nodi(
    library: Library, length_mm: float, room_mm: float, diameters: Sequence[float]
) -> Iterable[Nodus]:
    matrices, fibres = library.matrices.values(), library.fibres.values()
    for matrix, fibre, count, diameter in product(matrices, fibres, FIBRE_COUNTS, diameters):
        if _CLEARANCE * count * diameter <= room_mm:
            yield Nodus(matrix, fibre, count, diameter, length_mm)


def _key(configuration: Configuration) -> tuple[object, ...]:
    nodus = configuration.nodus
    assert nodus is not None
    return (
        nodus.matrix.name,
        nodus.fibre.name,
        nodus.fibres,
        nodus.fibre_diameter_mm,
        nodus.length_mm,
        round(configuration.blade.joint.outer_radius_m, 9),
    )
