"""The quantities a propeller is described by, and how the laws' numbers follow from them.

A formula is written once, elementwise: for one propeller and for a million at a time. Which
quantity has an effect under which law follows from the formulas, too. The elastic moduli of the
nodus are Chamis' rule of mixtures, the paper's Eq. 2.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.library import known_configuration
from tombo_dynamics.propeller.records import (
    STANDARD,
    Configuration,
    Fibre,
    Joint,
    Matrix,
    Nodus,
    PublishedTorsion,
    Surroundings,
)


@dataclass(frozen=True)
class Moduli:
    """Moduli of the nodus across its fibres."""

    E_N_MPa: float
    G_N_MPa: float


@lru_cache(maxsize=64)
def matrix_modulus(matrix: Matrix) -> float:
    """Return Young's modulus of a matrix at zero strain [MPa].

    The least-squares cubic through the secant moduli, read at zero strain (authors' program).
    """
    powers = np.vander(np.asarray(matrix.strain_percent, dtype=float), 4, increasing=True)
    fit = np.linalg.lstsq(powers, np.asarray(matrix.secant_modulus_MPa, dtype=float), rcond=None)
    return float(fit[0][0])


def chamis(matrix: Any, fibre: Any, volume_fraction: Any) -> Any:
    """Mix two moduli, paper's Eq. 2: E = E_m / (1 - sqrt(v_f) (1 - E_m / E_f)).

    Args:
        matrix: modulus of the matrix, any unit, any shape; the three broadcast.
        fibre: modulus of the fibres, same unit.
        volume_fraction: share of the section that is fibre, 0 to below 1.
    """
    return matrix / (1.0 - np.sqrt(volume_fraction) * (1.0 - matrix / fibre))


def volume_fraction(fibres: ArrayLike, diameter_mm: ArrayLike, area_mm2: ArrayLike) -> Any:
    """Return the share of the nodus' section that is fibre, n pi d^2 / 4 / A_N; all broadcast.

    Raises:
        InputError: the fibres fill the section.
    """
    n, d, area = np.broadcast_arrays(fibres, diameter_mm, area_mm2)
    share = n * np.pi * d**2 / 4.0 / area
    if (share >= 1.0).any():
        i = int(np.argmax(share))
        raise InputError(
            f"{n.flat[i]:g} fibres of {d.flat[i]:g} mm fill the nodus' section of "
            f"{area.flat[i]:g} mm^2; accepted: less fibre than section"
        )
    return share


def shear_modulus(youngs_modulus: Any, poisson_ratio: Any) -> Any:
    """Return the shear modulus of an isotropic matrix, E / (2 (1 + nu)); both broadcast."""
    return youngs_modulus / (2.0 * (1.0 + poisson_ratio))


Formula = tuple[Callable[..., Any], tuple[str, ...]]
"""A function of quantities, and which ones."""

_ANY = 1e12


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A quantity that may be given by name: unit, bounds, and whether it is a count."""

    unit: str
    bounds: tuple[float, float]
    whole: bool = False


def _fields(record: Any, prefix: str = "") -> dict[str, Quantity]:
    """Return the numeric fields of a record as quantities."""
    return {
        prefix + f.name: Quantity(f.metadata["unit"], f.metadata["bounds"], f.type == "int")
        for f in dataclasses.fields(record)
        if f.metadata and not str(f.type).startswith("tuple")
    }


_MODULUS = Quantity("MPa", (1e-6, 1e7))
_COMPLIANCE = (0.0, 1e12)
INPUTS: dict[str, Quantity] = {
    **_fields(Nodus),
    **_fields(Matrix),
    "matrix_modulus_MPa": _MODULUS,
    **_fields(Fibre, "fibre_"),
    **_fields(Joint),
    **_fields(Surroundings),
    **_fields(PublishedTorsion),
}
"""Fields of the records, with the modulus of the matrix in place of its tensile test."""

DERIVED: dict[str, Quantity] = {
    "E_N_MPa": _MODULUS,
    "G_N_MPa": _MODULUS,
    "air_density": Quantity("kg/m^3", (0.01, 2000.0)),
    "wing_weight": Quantity("N", (0.0, 1e3)),
    "centrifugal": Quantity("kg m", (0.0, 1e3)),
    "flap_compliance": Quantity("rad/N", _COMPLIANCE),
    "lag_compliance": Quantity("rad/N", _COMPLIANCE),
    "twist_compliance": Quantity("rad/(N m)", _COMPLIANCE),
    "joint_radius": Quantity("m", (1e-3, 1.0)),
    "wing_centroid": Quantity("m", (1e-3, 1.0)),
    "flap_offset": Quantity("rad", (-1.0, 1.0)),
    "lag_offset": Quantity("rad", (-1.0, 1.0)),
    "lift_arm": Quantity("m", (-0.1, 0.1)),
    "drag_arm": Quantity("m", (-0.1, 0.1)),
    "twist_limit": Quantity("rad", (-1.5, 1.5)),
    "inner_thrust": Quantity("m^4", (-_ANY, _ANY)),
    "inner_drag": Quantity("m^4", (-_ANY, _ANY)),
    "inner_torque": Quantity("m^5", (-_ANY, _ANY)),
    "lift_rate": Quantity("1", (0.1, 10.0)),
    "drag_rate": Quantity("1", (0.1, 10.0)),
}
"""Quantities that follow from the inputs, and may replace them: `laws.parameters.SCALARS`."""

QUANTITIES = INPUTS | DERIVED


def _slender(term: Any, area_mm2: Any, length_mm: Any) -> Any:
    """Return 1 + 4 F / (3 A U^2), the authors' torsion constant over F / 3."""
    return 1.0 + 4.0 * term / (3.0 * area_mm2 * 1e-6 * (length_mm * 1e-3) ** 2)


def _bending(length_mm: Any, modulus_MPa: Any, moment_mm4: Any) -> Any:
    """Return L^2 / (2 E_N I) [rad/N]."""
    return (length_mm * 1e-3) ** 2 / (2.0 * modulus_MPa * 1e6) / (moment_mm4 * 1e-12)


def _same(value: Any) -> Any:
    return value


def _milli(value: Any) -> Any:
    return value * 1e-3


_SHARE = (volume_fraction, ("fibres", "fibre_diameter_mm", "section_area_mm2"))
_FORMULAS: dict[str, Formula] = {
    "fibre_share": _SHARE,
    "matrix_shear_MPa": (shear_modulus, ("matrix_modulus_MPa", "poisson_ratio")),
    "E_N_MPa": (chamis, ("matrix_modulus_MPa", "fibre_youngs_modulus_MPa", "fibre_share")),
    "G_N_MPa": (chamis, ("matrix_shear_MPa", "fibre_shear_modulus_MPa", "fibre_share")),
    "flap_compliance": (_bending, ("length_mm", "E_N_MPa", "flap_second_moment_mm4")),
    "lag_compliance": (_bending, ("length_mm", "E_N_MPa", "lag_second_moment_mm4")),
    "twist_compliance": (
        lambda length_mm, shear_MPa, constant_m4: length_mm * 1e-9 / (shear_MPa * constant_m4),
        ("length_mm", "G_N_MPa", "torsion_constant_m4"),
    ),
    "air_density": (_same, ("air_density_kg_m3",)),
    "wing_weight": (lambda mass, gravity: mass * gravity, ("wing_mass_kg", "gravity_m_s2")),
    "centrifugal": (
        lambda mass, centroid: mass * centroid / 4.0,
        ("wing_mass_kg", "wing_centroid_m"),
    ),
    "joint_radius": (_same, ("outer_radius_m",)),
    "wing_centroid": (_same, ("wing_centroid_m",)),
    "flap_offset": (_same, ("flap_offset_rad",)),
    "lag_offset": (_same, ("lag_offset_rad",)),
    "lift_arm": (_milli, ("lift_arm_mm",)),
    "drag_arm": (_milli, ("drag_arm_mm",)),
}
_PUBLISHED: dict[str, Formula] = {
    **_FORMULAS,
    "fibre_share": (volume_fraction, ("fibre_count", *_SHARE[1][1:])),
    "published_fibre_shear_MPa": (np.divide, ("fibre_youngs_modulus_MPa", "fibre_modulus_ratio")),
    "G_N_MPa": (chamis, ("matrix_shear_MPa", "published_fibre_shear_MPa", "fibre_share")),
    "slender": (_slender, ("torsion_term_m4", "torsion_area_mm2", "camber_length_mm")),
    "twist_compliance": (
        lambda slender, length_mm, shear_MPa, term_m4: (
            3.0 * slender * length_mm * 1e-9 / (shear_MPa * term_m4)
        ),
        ("slender", "length_mm", "G_N_MPa", "torsion_term_m4"),
    ),
}
COMPLIANCES = ("flap_compliance", "lag_compliance", "twist_compliance")
"""All zero: a rigid propeller."""


def formulas(law: str) -> Mapping[str, Formula]:
    """Return how a law's numbers follow from the inputs."""
    return _PUBLISHED if law == "published" else _FORMULAS


def reached(law: str, changed: tuple[str, ...], targets: tuple[str, ...]) -> dict[str, set[str]]:
    """Return by wanted quantity which of the changed ones it depends on.

    A changed quantity is given: its own formula no longer counts.
    """
    table = formulas(law)

    def sources(name: str) -> set[str]:
        if name in changed:
            return {name}
        behind = table[name][1] if name in table else ()
        return set().union(*(sources(other) for other in behind))

    return {name: sources(name) for name in targets}


def derive(name: str, known: dict[str, Any], law: str) -> Any:
    """Return a quantity from the known ones, and enter it there."""
    if name not in known:
        function, needed = formulas(law)[name]
        known[name] = function(*(derive(other, known, law) for other in needed))
    return known[name]


@lru_cache(maxsize=256)
def inputs_of(
    configuration: Configuration, law: str, surroundings: Surroundings
) -> Mapping[str, float]:
    """Return the inputs of a configuration by name; a rigid one's compliances are 0.

    Raises:
        InputError: law published, and a blade without the data of the authors' program.
    """
    inputs: dict[str, float] = {}
    nodus, published = configuration.nodus, configuration.blade.published
    records: list[tuple[str, Any]] = [("", configuration.blade.joint), ("", surroundings)]
    if nodus is None:
        inputs.update(dict.fromkeys(COMPLIANCES, 0.0))
    else:
        records += [("", nodus), ("", nodus.matrix), ("fibre_", nodus.fibre)]
        inputs["matrix_modulus_MPa"] = matrix_modulus(nodus.matrix)
        if law == "published" and published is None:
            raise InputError(
                f"law published: blade {configuration.blade.name} of {configuration.label} has no "
                "data of the authors' program; accepted: law repaired or consistent"
            )
    if published is not None:
        records.append(("", published))
    for prefix, record in records:
        for name in _fields(record, prefix):
            inputs[name] = float(getattr(record, name.removeprefix(prefix)))
    return inputs


def nodus_moduli(configuration: Configuration | int, law: str = "repaired") -> Moduli:
    """Return E_N and G_N of a configuration [MPa], as Table I prints them.

    Args:
        configuration: a Configuration, or a number of Table I.
        law: "published" has the moduli that the authors' program computes with: it overwrites the
            number of fibres (by 6) and takes G_f = E_f / 2.7. Table III was computed so.

    Raises:
        InputError: the configuration is rigid, a number that is not in Table I, or a blade without
            the data of the authors' program.
    """
    chosen = known_configuration(configuration)
    if chosen.rigid:
        raise InputError(
            f"{chosen.label} is rigid, it has no nodus; accepted: a configuration with a nodus"
        )
    known = dict(inputs_of(chosen, law, STANDARD))
    return Moduli(float(derive("E_N_MPa", known, law)), float(derive("G_N_MPa", known, law)))
