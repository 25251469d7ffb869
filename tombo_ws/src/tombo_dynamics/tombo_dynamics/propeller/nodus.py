"""The nodus' elastic moduli, and the numbers of a law that follow from a configuration.

The moduli are Chamis' rule of mixtures, the paper's Eq. 2. The law `published` computes with the
moduli and the torsion terms of the authors' program.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.library import known_configuration
from tombo_dynamics.propeller.records import (
    Configuration,
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


def chamis(matrix: float, fibre: float, volume_fraction: float) -> float:
    """Mix two moduli, paper's Eq. 2: E = E_m / (1 - sqrt(v_f) (1 - E_m / E_f)).

    Args:
        matrix: modulus of the matrix, any unit.
        fibre: modulus of the fibres, same unit.
        volume_fraction: share of the section that is fibre, 0 to below 1.
    """
    return matrix / (1.0 - math.sqrt(volume_fraction) * (1.0 - matrix / fibre))


def volume_fraction(fibres: int, diameter_mm: float, area_mm2: float) -> float:
    """Return the share of the nodus' section that is fibre, n pi d^2 / 4 / A_N.

    Raises:
        InputError: the fibres fill the section.
    """
    share = fibres * math.pi * (diameter_mm * diameter_mm) / 4.0 / area_mm2
    if share >= 1.0:
        raise InputError(
            f"{fibres} fibres of {diameter_mm:g} mm fill the nodus' section of "
            f"{area_mm2:g} mm^2; accepted: less fibre than section"
        )
    return share


def shear_modulus(youngs_modulus: float, poisson_ratio: float) -> float:
    """Return the shear modulus of an isotropic matrix, E / (2 (1 + nu))."""
    return youngs_modulus / (2.0 * (1.0 + poisson_ratio))


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
    nodus = _nodus_of(chosen)
    fibres, shear = nodus.fibres, nodus.fibre.shear_modulus_MPa
    if law == "published":
        terms = published_terms(chosen)
        fibres = terms.fibre_count
        shear = nodus.fibre.youngs_modulus_MPa / terms.fibre_modulus_ratio
    area = chosen.blade.joint.section_area_mm2
    share = volume_fraction(fibres, nodus.fibre_diameter_mm, area)
    matrix = matrix_modulus(nodus.matrix)
    return Moduli(
        chamis(matrix, nodus.fibre.youngs_modulus_MPa, share),
        chamis(shear_modulus(matrix, nodus.matrix.poisson_ratio), shear, share),
    )


def _nodus_of(configuration: Configuration) -> Nodus:
    if configuration.nodus is None:
        raise InputError(
            f"{configuration.label} is rigid, it has no nodus; accepted: a configuration with a "
            "nodus"
        )
    return configuration.nodus


def published_terms(configuration: Configuration) -> PublishedTorsion:
    """Return the data of the authors' program.

    Raises:
        InputError: the blade has none.
    """
    terms = configuration.blade.published
    if terms is None:
        raise InputError(
            f"law published: blade {configuration.blade.name} of {configuration.label} has no "
            "data of the authors' program; accepted: law repaired or consistent"
        )
    return terms


def compliances(configuration: Configuration, law: str) -> tuple[float, float, float]:
    """Return flap and lag [rad/N] and twist [rad/(N m)] over their loads; 0: rigid.

    L^2 / (2 E_N I) in bending, L / (G_N J) in twist.
    """
    if configuration.nodus is None:
        return 0.0, 0.0, 0.0
    moduli, joint = nodus_moduli(configuration, law), configuration.blade.joint
    length = configuration.nodus.length_mm
    flap, lag = (
        (length * 1e-3) ** 2 / (2.0 * moduli.E_N_MPa * 1e6) / (moment * 1e-12)
        for moment in (joint.flap_second_moment_mm4, joint.lag_second_moment_mm4)
    )
    if law != "published":
        return flap, lag, length * 1e-9 / (moduli.G_N_MPa * joint.torsion_constant_m4)
    terms = published_terms(configuration)
    term = terms.torsion_term_m4
    section = terms.torsion_area_mm2 * 1e-6 * (terms.camber_length_mm * 1e-3) ** 2
    slender = 1.0 + 4.0 * term / (3.0 * section)  # the authors' torsion constant over F / 3
    return flap, lag, 3.0 * slender * length * 1e-9 / (moduli.G_N_MPa * term)


def law_numbers(
    configuration: Configuration, law: str, surroundings: Surroundings
) -> dict[str, float]:
    """Return the numbers of a law (`laws.parameters.SCALARS`) but the integrals over the blade.

    Raises:
        InputError: law published, and a blade without the data of the authors' program.
    """
    joint, section = configuration.blade.joint, configuration.blade.section
    flap, lag, twist = compliances(configuration, law)
    return {
        "air_density": surroundings.air_density_kg_m3,
        "wing_weight": joint.wing_mass_kg * surroundings.gravity_m_s2,
        "centrifugal": joint.wing_mass_kg * joint.wing_centroid_m / 4.0,
        "flap_compliance": flap,
        "lag_compliance": lag,
        "twist_compliance": twist,
        "joint_radius": joint.outer_radius_m,
        "wing_centroid": joint.wing_centroid_m,
        "flap_offset": joint.flap_offset_rad,
        "lag_offset": joint.lag_offset_rad,
        "lift_arm": joint.lift_arm_mm * 1e-3,
        "drag_arm": joint.drag_arm_mm * 1e-3,
        "lift_rate": section.lift_rate,
        "drag_rate": section.drag_rate,
    }
