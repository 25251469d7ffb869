"""Elastic moduli of the nodus: Chamis' rule of mixtures, the paper's Eq. 2."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from tombo_dynamics.errors import InputError
from tombo_dynamics.propeller.library import known_configuration
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


def nodus_moduli(configuration: Configuration | int) -> Moduli:
    """Return E_N and G_N of a configuration [MPa], as Table I prints them.

    Raises:
        InputError: the configuration is rigid, or a number that is not in Table I.
    """
    return _moduli(known_configuration(configuration), published=False)


def published_moduli(configuration: Configuration) -> Moduli:
    """Return the moduli that the authors' program computes with [MPa].

    It overwrites the number of fibres (by 6) and takes G_f = E_f / 2.7; Table III was computed so.

    Raises:
        InputError: the configuration is rigid.
    """
    return _moduli(configuration, published=True)


@lru_cache(maxsize=256)
def _moduli(configuration: Configuration, *, published: bool) -> Moduli:
    nodus = configuration.nodus
    if nodus is None:
        raise InputError(
            f"{configuration.label} is rigid, it has no nodus; "
            "accepted: a configuration with a nodus"
        )
    fibre, fibres, fibre_shear = nodus.fibre, nodus.fibres, nodus.fibre.shear_modulus_MPa
    if published:
        terms = configuration.blade.published
        if terms is None:
            raise InputError(
                f"law published: blade {configuration.blade.name} of {configuration.label} has no "
                "data of the authors' program; accepted: law repaired or consistent"
            )
        fibres = terms.fibre_count
        fibre_shear = fibre.youngs_modulus_MPa / terms.fibre_modulus_ratio
    area = configuration.blade.joint.section_area_mm2
    share = volume_fraction(fibres, nodus.fibre_diameter_mm, area)
    young = matrix_modulus(nodus.matrix)
    shear = shear_modulus(young, nodus.matrix.poisson_ratio)
    return Moduli(
        float(chamis(young, fibre.youngs_modulus_MPa, share)),
        float(chamis(shear, fibre_shear, share)),
    )
