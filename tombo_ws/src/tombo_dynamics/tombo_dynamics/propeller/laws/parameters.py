"""The laws by name, and everything that one needs to know about a propeller, as one flat row.

A row of SI numbers is what compiled code takes: rows of many configurations, or of many variations
of one, stack into one array that a single call evaluates.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.errors import InputError, shown, unknown_name
from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller.blade import rigid_integrals, wing
from tombo_dynamics.propeller.library import known_configuration
from tombo_dynamics.propeller.nodus import law_numbers, published_terms
from tombo_dynamics.propeller.records import STANDARD, Configuration, Surroundings

LAWS = {"published": 0, "repaired": 1, "consistent": 2}
"""Law by name, with its number in compiled code."""
DEFAULT_LAW = "repaired"

OK = 0
TWIST_OUT_OF_RANGE = 1
NO_EQUILIBRIUM = 2
"""Verdicts on a point: physical root found; some section beyond the coefficients' range; no root
that continues the one at rest."""


def law_number(law: str) -> int:
    """Return the number of a law.

    Raises:
        InputError: there is no such law.
    """
    if not isinstance(law, str) or law not in LAWS:
        raise unknown_name("law", law, LAWS)
    return LAWS[law]


ROW_SIZE = 65


class Parameters(NamedTuple):
    """A row with names, in its order."""

    air_density: float  # rho [kg/m^3]
    wing_weight: float  # W = m_w g [N]
    centrifugal: float  # F_c / omega^2 = m_w x_c / 4 [kg m]
    flap_compliance: float  # L^2 / (2 E_N I_f) [rad/N]
    lag_compliance: float  # L^2 / (2 E_N I_l) [rad/N]
    twist_compliance: float  # L / (G_N J) [rad/(N m)]; k_g in the law published
    joint_radius: float  # r_N [m]
    wing_centroid: float  # x_c [m]
    flap_offset: float  # 0.1221 rad
    lag_offset: float  # 0.1418 rad
    lift_arm: float  # dy [m]
    drag_arm: float  # dz [m]
    twist_limit: float  # highest twist within the coefficients' range [rad]
    inner_thrust: float  # A_T [m^4]
    inner_drag: float  # A_D [m^4]
    inner_torque: float  # A_Q [m^5]
    lift_rate: float  # 2.13
    drag_rate: float  # 2.04
    lift: Any
    """(6,) weights of the wing's thrust [m^4]."""
    drag: Any
    """(6,) weights of the wing's drag [m^4]."""
    torque: Any
    """(6,) weights of the wing's torque [m^5]."""
    shape: Any
    """(20,), law published only: pivot (3), join of the pieces, depth and pitch polynomials
    (4 + 4 inner, 4 + 4 outer), pitch in rad."""
    fits: Any
    """(9,), law published only: thrust, drag and torque integrals of the wing from the join of
    the pieces, C_L (mean, swing, phase) and C_D (the same), phases in rad."""


SCALARS = {name: i for i, name in enumerate(Parameters._fields[:18])}
"""Index of a number in a row, for code that varies it."""
WING_SCALARS = ("twist_limit", "inner_thrust", "inner_drag", "inner_torque")
"""Those of them that are integrals over the blade, or follow from its shape."""
_LIFT, _SHAPE, _FITS = 18, 36, 56


@compiled
def unpack(row: Array) -> Parameters:
    """Name the numbers of a row (ROW_SIZE,); nothing is copied."""
    return Parameters(
        row[0], row[1], row[2], row[3], row[4], row[5], row[6], row[7], row[8], row[9], row[10],
        row[11], row[12], row[13], row[14], row[15], row[16], row[17], row[18:24], row[24:30],
        row[30:36], row[36:56], row[56:65],
    )  # fmt: skip


@lru_cache(maxsize=256)
def _row(configuration: Configuration, law: str, surroundings: Surroundings) -> Array:
    integrals = wing(configuration.blade)
    numbers = law_numbers(configuration, law, surroundings)
    numbers |= {name: getattr(integrals, name) for name in WING_SCALARS}
    row = np.zeros(ROW_SIZE)
    for name, column in SCALARS.items():
        row[column] = numbers[name]
    row[_LIFT:_SHAPE] = np.concatenate([integrals.lift, integrals.drag, integrals.torque])
    if law == "published" and not configuration.rigid:
        _add_published(row, configuration)
    return row


def parameter_row(
    configuration: Configuration | int, law: str, surroundings: Surroundings = STANDARD
) -> Array:
    """Return the row (ROW_SIZE,) of a configuration under a law: a copy, free to be varied.

    Raises:
        InputError: unknown law or configuration, or a blade that the law published is not defined
            for.
    """
    return _row(*checked(configuration, law, surroundings)).copy()


def checked(
    configuration: Configuration | int, law: str, surroundings: Surroundings
) -> tuple[Configuration, str, Surroundings]:
    """Return the inputs of a row, with a number replaced by its configuration.

    Raises:
        InputError: one of them is something else.
    """
    law_number(law)
    if not isinstance(surroundings, Surroundings):
        raise InputError(f"surroundings {shown(surroundings)}; accepted: a record Surroundings")
    return known_configuration(configuration), law, surroundings


def _add_published(row: Array, configuration: Configuration) -> None:
    """Fill in what the authors' program does differently; see `laws.published`."""
    terms, blade = published_terms(configuration), configuration.blade
    pieces = blade.pieces
    too_long = any(len(c) > 4 for piece in pieces for c in (piece.depth_m, piece.pitch_deg))
    if len(pieces) != 2 or too_long or len(terms.pivot_mm) != 3:
        raise InputError(
            f"law published: blade {blade.name} has not the form of the authors' program; "
            "accepted: two pieces of order 3 at most and a pivot of three numbers"
        )
    inner, outer = pieces
    thrust, drag, torque = rigid_integrals(blade, inner.start_m, inner.end_m)
    between = rigid_integrals(blade, inner.end_m, blade.joint.outer_radius_m)
    row[SCALARS["inner_thrust"]] = thrust + between[0]
    row[SCALARS["inner_drag"]] = drag
    row[SCALARS["inner_torque"]] = torque
    polynomials = [
        np.pad(scale * np.asarray(c, dtype=float), (4 - len(c), 0))
        for piece in (inner, outer)
        for c, scale in ((piece.depth_m, 1.0), (piece.pitch_deg, np.pi / 180.0))
    ]
    row[_SHAPE:_FITS] = np.concatenate(
        [np.asarray(terms.pivot_mm) * 1e-3, [inner.end_m], *polynomials]
    )
    section = blade.section
    row[_FITS:] = [
        *rigid_integrals(blade, inner.end_m, outer.end_m),
        section.lift_mean, section.lift_swing, np.radians(section.lift_phase_deg),
        section.drag_mean, section.drag_swing, np.radians(section.drag_phase_deg),
    ]  # fmt: skip
