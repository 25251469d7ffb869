"""Elastic moduli of the nodus: Chamis' rule of mixtures, the paper's Eq. 2."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.records import Configuration, Matrix


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
    share = fibres * math.pi * diameter_mm**2 / 4.0 / area_mm2
    if share >= 1.0:
        raise InputError(
            f"{fibres} fibres of {diameter_mm:g} mm fill the nodus' section of {area_mm2:g} mm^2; "
            "accepted: less fibre than section"
        )
    return share


@lru_cache(maxsize=256)
def nodus_moduli(configuration: Configuration) -> Moduli:
    """Return E_N and G_N of a configuration [MPa], as Table I prints them.

    Raises:
        InputError: the configuration is rigid.
    """
    nodus = configuration.nodus
    if nodus is None:
        raise InputError(
            f"configuration {configuration.number} is rigid, it has no nodus; "
            "accepted: a configuration with a nodus"
        )
    share = volume_fraction(
        nodus.fibres, nodus.fibre_diameter_mm, configuration.blade.joint.section_area_mm2
    )
    young = matrix_modulus(nodus.matrix)
    shear = young / (2.0 * (1.0 + nodus.matrix.poisson_ratio))
    return Moduli(
        chamis(young, nodus.fibre.youngs_modulus_MPa, share),
        chamis(shear, nodus.fibre.shear_modulus_MPa, share),
    )


@lru_cache(maxsize=256)
def published_moduli(configuration: Configuration) -> Moduli:
    """Return the moduli that the authors' program computes with [MPa].

    It overwrites the number of fibres (by 6) and takes G_f = E_f / 2.7; Table III was computed so.

    Raises:
        InputError: the configuration is rigid, or its blade has no `published` data.
    """
    nodus, published = configuration.nodus, configuration.blade.published
    if nodus is None or published is None:
        raise InputError(
            f"law published: blade {configuration.blade.name} of configuration "
            f"{configuration.number} has no nodus or no data of the authors' program; "
            "accepted: law repaired or consistent"
        )
    share = volume_fraction(
        published.fibre_count,
        nodus.fibre_diameter_mm,
        configuration.blade.joint.section_area_mm2,
    )
    young = matrix_modulus(nodus.matrix)
    shear = young / (2.0 * (1.0 + nodus.matrix.poisson_ratio))
    fibre = nodus.fibre.youngs_modulus_MPa
    return Moduli(
        chamis(young, fibre, share), chamis(shear, fibre / published.fibre_modulus_ratio, share)
    )
