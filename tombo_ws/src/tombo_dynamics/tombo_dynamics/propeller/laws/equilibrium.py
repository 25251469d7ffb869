"""The equilibrium of the laws `repaired` and `consistent`: Newton, and a path from rest.

The physical root is the one that continues the equilibrium at rest. Newton's method from a fixed
start finds it nearly always; where it does not, the root is followed up from rest in steps of
omega^2, which the equations are linear in.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from tombo_dynamics.jit import compiled
from tombo_dynamics.propeller.laws import consistent, repaired
from tombo_dynamics.propeller.laws.names import LAWS, LOST, OK, TWIST
from tombo_dynamics.propeller.laws.parameters import Parameters
from tombo_dynamics.propeller.laws.wing_loads import twisted

Array = NDArray[np.float64]

_START = 0.1
_STEPS = 30
_STEP_LIMIT = 0.3
_CLOSE = 1e-9
"""Newton's steps shrink quadratically: one below this leaves an error below rounding."""
_ANGLE_LIMIT = 1.5
_FOLLOW_ANGLE = 0.1
_MOST_FOLLOWED = 200
_CONSISTENT = LAWS["consistent"]
_repaired_pull = repaired.in_plane_pull
_consistent_pull = consistent.in_plane_pull


@compiled
def newton(
    law: int, p: Parameters, square: float, alpha: float, beta: float, gamma: float
) -> tuple[float, float, float, float, bool]:
    """Solve the three equations at omega^2 = `square` [rad^2/s^2] from a starting point [rad].

    Returns:
        alpha, beta, gamma [rad], the determinant of the Jacobian there, and whether it converged.
    """
    q = p.air_density * square
    pull = p.centrifugal * square
    kb = p.flap_compliance * p.joint_radius / p.wing_centroid
    ka = p.lag_compliance * p.wing_centroid / p.joint_radius
    kg = p.twist_compliance
    dy, dz = p.lift_arm, p.drag_arm
    determinant = 0.0
    for _ in range(_STEPS):
        sin_a, cos_a = math.sin(alpha), math.cos(alpha)
        sin_b, cos_b = math.sin(beta), math.cos(beta)
        sin_g, cos_g = math.sin(gamma), math.cos(gamma)
        lift, lift_g = twisted(p.lift, p.lift_rate, gamma, sin_g, cos_g)
        drag, drag_g = twisted(p.drag, p.drag_rate, gamma, sin_g, cos_g)
        c = q * cos_a * cos_b
        c_a, c_b = -q * sin_a * cos_b, -q * cos_a * sin_b
        tan_b = math.tan(beta - p.flap_offset)
        tan_a = math.tan(p.lag_offset - alpha)
        if law == _CONSISTENT:
            tan_t, slope_t = _consistent_pull(alpha, p.lag_offset)
        else:
            tan_t, slope_t = _repaired_pull(alpha, p.lag_offset)
        up = c * lift - p.wing_weight - pull * tan_b
        back = c * drag + pull * tan_a
        twist_back = c * drag + pull * tan_t
        pull_b = pull * (1.0 + tan_b * tan_b)
        pull_a = pull * (1.0 + tan_a * tan_a)

        r_b = beta - kb * up
        r_a = alpha - ka * back
        r_g = gamma - kg * (up * dy + twist_back * dz)
        b_a, b_b, b_g = -kb * c_a * lift, 1.0 - kb * (c_b * lift - pull_b), -kb * c * lift_g
        a_a, a_b, a_g = 1.0 - ka * (c_a * drag - pull_a), -ka * c_b * drag, -ka * c * drag_g
        g_a = -kg * (c_a * (lift * dy + drag * dz) + pull * slope_t * dz)
        g_b = -kg * (c_b * (lift * dy + drag * dz) - pull_b * dy)
        g_g = 1.0 - kg * c * (lift_g * dy + drag_g * dz)

        m_a = b_b * g_g - b_g * g_b
        m_b = b_a * g_g - b_g * g_a
        m_g = b_a * g_b - b_b * g_a
        determinant = a_a * m_a - a_b * m_b + a_g * m_g
        # Cramer's rule, with the minors that two of the three steps share.
        r_bg = r_b * g_g - b_g * r_g
        r_gb = r_b * g_b - b_b * r_g
        r_ga = r_b * g_a - b_a * r_g
        d_a = (r_a * m_a - a_b * r_bg + a_g * r_gb) / determinant
        d_b = (a_a * r_bg - r_a * m_b - a_g * r_ga) / determinant
        d_g = (a_b * r_ga - a_a * r_gb + r_a * m_g) / determinant
        size = max(abs(d_a), abs(d_b), abs(d_g))
        if not size < 1e6:
            return alpha, beta, gamma, determinant, False
        shrink = min(1.0, _STEP_LIMIT / max(size, 1e-300))
        alpha -= shrink * d_a
        beta -= shrink * d_b
        gamma -= shrink * d_g
        if size < _CLOSE:
            inside = (
                abs(p.lag_offset - alpha) < _ANGLE_LIMIT
                and abs(beta - p.flap_offset) < _ANGLE_LIMIT
                and abs(gamma) < _ANGLE_LIMIT
            )
            return alpha, beta, gamma, determinant, inside
    return alpha, beta, gamma, determinant, False


@compiled
def follow(law: int, p: Parameters, square: float) -> tuple[float, float, float, int]:
    """Follow the root from rest up to omega^2 = `square`; a step that jumps is halved.

    Returns:
        alpha, beta, gamma [rad] and OK; or NaNs and TWIST or LOST, whichever ends the path.
    """
    kb = p.flap_compliance * p.joint_radius / p.wing_centroid
    alpha, beta = 0.0, -kb * p.wing_weight
    gamma = -p.twist_compliance * p.wing_weight * p.lift_arm
    here, step = 0.0, square / 16.0
    for _ in range(_MOST_FOLLOWED):
        if here >= square:
            return alpha, beta, gamma, OK
        there = min(square, here + step)
        a, b, g, determinant, found = newton(law, p, there, alpha, beta, gamma)
        jump = max(abs(a - alpha), abs(b - beta), abs(g - gamma))
        if found and determinant > 0.0 and jump < _FOLLOW_ANGLE:
            alpha, beta, gamma, here = a, b, g, there
            if gamma > p.twist_limit:
                return math.nan, math.nan, math.nan, TWIST
            step *= 2.0
        else:
            step *= 0.5
    return math.nan, math.nan, math.nan, LOST


@compiled
def equilibrium(law: int, p: Parameters, square: float) -> tuple[float, float, float, int]:
    """Return alpha, beta, gamma [rad] at omega^2 = `square`, and OK, TWIST or LOST.

    With TWIST the angles are a root if Newton's method finds one, else NaN; with LOST, NaN.
    """
    a, b, g, determinant, found = newton(law, p, square, _START, _START, _START)
    if found and determinant > 0.0:
        return a, b, g, (OK if g <= p.twist_limit else TWIST)
    return follow(law, p, square)
