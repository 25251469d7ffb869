"""Results of the laws for the paper's propellers: one record for all claims and figures."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from tombo_dynamics.arrays import Array
from tombo_dynamics.propeller import (
    RPM,
    SPEED_LIMIT,
    STANDARD,
    Configuration,
    Operation,
    Surroundings,
    configurations,
    evaluate,
    evaluate_rows,
    nodus_moduli,
    parameter_row,
    valid_speed,
)
from tombo_dynamics.propeller.laws.parameters import SCALARS

_GRID = 161


@dataclass(frozen=True)
class Optimum:
    """Where thrust or lift over drag is largest; angles in degrees, NaN `value` never."""

    speed_rpm: float
    value: float
    alpha_deg: float
    beta_deg: float
    gamma_deg: float
    inside: bool
    """False: it still rises at the end of the law's range, which is not a maximum."""


@dataclass(frozen=True)
class Point:
    """One operating point."""

    thrust_N: float
    ratio: float
    alpha_deg: float
    beta_deg: float
    gamma_deg: float


@dataclass(frozen=True)
class LawNumbers:
    """Results of one law, by configuration."""

    law: str
    moduli: Mapping[int, tuple[float, float]]
    """E_N and G_N [MPa] that this law computes with."""
    low: Mapping[int, Point]
    """At 2000 rpm."""
    high: Mapping[int, Point]
    """At 3200 rpm."""
    table_1_ratio: Mapping[int, float]
    """Lift over drag at 2000 rpm with the number of fibres of Table I."""
    thrust: Mapping[int, Optimum]
    ratio: Mapping[int, Optimum]
    rigid_ratio_spread: float
    """Relative, of the rigid propeller from 100 to 18 000 rpm."""
    collapse: float
    """Largest relative difference of T / G_N, twist and lift over drag between configurations.

    At equal omega^2 / G_N, without gravity and with one E_N / G_N.
    """


@dataclass(frozen=True)
class Numbers:
    """Everything computed."""

    laws: Mapping[str, LawNumbers]
    shear_from_ratio: Mapping[int, float]
    """G_N [MPa] with the authors' program's G_f = E_f / 2.7 instead of 75 MPa."""
    fibre_shear_MPa: float


def compute(laws: Sequence[str], speeds_rpm: tuple[float, float]) -> Numbers:
    """Compute the paper's numbers under each law; well under a second for all.

    Args:
        laws: names of laws.
        speeds_rpm: ends of the measured range: that of Table III, and the highest.
    """
    soft = [c for c in configurations() if c.nodus is not None]
    shear = {c.number: nodus_moduli(_with_own_fibres(c), "published").G_N_MPa for c in soft}
    fibre_shear = {c.nodus.fibre.shear_modulus_MPa for c in soft if c.nodus is not None}
    return Numbers({law: _law(law, speeds_rpm) for law in laws}, shear, min(fibre_shear))


def maximum(configuration: Configuration, law: str, name: str) -> Optimum:
    """Return where `name`, "thrust_N" or "lift_over_drag", is largest in a law's range."""
    low, high = 0.01 * SPEED_LIMIT, valid_speed(configuration, law)
    ends = (low, high)
    for _ in range(2):
        speeds = np.linspace(low, high, _GRID)
        values = getattr(evaluate(configuration, speeds, law, outside="mask"), name)
        best = int(np.clip(np.nanargmax(values), 1, _GRID - 2))
        low, high = speeds[best - 1], speeds[best + 1]
    inside = bool(ends[0] < low and high < ends[1])
    if inside:  # the vertex of the parabola through the three
        a, b, c = values[best - 1 : best + 2]
        speed = float(speeds[best] + 0.25 * (high - low) * (a - c) / (a - 2.0 * b + c))
    else:
        speed = ends[int(values[-1] > values[0])]
    at = evaluate(configuration, speed, law)
    alpha, beta, gamma = _degrees(at)
    return Optimum(speed / RPM, float(getattr(at, name)), alpha, beta, gamma, inside)


def collapse(law: str, top_rpm: float = 15000.0) -> tuple[Array, Array]:
    """Compare the configurations at equal s = omega^2 / G_N, without gravity.

    Bending compliance follows the twist's, so that E_N / G_N is one number for all; in Table I it
    varies from 2.800 to 2.802.

    Returns:
        s [rad^2/(s^2 Pa)] of shape (40,), and T / G_N [N/Pa], twist [rad] and lift over drag of
        each configuration, (n, 3, 40).
    """
    soft = [c for c in configurations() if not c.rigid]
    calm = Surroundings(STANDARD.air_density_kg_m3, 0.0)
    rows = np.array([parameter_row(c, law, calm) for c in soft])
    twist = rows[:, SCALARS["twist_compliance"]]
    for name in ("flap_compliance", "lag_compliance"):
        rows[:, SCALARS[name]] = rows[0, SCALARS[name]] / twist[0] * twist
    shear = 1e6 * np.array([nodus_moduli(c, law).G_N_MPa for c in soft])
    scale = shear[0] * twist[0] / twist  # G_N by the law's compliance
    s = np.linspace(0.05, 1.0, 40) * (top_rpm * RPM) ** 2 / scale.max()
    points = evaluate_rows(rows[:, None], np.sqrt(s * scale[:, None]), law, "mask")
    return s, np.stack(
        [points.thrust_N / scale[:, None], points.gamma_rad, points.lift_over_drag], axis=1
    )


def _law(law: str, speeds_rpm: tuple[float, float]) -> LawNumbers:
    every = configurations()
    soft = [c for c in every if not c.rigid]
    moduli = {c.number: nodus_moduli(c, law) for c in soft}
    rigid = evaluate(every[0], np.linspace(100.0, 18000.0, 180) * RPM, law).lift_over_drag
    _, curves = collapse(law)
    with np.errstate(invalid="ignore"):
        apart = np.abs(curves / curves[:1] - 1.0)
    return LawNumbers(
        law=law,
        moduli={number: (m.E_N_MPa, m.G_N_MPa) for number, m in moduli.items()},
        low={c.number: _point(c, law, speeds_rpm[0]) for c in every},
        high={c.number: _point(c, law, speeds_rpm[1]) for c in every},
        table_1_ratio={
            c.number: _point(_with_own_fibres(c), law, speeds_rpm[0]).ratio for c in every
        },
        thrust={c.number: maximum(c, law, "thrust_N") for c in soft},
        ratio={c.number: maximum(c, law, "lift_over_drag") for c in soft},
        rigid_ratio_spread=float(np.ptp(rigid) / rigid.mean()),
        collapse=float(np.nanmax(apart)),
    )


def _point(c: Configuration, law: str, rpm: float) -> Point:
    at = evaluate(c, rpm * RPM, law)
    return Point(float(at.thrust_N), float(at.lift_over_drag), *_degrees(at))


def _degrees(at: Operation) -> tuple[float, float, float]:
    """Return lag, flap and twist of one operating point [deg]."""
    alpha, beta, gamma = at.alpha_rad, at.beta_rad, at.gamma_rad
    return math.degrees(float(alpha)), math.degrees(float(beta)), math.degrees(float(gamma))


def _with_own_fibres(c: Configuration) -> Configuration:
    """Return a configuration whose number of fibres the law `published` does not overwrite."""
    if c.nodus is None or c.blade.published is None:
        return c
    published = dataclasses.replace(c.blade.published, fibre_count=c.nodus.fibres)
    return dataclasses.replace(c, blade=dataclasses.replace(c.blade, published=published))
