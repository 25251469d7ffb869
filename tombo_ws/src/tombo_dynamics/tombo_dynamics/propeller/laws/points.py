"""Many operating points in one compiled call, under any law; and the law `published`.

Law `published` is the authors' program with its defects, the one that prints the paper's numbers.

It passes four times over: bend with the loads of the pass before, twist, turn the nodus' end,
integrate the loads from there. Its defects, each of which changes the result:

- six fibres whatever Table I says, and G_f = E_f / 2.7 (`nodus`);
- the nodus' end X is turned again at every pass, and so is where its wing begins;
- drag weighted with cos(theta + gamma), where Eq. 8 has cos(theta - gamma);
- drag of the nodus' outer 5 mm left out, its thrust counted twice;
- four passes, not convergence.

The program computes no torque. This module integrates the same drag times its radius.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.arrays import Array
from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller.laws.equilibrium import equilibrium, spring_angle, twisted
from tombo_dynamics.propeller.laws.parameters import (
    LAWS,
    OK,
    TWIST_OUT_OF_RANGE,
    Parameters,
    unpack,
)

PASSES = 4
_NODES = np.polynomial.legendre.leggauss(5)[0]
_WEIGHTS = np.polynomial.legendre.leggauss(5)[1]


@compiled
def _strip(
    p: Parameters, start: float, end: float, depth: Array, pitch: Array, gamma: float
) -> tuple[float, float, float]:
    """Return the integrals of thrust, drag and torque over a short stretch of one piece."""
    thrust = 0.0
    drag = 0.0
    torque = 0.0
    sin_g, cos_g = math.sin(gamma), math.cos(gamma)
    for i in range(_NODES.shape[0]):
        x = 0.5 * (end - start) * _NODES[i] + 0.5 * (end + start)
        theta = pitch[3] + x * (pitch[2] + x * (pitch[1] + x * pitch[0]))
        d = depth[3] + x * (depth[2] + x * (depth[1] + x * depth[0]))
        attack = theta - gamma
        c_l = p.fits[3] + p.fits[4] * math.sin(p.lift_rate * attack + p.fits[5])
        c_d = p.fits[6] + p.fits[7] * math.cos(p.drag_rate * attack + p.fits[8])
        odd = sin_g * math.tan(theta)
        load = 0.5 * (end - start) * _WEIGHTS[i] * d * x * x
        thrust += load * c_l * (cos_g + odd)
        drag += load * c_d * (cos_g - odd)
        torque += load * x * c_d * (cos_g - odd)
    return thrust, drag, torque


@compiled
def _mirrored(weights: Array, rate: float, gamma: float) -> float:
    """Return f(gamma) with cos(theta + gamma) where the closed form has cos(theta - gamma)."""
    s, c = math.sin(rate * gamma), math.cos(rate * gamma)
    even = weights[0] + weights[1] * c + weights[2] * s
    odd = weights[3] + weights[4] * c + weights[5] * s
    return float(math.cos(gamma) * even - math.sin(gamma) * odd)


@compiled
def _wing(p: Parameters, start: float, gamma: float) -> tuple[float, float, float]:
    """Return the integrals of thrust, drag and torque from `start` [m] to the tip."""
    thrust, _ = twisted(p.lift, p.lift_rate, gamma, math.sin(gamma), math.cos(gamma))
    drag = _mirrored(p.drag, p.drag_rate, gamma)
    torque = _mirrored(p.torque, p.drag_rate, gamma)
    join = p.shape[3]
    t, d, q = _strip(p, max(start, join), p.joint_radius, p.shape[12:16], p.shape[16:20], gamma)
    thrust, drag, torque = thrust + t, drag + d, torque + q
    if start < join:
        t, d, q = _strip(p, start, join, p.shape[4:8], p.shape[8:12], gamma)
        thrust, drag, torque = thrust + t, drag + d, torque + q
    return thrust, drag, torque


@compiled
def _rotate_end(p: Parameters, x: float, alpha: float, beta: float, gamma: float) -> float:
    """Return the first component of Rz(alpha) Ry(beta) Rx(gamma) ([x, 0, 0] - S) + S [m]."""
    s0, s1, s2 = p.shape[0], p.shape[1], p.shape[2]
    sa, ca = math.sin(alpha), math.cos(alpha)
    sb, cb = math.sin(beta), math.cos(beta)
    sg, cg = math.sin(gamma), math.cos(gamma)
    across = (ca * sb * sg - sa * cg) * s1 + (ca * sb * cg + sa * sg) * s2
    return float(ca * cb * (x - s0) - across + s0)


@compiled
def published_point(
    p: Parameters, square: float
) -> tuple[float, float, float, float, float, float, int]:
    """Run the authors' passes at omega^2 = `square` [rad^2/s^2].

    Returns:
        alpha, beta, gamma [rad], the integrals of thrust, drag [m^4] and torque [m^5] (multiply by
        rho omega^2), and OK or TWIST_OUT_OF_RANGE.
    """
    q = p.air_density * square
    pull = p.centrifugal * square
    thrust, drag, torque = p.fits[0], p.fits[1], p.fits[2]
    end = p.joint_radius
    alpha = 0.0
    beta = 0.0
    gamma = 0.0
    for _ in range(PASSES):
        kb = p.flap_compliance * end / p.wing_centroid
        ka = p.lag_compliance * p.wing_centroid / end
        up = q * thrust - p.wing_weight
        beta = p.flap_offset + spring_angle(kb * pull, kb * up - p.flap_offset)
        alpha = p.lag_offset + spring_angle(ka * pull, ka * q * drag - p.lag_offset)
        gamma = p.twist_compliance * (
            (up - pull * math.tan(beta - p.flap_offset)) * p.lift_arm
            + (q * drag + pull * math.tan(alpha)) * p.drag_arm
        )
        end = _rotate_end(p, end, alpha, beta, gamma)
        c = math.cos(alpha) * math.cos(beta)
        thrust, drag, torque = _wing(p, end, gamma)
        thrust, drag, torque = c * thrust, c * drag, c * torque
    verdict = OK if abs(gamma) <= p.twist_limit else TWIST_OUT_OF_RANGE
    return (
        alpha, beta, gamma, p.inner_thrust + thrust, p.inner_drag + drag, p.inner_torque + torque,
        verdict,
    )  # fmt: skip


Whole = NDArray[np.int64]

COLUMNS = 8
"""Columns of a solution: thrust [N], drag [N], torque [N m], alpha, beta, gamma [rad], L/D,
verdict (OK, TWIST_OUT_OF_RANGE or NO_EQUILIBRIUM)."""
_PUBLISHED = LAWS["published"]


@compiled
def solve_point(law: int, p: Parameters, speed: float, out: Array) -> None:
    """Write the operating point at `speed` [rad/s] into `out` (COLUMNS,)."""
    square = speed * speed
    rigid = p.flap_compliance == 0.0 and p.lag_compliance == 0.0 and p.twist_compliance == 0.0
    if law == _PUBLISHED and not rigid:
        alpha, beta, gamma, thrust, drag, torque, verdict = published_point(p, square)
    else:
        alpha, beta, gamma, verdict = 0.0, 0.0, 0.0, OK
        if not rigid:
            alpha, beta, gamma, verdict = equilibrium(law, p, square)
        c = math.cos(alpha) * math.cos(beta)
        s, k = math.sin(gamma), math.cos(gamma)
        thrust = p.inner_thrust + c * twisted(p.lift, p.lift_rate, gamma, s, k)[0]
        drag = p.inner_drag + c * twisted(p.drag, p.drag_rate, gamma, s, k)[0]
        torque = p.inner_torque + c * twisted(p.torque, p.drag_rate, gamma, s, k)[0]
    q = p.air_density * square
    out[0] = q * thrust
    out[1] = q * drag
    out[2] = q * torque
    out[3] = alpha
    out[4] = beta
    out[5] = gamma
    out[6] = thrust / drag
    out[7] = verdict


@compiled
def solve_points(law: int, rows: Array, which: Whole, speeds: Array, out: Array) -> None:
    """Solve point by point.

    Args:
        law: number of the law (`laws.parameters.LAWS`).
        rows: (r, ROW_SIZE), one a propeller.
        which: (n,) the propeller of each point, 0 to r - 1.
        speeds: (n,) rotor speeds [rad/s], finite and not negative.
        out: (n, COLUMNS) is written.
    """
    for i in range(speeds.shape[0]):
        solve_point(law, unpack(rows[which[i]]), speeds[i], out[i])
